// From a message's struct to a frame, and from a frame to a handler: what all generated messages share.
// The generated namespace supplies payload_bytes, write_payload, decode and violations for each struct, and clamp where
// a field asks for it; they are found by the struct's namespace.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <cstring>
#include <type_traits>
#include <utility>

#include "wirebond/encoder.hpp"
#include "wirebond/examine.hpp"
#include "wirebond/format.hpp"
#include "wirebond/handler.hpp"
#include "wirebond/header.hpp"
#include "wirebond/source.hpp"
#include "wirebond/status.hpp"
#include "wirebond/violation.hpp"

namespace wirebond {

/// The two ends of a link; the sender of a message is one of them, or both.
enum class End : std::uint8_t { host, mcu, both };

/// Write `message` as a whole frame to out[0 .. size). Any thread or interrupt; no allocation.
/// `capacity`: Message::Info::max_frame_bytes is always enough. On any other answer than `ok` size is 0 and what
/// lies at `out` is no frame. `header`: nothing, for the defaults of the source's sender; or its Header. A value there
/// that breaks its field's rule is `out_of_range`, and so are values that no form of the frame can carry.
/// `Ending`: `Waiting` for a queue that gives the frame its number later; `size` is then what it takes there.
template <class Source, class Ending = Sealed, class Message, class... Given>
WIREBOND_INLINE Status encode_frame(const Message& message, std::uint8_t* out, std::size_t capacity, std::size_t& size,
                                    const Given&... header) {
  constexpr Source source{};
  size = 0;
  if constexpr (detail::is_header<Source, Given...>) {
    detail::HeaderNumbers<Source> numbers;
    if (!write_header(header..., numbers.data())) return Status::out_of_range;
    return encode_frame<Source, Ending>(message, out, capacity, size, numbers);
  } else {
    const std::size_t payload = payload_bytes(message);
    if (payload > Message::Info::max_payload_bytes) return Status::out_of_range;
    Status status = Status::out_of_range;
    const auto write = [&](std::size_t form) WIREBOND_INLINE_LAMBDA {
      if (wire_bytes(source.format(), payload, form) > capacity) {
        status = Status::too_small;
      } else if (write_payload(message, out + payload_lead(source, form))) {
        size = Ending::end(source, out, capacity, Message::Info::id, payload, form, header.data()...);
        if (size != 0) status = Status::ok;
      }
    };
    detail::with_own_form(source, Message::Info::id, payload, write, detail::values_of<Source>(header)...);
    return status;
  }
}

/// Wire bytes that `encode_frame` needs for a message of this payload: exact where nothing is stuffed, else the worst.
/// 0: no form can carry it, and `encode_frame` refuses it. `numbers`: of the header, or nothing.
template <class Source, class Message, class... Numbers>
WIREBOND_INLINE std::size_t frame_room(std::size_t payload, const Numbers&... numbers) {
  constexpr Source source{};
  std::size_t room = 0;
  const auto take = [&](std::size_t form) WIREBOND_INLINE_LAMBDA { room = wire_bytes(source.format(), payload, form); };
  detail::with_own_form(source, Message::Info::id, payload, take, detail::values_of<Source>(numbers)...);
  return room;
}

namespace detail {

template <class Message, class = void>
struct HasClamp : std::false_type {};
template <class Message>
struct HasClamp<Message, std::void_t<decltype(clamp(std::declval<Message&>()))>> : std::true_type {};

/// Room for a message on its way to a handler. `EveryMember`: decode writes every member, as it does where a message
/// has one size only. Then the members' first values would be written for nothing, so they are not: the object begins
/// its life as a plain aggregate does in bytes (P0593). A struct without members has nothing that decode could write.
template <class Message, bool EveryMember = !std::is_empty_v<Message> &&
                                            Message::Info::min_payload_bytes == Message::Info::max_payload_bytes>
class Room {
 public:
  Message& message() { return message_; }

 private:
  Message message_;
};

template <class Message>
class Room<Message, true> {
 public:
  Message& message() { return *static_cast<Message*>(static_cast<void*>(bytes_)); }

 private:
  static_assert(std::is_aggregate_v<Message> && std::is_trivially_copyable_v<Message>, "a message is plain data");
  alignas(Message) unsigned char bytes_[sizeof(Message)];
};

/// The rest of `hand_over` where frames have header fields: the rules of both, then the handler.
template <class Message, class Header, class Handler>
WIREBOND_INLINE bool hand_over_both(Message& message, const Header& header, Handler& handler, Violations& counts) {
  const Violation found = violations(message) | violations(header);
  if (found != Violation::none) {
    counts.count(found);
    if (rejects(found)) return false;
    if constexpr (HasClamp<Message>::value) clamp(message);
  }
  if constexpr (HasOnWithHeader<Handler, Message, Header>::value) {
    handler.on(static_cast<const Message&>(message), header);
  } else if constexpr (HasOn<Handler, Message>::value) {
    handler.on(static_cast<const Message&>(message));
  }
  return true;
}

}  // namespace detail

/// Decode the frame's payload, apply the field rules, and call `handler.on(const Message&)` or, where frames of
/// `Source` have header fields, `handler.on(const Message&, const Header&)`: whichever it has, and the latter where it
/// has both. True when message and header passed the rules (clamped or not), whether or not the handler wants the
/// message.
template <class Message, class Source = void, class Handler>
bool hand_over(const Frame& frame, Handler& handler, Violations& counts) {
  constexpr std::size_t least = Message::Info::min_payload_bytes;
  const std::uint8_t* payload = frame.payload;
  std::size_t size = frame.payload_size;
  [[maybe_unused]] std::array<std::uint8_t, least> whole;
  if constexpr (least > 0) {
    if (size < least) {  // zeros that were trimmed from its end are put back
      std::memcpy(whole.data(), payload, size);
      std::memset(whole.data() + size, 0, least - size);
      payload = whole.data();
      size = least;
    }
  }
  detail::Room<Message> room;
  Message& message = room.message();
  if (!decode(payload, size, message)) {  // the deframer has seen to the payload's least size
    counts.count(Violation::wrong_count);
    return false;
  }
  static_assert(detail::RightOn<Handler, Message, HeaderOf<Source>>::value);
  if constexpr (has_header<Source>) {
    return detail::hand_over_both(message, header_of<Source>(frame), handler, counts);
  } else {
    const Violation found = violations(message);
    if (found != Violation::none) {
      counts.count(found);
      if (rejects(found)) return false;
      if constexpr (detail::HasClamp<Message>::value) clamp(message);
    }
    if constexpr (detail::HasOn<Handler, Message>::value) handler.on(static_cast<const Message&>(message));
    return true;
  }
}

/// Call `handler.unknown(frame)` or `handler.unknown(frame, header)`, as `hand_over` does. False: no message passed.
template <class Source = void, class Handler>
bool hand_over_unknown(const Frame& frame, Handler& handler) {
  if constexpr (detail::HasUnknownWithHeader<Handler, HeaderOf<Source>>::value) {
    const HeaderOf<Source> header = header_of<Source>(frame);
    handler.unknown(frame, header);
  } else if constexpr (detail::HasUnknown<Handler>::value) {
    handler.unknown(frame);
  } else {
    static_cast<void>(frame);
    static_cast<void>(handler);
  }
  return false;
}

}  // namespace wirebond
