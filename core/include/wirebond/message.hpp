// Encodes a message's struct into a frame, and passes a frame's message to a handler: common to all generated messages.
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
#include "wirebond/match.hpp"
#include "wirebond/source.hpp"
#include "wirebond/status.hpp"
#include "wirebond/violation.hpp"

namespace wirebond {

/// The two ends of a link; the sender of a message is one of them, or both.
enum class End : std::uint8_t { host, mcu, both };

namespace detail {

/// Number of tests that the frames of a message must pass (`Info::match`).
template <class Message, class = void>
inline constexpr std::size_t match_count = 0;
template <class Message>
inline constexpr std::size_t match_count<Message, std::void_t<decltype(Message::Info::match)>> =
    sizeof(Message::Info::match) / sizeof(MatchTest);

/// Number of those that test header fields or the id.
template <class Message>
constexpr std::size_t count_header_tests() {
  std::size_t count = 0;
  if constexpr (match_count<Message> != 0) {
    for (const MatchTest& test : Message::Info::match) count += test.of == MatchOf::id || test.of == MatchOf::header;
  }
  return count;
}

/// Check whether header values must be settled before this message is sent.
template <class Source, class Message, class... Given>
inline constexpr bool must_settle = count_header_tests<Message>() != 0 &&
                                    (sizeof...(Given) == 0 || (!std::is_same_v<Given, SettledNumbers<Source>> && ...));

/// Give the header the values that the message's frames have. A default value that they cannot have is replaced by the
/// first one that they can have, and so is any value if only one is possible. Returns false if a given value is none of
/// the message.
template <class Source, class Message>
WIREBOND_INLINE bool settle_match(SettledNumbers<Source>& numbers) {
  bool is_allowed = false;
  bool begins = true;
  std::uint64_t first = 0;
  constexpr std::size_t count = match_count<Message>;
  return every<true, count>(0, count, [&](std::size_t i) WIREBOND_INLINE_LAMBDA {
    const MatchTest& test = Message::Info::match[i];
    if (test.of != MatchOf::id && test.of != MatchOf::header) return true;
    std::uint64_t& number = numbers[test.place];
    if (begins) first = test.low;
    is_allowed = test.allows(number) || (!begins && is_allowed);
    begins = !test.or_next;
    if (test.or_next) return true;
    numbers.settled |= std::uint32_t{1} << test.place;
    if (is_allowed) return true;
    if (!test.is_one && number != default_numbers<Source>[test.place]) return false;
    number = (number & ~test.mask) | first;
    return true;
  });
}

/// Return the defaults, or the numbers that were given.
template <class Source>
WIREBOND_INLINE SettledNumbers<Source> numbers_to_settle() {
  return {default_numbers<Source>};
}
template <class Source>
WIREBOND_INLINE SettledNumbers<Source> numbers_to_settle(const HeaderNumbers<Source>& given) {
  return {given};
}

template <class Message, class = void>
inline constexpr bool has_ids = false;
template <class Message>
inline constexpr bool has_ids<Message, std::void_t<decltype(Message::Info::id_place)>> = true;

/// Return the id to send: the message's, or that of the header if the message has several.
template <class Message, class... Numbers>
WIREBOND_INLINE std::uint32_t id_of([[maybe_unused]] const Numbers&... numbers) {
  if constexpr (has_ids<Message> && sizeof...(Numbers) != 0) {
    return static_cast<std::uint32_t>((numbers[Message::Info::id_place], ...));
  } else {
    return Message::Info::id;
  }
}

/// Check whether the payload passes the message's tests.
template <class Message>
WIREBOND_INLINE bool payload_matches([[maybe_unused]] const std::uint8_t* payload, [[maybe_unused]] std::size_t size) {
  constexpr std::size_t count = match_count<Message>;
  if constexpr (count == 0) {
    return true;
  } else {
    bool holds = false;
    return every<true, count>(0, count, [&](std::size_t i) WIREBOND_INLINE_LAMBDA {
      const MatchTest& test = Message::Info::match[i];
      if (test.of != MatchOf::payload && test.of != MatchOf::size) return true;
      std::uint64_t number = size;
      const bool is_there = test.of == MatchOf::size ||
                            payload_number(payload, size, false, test.at, test.bytes, test.order, test.shift, number);
      holds = holds || (is_there && test.allows(number));
      if (test.or_next) return true;
      const bool found = holds;
      holds = false;
      return found;
    });
  }
}

}  // namespace detail

/// Write `message` as a whole frame to out[0 .. size). Any thread or interrupt; no allocation.
/// `capacity`: Message::Info::max_frame_bytes is always enough. Unless the result is `ok`, size is 0 and `out` has
/// no frame. `header`: nothing, for the defaults of the source's sender; or its Header. A header value that breaks its
/// field's rule, or that no form of the frame can carry, is `out_of_range`. `Ending`: `Waiting` for a queue that gives
/// the frame its number later; `size` is then the memory that it takes there.
template <class Source, class Ending = Sealed, class Message, class... Given>
WIREBOND_INLINE Status encode_frame(const Message& message, std::uint8_t* out, std::size_t capacity, std::size_t& size,
                                    const Given&... header) {
  constexpr Source source{};
  size = 0;
  if constexpr (detail::is_header<Source, Given...>) {
    detail::HeaderNumbers<Source> numbers;
    if (!write_header(header..., numbers.data())) return Status::out_of_range;
    return encode_frame<Source, Ending>(message, out, capacity, size, numbers);
  } else if constexpr (detail::must_settle<Source, Message, Given...>) {
    detail::SettledNumbers<Source> numbers = detail::numbers_to_settle<Source>(header...);
    if (!detail::settle_match<Source, Message>(numbers)) return Status::out_of_range;
    return encode_frame<Source, Ending>(message, out, capacity, size, numbers);
  } else {
    const std::uint32_t id = detail::id_of<Message>(header...);
    const std::size_t payload = payload_bytes(message);
    if (payload > Message::Info::max_payload_bytes) return Status::out_of_range;
    Status status = Status::out_of_range;
    const auto write = [&](std::size_t form) WIREBOND_INLINE_LAMBDA {
      if (wire_bytes(source.format(), payload, form) > capacity) {
        status = Status::too_small;
      } else if (write_payload(message, out + payload_lead(source, form)) &&
                 detail::payload_matches<Message>(out + payload_lead(source, form), payload)) {
        size = Ending::end(source, out, capacity, id, payload, form, header.data()...);
        if (size != 0) status = Status::ok;
      }
    };
    detail::with_own_form(source, id, payload, write, detail::values_of<Source>(header)...);
    return status;
  }
}

/// Return the wire bytes that `encode_frame` needs for a message of this payload: exact if nothing is stuffed,
/// otherwise the maximum; 0 if no form can carry it and `encode_frame` refuses it. `numbers`: of the header, or
/// nothing.
template <class Source, class Message, class... Numbers>
WIREBOND_INLINE std::size_t frame_room(std::size_t payload, const Numbers&... numbers) {
  if constexpr (detail::must_settle<Source, Message, Numbers...>) {
    detail::SettledNumbers<Source> settled = detail::numbers_to_settle<Source>(numbers...);
    if (!detail::settle_match<Source, Message>(settled)) return 0;
    return frame_room<Source, Message>(payload, settled);
  } else {
    constexpr Source source{};
    std::size_t room = 0;
    const auto take = [&](std::size_t form)
                          WIREBOND_INLINE_LAMBDA { room = wire_bytes(source.format(), payload, form); };
    const std::uint32_t id = detail::id_of<Message>(numbers...);
    detail::with_own_form(source, id, payload, take, detail::values_of<Source>(numbers)...);
    return room;
  }
}

namespace detail {

template <class Message, class = void>
struct HasClamp : std::false_type {};
template <class Message>
struct HasClamp<Message, std::void_t<decltype(clamp(std::declval<Message&>()))>> : std::true_type {};

/// Memory for a message that is passed to a handler. `EveryMember`: decode writes every member, because the message has
/// one size only. Then members are not initialised first, which would be wasted work: the object's lifetime begins as
/// that of an aggregate in bytes (P0593). A struct without members has nothing that decode could write.
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

template <class Message>
WIREBOND_INLINE bool decode_frame(const Frame& frame, Message& message) {
  constexpr std::size_t least = Message::Info::min_payload_bytes;
  const std::uint8_t* payload = frame.payload;
  std::size_t size = frame.payload_size;
  [[maybe_unused]] std::array<std::uint8_t, least> whole;
  if constexpr (least > 0) {
    if (size < least) {  // restore the zeros that were trimmed from its end
      std::memcpy(whole.data(), payload, size);
      std::memset(whole.data() + size, 0, least - size);
      payload = whole.data();
      size = least;
    }
  }
  return decode(payload, size, message);
}

/// Check whether two values of a field are equal. Without `==`, because compilers warn of it for floats.
template <class Value>
auto are_equal(const Value& a, const Value& b, int) -> decltype(a.view() == b.view()) {
  return a.view() == b.view();
}
template <class Value>
bool are_equal(const Value& a, const Value& b, long) {
  return a <= b && b <= a;  // not a NaN
}

/// Check whether two values of a scaled integer are equal: they differ by less than `half_step`, because a real loses
/// digits.
template <class Real>
bool are_near(Real a, Real b, Real half_step) {
  return a - b < half_step && b - a < half_step;
}
/// Compare scaled floats. Each end may lose 1 / `steps` of a value. `offset` is the field's own, without sign.
template <class Real>
bool are_close(Real a, Real b, Real offset, Real steps) {
  const Real limit = ((b < 0 ? -b : b) + offset) / steps;
  return a - b <= limit && b - a <= limit;
}

/// Check whether `has(message)` holds for the frame's message.
template <class Message, class Has>
bool has_values(const Frame& frame, const Has& has) {
  Room<Message> room;
  Message& message = room.message();
  return decode_frame(frame, message) && has(static_cast<const Message&>(message));
}

/// Check whether it is the file's emergency stop, with its values. The source of a generated header knows.
template <class Source>
auto is_stop(const Frame& frame, int) -> decltype(Source::is_stop(frame)) {
  return Source::is_stop(frame);
}
template <class Source>
bool is_stop(const Frame&, long) {
  return false;
}

/// Continue `hand_over` for frames with header fields: apply the rules of both, then call the handler.
template <class Message, class Header, class Handler>
WIREBOND_INLINE bool hand_over_both(Message& message, const Header& header, Handler& handler, Violations& counts) {
  const Violation found = violations(message) | violations(header);
  if (found != Violation::none) {
    counts.count(found);
    if (rejects(found)) {
      if constexpr (has_on_rejected<Handler, Message, Header>) {
        if (!rejects(violations(header))) handler.on_rejected(static_cast<const Message&>(message), header);
      }
      return false;
    }
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
/// `Source` have header fields, `handler.on(const Message&, const Header&)`: the latter if it has both. Returns true if
/// message and header passed the rules (clamped or not), even if the handler has no function for the message.
template <class Message, class Source = void, class Handler>
bool hand_over(const Frame& frame, Handler& handler, Violations& counts) {
  detail::Room<Message> room;
  Message& message = room.message();
  if (!detail::decode_frame(frame, message)) {  // the deframer has checked the payload's minimum size
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
      if (rejects(found)) {
        if constexpr (detail::has_on_rejected<Handler, Message>) {
          handler.on_rejected(static_cast<const Message&>(message));
        }
        return false;
      }
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
