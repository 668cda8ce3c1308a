// Finds out at compile time which functions a handler has for a message, with readable errors for one that would never
// be called. Calls no function of a handler.
#pragma once

#include <type_traits>
#include <utility>

#include "wirebond/examine.hpp"
#include "wirebond/header.hpp"
#include "wirebond/message_list.hpp"

namespace wirebond {

/// Base class of a handler used by receivers or links of both ends. It may have an `on` for every message of the
/// protocol.
struct ServesBothEnds {};

}  // namespace wirebond

namespace wirebond::detail {

/// A template may accept `NoHeader`, too, but none is passed.
template <class Header>
using IsHeader = std::bool_constant<!std::is_same_v<Header, NoHeader>>;

// ---- `on` and `unknown`

template <class Handler, class Message, class = void>
struct HasOn : std::false_type {};
template <class Handler, class Message>
struct HasOn<Handler, Message, std::void_t<decltype(std::declval<Handler&>().on(std::declval<const Message&>()))>>
    : std::true_type {};

template <class Handler, class Message, class Header, class = void>
struct HasOnWithHeader : std::false_type {};
template <class Handler, class Message, class Header>
struct HasOnWithHeader<
    Handler, Message, Header,
    std::void_t<decltype(std::declval<Handler&>().on(std::declval<const Message&>(), std::declval<const Header&>()))>>
    : IsHeader<Header> {};

/// Stands for any argument, in questions to the compiler.
struct Something {
  template <class T>
  operator T&() const;
  template <class T>
  operator const T&() const;
};

template <class Handler, class Message, class = void>
struct HasOnWithSomething : std::false_type {};
template <class Handler, class Message>
struct HasOnWithSomething<
    Handler, Message,
    std::void_t<decltype(std::declval<Handler&>().on(std::declval<const Message&>(), std::declval<Something>()))>>
    : std::true_type {};
template <class Handler, class Message, class = void>
struct HasOnThatChanges : std::false_type {};
template <class Handler, class Message>
struct HasOnThatChanges<Handler, Message, std::void_t<decltype(std::declval<Handler&>().on(std::declval<Message&>()))>>
    : std::true_type {};

/// Makes the compiler explain an `on` for this message that would never be called.
template <class Handler, class Message, class Header>
struct RightOn {
  static constexpr bool is_called = HasOn<Handler, Message>::value || HasOnWithHeader<Handler, Message, Header>::value;
  static_assert(is_called || !HasOnThatChanges<Handler, Message>::value,
                "the handler's `on` wants to change this message; write `void on(const Message&)`");
  static_assert(is_called || !HasOnWithSomething<Handler, Message>::value || IsHeader<Header>::value,
                "the handler's `on` has a second parameter, and frames of this protocol have no header field; write "
                "`void on(const Message&)`");
  static_assert(is_called || !HasOnWithSomething<Handler, Message>::value || !IsHeader<Header>::value,
                "the second parameter of the handler's `on` is not this protocol's header; write "
                "`void on(const Message&, const Header&)`");
  static constexpr bool value = true;
};

/// Not a message of any protocol: only a template accepts it.
struct AnyMessage {};

/// Stands for an argument of one type; no template can deduce that type.
template <class Argument>
struct InPlaceOf {
  operator Argument() const;
};

template <class Always, class Handler, class... Arguments>
struct TakesOn : std::false_type {};
template <class Handler, class... Arguments>
struct TakesOn<std::void_t<decltype(std::declval<Handler&>().on(std::declval<Arguments>()...))>, Handler, Arguments...>
    : std::true_type {};

/// Whether an `on` is written for this very message, not as a template.
template <class Handler, class Message, class... Header>
inline constexpr bool has_own_on = (TakesOn<void, Handler, InPlaceOf<const Message&>, Header...>::value ||
                                    TakesOn<void, Handler, InPlaceOf<Message&>, Header...>::value) &&
                                   !TakesOn<void, Handler, AnyMessage&, Header...>::value;

/// Makes the compiler explain an `on` for a message that the handler's own end sends.
template <class Handler, class Message>
struct OnOfRightEnd {
  static_assert(!has_own_on<Handler, Message> && !has_own_on<Handler, Message, Something>,
                "the handler has an `on` for this message, which only its own end sends: it would never be called. "
                "Remove it, or derive the handler from `wirebond::ServesBothEnds` if it serves both ends");
  static constexpr bool value = true;
};

template <class Handler, class NeverReceived, bool = std::is_base_of_v<ServesBothEnds, Handler>>
struct OnsOfRightEnd : std::true_type {};
template <class Handler, class... Messages>
struct OnsOfRightEnd<Handler, MessageList<Messages...>, false>
    : std::bool_constant<(OnOfRightEnd<Handler, Messages>::value && ...)> {};

template <class Source, class = void>
struct NeverIn {
  using Messages = MessageList<>;
};
template <class Source>
struct NeverIn<Source, std::void_t<typename Source::NeverSent>> {
  using Messages = typename Source::NeverSent;
};

/// True, or the compiler refuses the handler. `Source`: sender of the frames passed to it.
template <class Handler, class Source>
inline constexpr bool has_ons_of_right_end = OnsOfRightEnd<Handler, typename NeverIn<Source>::Messages>::value;

/// Whether the handler is also called for this message when its field rules keep it away from `on`. For the services of
/// a link.
template <class Nothing, class Handler, class... MessageAndHeader>
struct HasOnRejectedOf : std::false_type {};
template <class Handler, class... MessageAndHeader>
struct HasOnRejectedOf<
    std::void_t<decltype(std::declval<Handler&>().on_rejected(std::declval<const MessageAndHeader&>()...))>, Handler,
    MessageAndHeader...> : std::true_type {};
template <class Handler, class... MessageAndHeader>
inline constexpr bool has_on_rejected = HasOnRejectedOf<void, Handler, MessageAndHeader...>::value;

template <class Handler, class = void>
struct HasUnknown : std::false_type {};
template <class Handler>
struct HasUnknown<Handler, std::void_t<decltype(std::declval<Handler&>().unknown(std::declval<const Frame&>()))>>
    : std::true_type {};

template <class Handler, class Header, class = void>
struct HasUnknownWithHeader : std::false_type {};
template <class Handler, class Header>
struct HasUnknownWithHeader<Handler, Header,
                            std::void_t<decltype(std::declval<Handler&>().unknown(
                                std::declval<const Frame&>(), std::declval<const Header&>()))>> : IsHeader<Header> {};

// ---- `fill`

template <class Handler, class Message, class = void>
struct HasFill : std::false_type {};
template <class Handler, class Message>
struct HasFill<Handler, Message, std::void_t<decltype(std::declval<Handler&>().fill(std::declval<Message&>()))>>
    : std::true_type {};

template <class Handler, class Message, class Header, class = void>
struct HasFillWithHeader : std::false_type {};
template <class Handler, class Message, class Header>
struct HasFillWithHeader<
    Handler, Message, Header,
    std::void_t<decltype(std::declval<Handler&>().fill(std::declval<Message&>(), std::declval<Header&>()))>>
    : IsHeader<Header> {};

/// Whether `fill` takes a message that it cannot change: by value or as a constant. A template accepts the argument as
/// given.
template <class Handler, class Message, class = void>
struct HasFillThatReads : std::false_type {};
template <class Handler, class Message>
struct HasFillThatReads<Handler, Message, std::void_t<decltype(std::declval<Handler&>().fill(std::declval<Message>()))>>
    : std::bool_constant<!HasFill<Handler, AnyMessage>::value> {};
template <class Handler, class Message, class = void>
struct HasFillWithSomething : std::false_type {};
template <class Handler, class Message>
struct HasFillWithSomething<
    Handler, Message,
    std::void_t<decltype(std::declval<Handler&>().fill(std::declval<Message&>(), std::declval<Something>()))>>
    : std::true_type {};

/// Makes the compiler explain a `fill` for this message that would never be called.
template <class Handler, class Message, class Header>
struct RightFill {
  static constexpr bool is_called =
      HasFill<Handler, Message>::value || HasFillWithHeader<Handler, Message, Header>::value;
  static_assert(!HasFillThatReads<Handler, Message>::value,
                "the handler's `fill` cannot change this message; write `bool fill(Message&)`");
  static_assert(is_called || !HasFillWithSomething<Handler, Message>::value || IsHeader<Header>::value,
                "the handler's `fill` has a second parameter, and frames of this protocol have no header field; write "
                "`bool fill(Message&)`");
  static_assert(is_called || !HasFillWithSomething<Handler, Message>::value || !IsHeader<Header>::value,
                "the second parameter of the handler's `fill` is not this protocol's header to change; write "
                "`bool fill(Message&, Header&)`");
  static constexpr bool value = true;
};

}  // namespace wirebond::detail
