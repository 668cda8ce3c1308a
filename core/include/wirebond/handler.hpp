// Which functions a handler has for a message: questions to the compiler, and its words where one would never be
// called. No function of a handler is called here.
#pragma once

#include <type_traits>
#include <utility>

#include "wirebond/examine.hpp"
#include "wirebond/header.hpp"

namespace wirebond::detail {

/// A template may take `NoHeader`, too, but none is handed out.
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

/// Takes the place of any argument, in questions to the compiler.
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

/// The compiler says here what is wrong with a handler's `on` for this message, where it would never be called.
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

/// No message of a protocol: only a template takes it.
struct AnyMessage {};

template <class Handler, class Message, class Header, class = void>
struct HasFillWithHeader : std::false_type {};
template <class Handler, class Message, class Header>
struct HasFillWithHeader<
    Handler, Message, Header,
    std::void_t<decltype(std::declval<Handler&>().fill(std::declval<Message&>(), std::declval<Header&>()))>>
    : IsHeader<Header> {};

/// Does `fill` take a message that it cannot change: by value, or as a constant? A template takes what it is given.
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

/// The compiler says here what is wrong with a handler's `fill` for this message, where it would never be called.
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
