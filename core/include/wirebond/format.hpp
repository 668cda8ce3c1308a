// What a frame looks like, as plain data: one description that is a compile-time constant on the MCU and a value on
// the host. No byte is examined here.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>

#include "wirebond/bytes.hpp"
#include "wirebond/check.hpp"
#include "wirebond/unroll.hpp"

namespace wirebond {

/// A place in a frame: `offset` from its first byte, or (`from_end`, then negative or zero) from one past its last.
/// "Frame" means the bytes after unstuffing, without delimiters.
struct Position {
  std::int16_t offset = 0;
  bool from_end = false;

  WIREBOND_INLINE constexpr std::size_t in(std::size_t frame_size) const {
    return from_end ? frame_size - static_cast<std::size_t>(-static_cast<std::int32_t>(offset))
                    : static_cast<std::size_t>(offset);
  }
};

/// A byte that must have a value: of a magic, a constant, a tail. `mask` selects the bits that count.
struct Constant {
  Position at{};
  std::uint8_t mask = 0xFF;
  std::uint8_t value = 0;
};

/// A number in the frame's own parts: (wire integer >> shift) & mask. Absent when `bytes` is 0. Default mask: all bits
/// that its bytes have, which are up to 64.
struct Number {
  Position at{};
  std::uint8_t bytes = 0;
  ByteOrder order = ByteOrder::little;
  std::uint8_t shift = 0;
  std::uint64_t mask = ~std::uint64_t{0};

  constexpr bool present() const { return bytes != 0; }
  /// The greatest number of an id or a length, which has 32 bits at most.
  WIREBOND_INLINE constexpr std::int64_t most() const {
    return static_cast<std::int64_t>(mask & (detail::mask_of(8u * bytes) >> shift) & 0xFFFFFFFFu);
  }
};

/// How the payload's size is known.
enum class PayloadSize : std::uint8_t {
  by_length,  ///< payload bytes = length number * unit + bias
  fixed,      ///< always `fixed_payload` bytes
  by_id,      ///< the message's own size, or what its counts tell; without an id, of the one or the expected message
  rest,       ///< what lies between the delimiters
};

/// One check: over [from, to), its value in `bytes` bytes at `at`.
struct CheckRule {
  std::uint8_t algorithm = 0;  ///< index into FrameFormat::algorithms
  Position from{};
  Position to{};
  Position at{};
  std::uint8_t bytes = 0;
  ByteOrder order = ByteOrder::little;
  std::uint8_t shift = 0;      ///< value on the wire = check >> shift (8: the high byte of a 16-bit sum)
  bool seeded = false;         ///< the message's seed is counted after the range, and not sent
  bool as_hex = false;         ///< on the wire as two hex digits a byte, the highest digit first
  bool on_wire = false;        ///< over the bytes as they are sent, after stuffing; stands outside the stuffed ones
  std::int8_t continues = -1;  ///< an earlier check with the same start and algorithm: go on from its register
};

/// Where a form has a number that is neither length nor id: a named field, a sequence number. Its bits are as on the
/// wire: what they mean is known outside.
struct HeaderField {
  Number number{};
  std::uint64_t default_value = 0;  ///< of the sender
  std::uint8_t place = 0;           ///< in the list of all header fields of the format, which is the same for all forms
  std::uint64_t fixed_mask = 0;     ///< bits that tell this form from others: they are constants, too,
  std::uint64_t fixed_value = 0;    ///< of these values
  bool is_magic = false;            ///< any form will do where no value was given
};

/// What a condition compares beside constants.
enum class Subject : std::uint8_t {
  field,  ///< a header field
  id,
  size,  ///< the payload's, before it is trimmed
};

/// A frame is not of the form if this number lies in [low, high].
struct Exclusion {
  Subject subject = Subject::field;
  std::uint8_t place = 0;  ///< of a header field, in the list of all of them
  bool on_receive = true;  ///< false: it only chooses the sender's form
  Number number{};         ///< where a receiver finds it, and which of its bits count; absent for the size
  std::uint64_t low = 0;
  std::uint64_t high = 0;
};

/// Header values of a frame to send: bits as on the wire, by place. Points at as many as the format has header fields;
/// the caller keeps them alive during the call.
struct HeaderValues {
  const std::uint64_t* values = nullptr;  ///< null: the sender's defaults
  std::uint32_t given = 0;                ///< bit i: the sender asked for value i, so a form without it is not taken
};

/// Instead of a place in the list of header fields: there is no such field.
constexpr std::uint8_t no_header_field = 0xFF;

constexpr std::size_t max_constants = 16;
constexpr std::size_t max_checks = 4;
constexpr std::size_t max_forms = 8;
constexpr std::size_t max_algorithms = 4;
constexpr std::size_t max_header_fields = 16;
constexpr std::size_t max_escapes = 6;
constexpr std::size_t max_exclusions = 24;
constexpr std::size_t max_insertion = 4;

/// One shape that a frame can take: fixed bytes before the payload (`prefix`), the payload, fixed bytes after it
/// (`suffix`). A format whose header varies (two magics, optional parts) has several forms, told apart by their
/// constants.
struct Form {
  std::uint16_t prefix = 0;
  std::uint16_t suffix = 0;
  std::uint8_t prefix_constants = 0;  ///< this many of the first `constants` lie in the prefix, by rising offset
  std::uint8_t constant_count = 0;
  std::uint8_t header_checks = 0;  ///< this many of the first `checks` cover and lie in the prefix only
  std::uint8_t check_count = 0;
  PayloadSize payload_size = PayloadSize::fixed;
  std::uint8_t length_unit = 1;
  std::int32_t length_bias = 0;
  std::uint16_t fixed_payload = 0;
  bool trims_zeros = false;  ///< zeros at the payload's end are not sent; the receiver puts them back
  std::uint8_t header_count = 0;
  std::uint8_t first_exclusion = 0;  ///< in FrameFormat::exclusions
  std::uint8_t exclusion_count = 0;
  Number length{};
  Number id{};
  std::uint32_t id_mask = 0;   ///< bits of the id that tell this form from others: they are constants, too,
  std::uint32_t id_value = 0;  ///< of these values
  std::array<Constant, max_constants> constants{};
  std::array<CheckRule, max_checks> checks{};
  std::array<HeaderField, max_header_fields> header{};
};

enum class Framing : std::uint8_t {
  by_start,   ///< a frame is found by its first constant and its size
  delimited,  ///< a frame lies between two equal delimiters and cannot contain one; neighbours may share one
  bracketed,  ///< it lies between an opening and a closing delimiter that differ
  silence,    ///< a frame is what lies between two silences of the line
  sized,      ///< a frame is found by its first constant, and stuffed; its length tells where it ends
};

/// A delimiter of one or two bytes.
struct Mark {
  std::uint8_t size = 1;
  std::uint8_t first = 0;
  std::uint8_t second = 0;

  WIREBOND_INLINE constexpr bool stands_at(const std::uint8_t* bytes, std::size_t available) const {
    return available >= size && bytes[0] == first && (size == 1 || bytes[1] == second);
  }
};

enum class Stuffing : std::uint8_t {
  none,
  cobs,
  escape,
  hex,        ///< each byte is sent as two hex digits
  insertion,  ///< a byte is sent behind each place where a certain sequence stands
};

/// A byte that must not appear is sent as `escape` and a code: its value xor `exclusive_or` or, where that is 0, the
/// code beside it in the table (SLIP). A receiver with `exclusive_or` takes any escaped byte (HDLC). Where the escape
/// is the first byte of both delimiters it is doubled: its own code is the escape again (DLE).
struct EscapeRule {
  std::uint8_t escape = 0;
  std::uint8_t exclusive_or = 0;
  std::uint8_t count = 0;
  std::array<std::uint8_t, max_escapes> plain{};
  std::array<std::uint8_t, max_escapes> code{};
  std::uint8_t starts =
      0;  ///< this many of the first `plain` begin frames found by their start; none stands within one
};

/// Behind the bytes `after`, wherever they stand among the stuffed ones, `byte` is sent (Dynamixel 2.0: 0xFD behind
/// FF FF FD). The sequence does not begin as it ends, so that two of them never overlap.
struct InsertionRule {
  std::uint8_t size = 0;
  std::uint8_t byte = 0;
  std::array<std::uint8_t, max_insertion> after{};
};

/// What holds for all forms of a format.
struct FormatRules {
  Framing framing = Framing::by_start;
  Stuffing stuffing = Stuffing::none;
  Mark opening{};             ///< delimiter before a frame
  Mark closing{};             ///< delimiter behind it
  bool sends_opening = true;  ///< delimited: false where only the end of a frame is marked
  std::uint8_t form_count = 1;
  std::uint8_t own_forms = 1;  ///< the first of the forms: those that a sender takes by itself, by what it sends
  std::uint8_t algorithm_count = 0;
  bool deliver_unknown = false;  ///< unknown ids and other payload sizes are frames, not false starts
  bool skips_failed = false;     ///< a candidate that failed behind its header is not looked through again
  bool length_on_wire = false;   ///< sized: the length counts the bytes as they are sent, after stuffing
  std::uint8_t plain_front = 0;  ///< this many bytes before the stuffed ones are sent as they are
  std::uint8_t plain_back = 0;   ///< and this many behind them
  std::uint8_t sequence_place = no_header_field;  ///< the header field that counts a sender's frames
  bool sequence_per_message = false;              ///< it counts those of each message
  std::uint8_t peer_place = no_header_field;      ///< the header field that tells senders apart
  std::uint16_t max_payload = 0;
  /// What Source::message is asked for a frame without an id. Not 0 where other frames of this sender have one: then it
  /// is a value that no message has as its id.
  std::uint32_t no_id = 0;
  std::array<CheckAlgorithm, max_algorithms> algorithms{};
  EscapeRule escapes{};
  InsertionRule insertion{};
};

/// A whole format, with room for `Forms` forms and `Exclusions` exclusions. A constant has room for its own only: where
/// nothing is optimised, all of it lies in flash.
template <std::size_t Forms, std::size_t Exclusions>
struct SizedFormat : FormatRules {
  std::array<Form, Forms> forms{};
  std::array<Exclusion, Exclusions> exclusions{};  ///< of all forms
};

/// One with room for whatever a protocol file may say: for formats that are read at run time.
using FrameFormat = SizedFormat<max_forms, max_exclusions>;

/// The same format with all the room.
template <class Format>
constexpr FrameFormat widened(const Format& format) {
  FrameFormat wide{};
  static_cast<FormatRules&>(wide) = format;
  for (std::size_t i = 0; i < format.forms.size(); ++i) wide.forms[i] = format.forms[i];
  for (std::size_t i = 0; i < format.exclusions.size(); ++i) wide.exclusions[i] = format.exclusions[i];
  return wide;
}

/// What the deframer must know of a message: nothing about its fields.
struct MessageShape {
  std::int16_t index = -1;  ///< its place in the protocol's table; -1: unknown id
  std::uint16_t min_payload = 0;
  std::uint16_t max_payload = 0;
  std::uint8_t seed = 0;  ///< for checks that are `seeded`

  constexpr bool known() const { return index >= 0; }
};

/// Largest frame between delimiters after unstuffing, or on the wire where nothing is stuffed.
template <class Format>
WIREBOND_INLINE constexpr std::size_t max_frame_bytes(const Format& format) {
  std::size_t largest = 0;
  for (std::size_t i = 0; i < format.form_count; ++i) {
    const Form& form = format.forms[i];
    const std::size_t payload = form.payload_size == PayloadSize::fixed ? form.fixed_payload : format.max_payload;
    const std::size_t size = form.prefix + payload + form.suffix;
    if (size > largest) largest = size;
  }
  return largest;
}

/// Bytes that COBS adds to `size` bytes at most (Cheshire and Baker 1999: one code byte per started 254 bytes).
WIREBOND_INLINE constexpr std::size_t cobs_overhead(std::size_t size) { return 1 + size / 254; }

/// Bytes that stuffing adds to a frame of `size` bytes at most.
WIREBOND_INLINE constexpr std::size_t stuffing_overhead(const FormatRules& format, std::size_t size) {
  switch (format.stuffing) {
    case Stuffing::cobs: return cobs_overhead(size);
    case Stuffing::escape:
    case Stuffing::hex: return size;
    case Stuffing::insertion: return size / format.insertion.size;
    case Stuffing::none: break;
  }
  return 0;
}

WIREBOND_INLINE constexpr bool has_marks(const FormatRules& format) {
  return format.framing == Framing::delimited || format.framing == Framing::bracketed;
}

/// Bytes that a sender puts before a frame.
WIREBOND_INLINE constexpr std::size_t opening_bytes(const FormatRules& format) {
  return has_marks(format) && format.sends_opening ? format.opening.size : 0;
}

/// Bytes of the delimiters that a sender puts around a frame.
WIREBOND_INLINE constexpr std::size_t delimiter_bytes(const FormatRules& format) {
  return has_marks(format) ? opening_bytes(format) + format.closing.size : 0;
}

/// Largest frame on the wire, delimiters included.
template <class Format>
WIREBOND_INLINE constexpr std::size_t max_wire_bytes(const Format& format) {
  const std::size_t frame = max_frame_bytes(format);
  const std::size_t marks = has_marks(format) ? std::size_t{format.opening.size} + format.closing.size : 0;
  return frame + stuffing_overhead(format, frame) + marks;
}

/// Wire bytes that a sender sets aside for a frame of this form: exact where nothing is stuffed, else the worst.
template <class Format>
WIREBOND_INLINE constexpr std::size_t wire_bytes(const Format& format, std::size_t payload_size,
                                                 std::size_t form_index = 0) {
  const Form& form = format.forms[form_index];
  const std::size_t payload = form.payload_size == PayloadSize::fixed ? form.fixed_payload : payload_size;
  const std::size_t frame = form.prefix + payload + form.suffix;
  return frame + delimiter_bytes(format) + stuffing_overhead(format, frame);
}

/// Can a frame of this form have a payload of this size? A length must be able to tell it; a form without the length
/// that others have carries nothing.
WIREBOND_INLINE constexpr bool carries(const Form& form, std::size_t payload) {
  if (form.payload_size == PayloadSize::fixed) return payload <= form.fixed_payload;
  if (form.payload_size != PayloadSize::by_length) return true;
  if (!form.length.present()) return payload == 0;
  const std::int64_t counted = static_cast<std::int64_t>(payload) - form.length_bias;
  return counted >= 0 && counted % form.length_unit == 0 && counted / form.length_unit <= form.length.most();
}

/// The greatest payload that the form's own rule for its size allows; `max_payload` of the format bounds it, too.
WIREBOND_INLINE constexpr std::int64_t most_payload(const Form& form) {
  if (form.payload_size == PayloadSize::fixed) return form.fixed_payload;
  if (form.payload_size != PayloadSize::by_length) return 0xFFFF;
  return form.length.present() ? form.length.most() * form.length_unit + form.length_bias : 0;
}

/// Does `carries` hold for every size up to the format's greatest? Then no code asks it.
WIREBOND_INLINE constexpr bool carries_all(const FormatRules& format, const Form& form) {
  if (form.payload_size != PayloadSize::by_length) return true;  // `seal` compares with a fixed size itself
  return form.length.present() && form.length_unit == 1 && form.length_bias <= 0 &&
         static_cast<std::int64_t>(format.max_payload) - form.length_bias <= form.length.most();
}

/// Can a frame of this form carry message `id`? Its id has room for it. `no_id` is the message that frames without an
/// id carry, and no others.
WIREBOND_INLINE constexpr bool carries_id(const FormatRules& format, const Form& form, std::uint32_t id) {
  if (!form.id.present()) return id == format.no_id;
  return (format.no_id == 0 || id != format.no_id) && id <= form.id.most() && (id & form.id_mask) == form.id_value;
}

/// Do these header values allow a frame of this form? It has every field that was given, and the bits that tell it from
/// other forms are its own. `Unroll`, `Most`: as for `every`.
template <bool Unroll = false, std::size_t Most = max_header_fields>
WIREBOND_INLINE constexpr bool agrees(const Form& form, const HeaderValues& header) {
  std::uint32_t held = 0;
  const auto agrees_in = [&](std::size_t i) WIREBOND_INLINE_LAMBDA {
    const HeaderField& field = form.header[i];
    held |= std::uint32_t{1} << field.place;
    if (field.is_magic && (header.given >> field.place & 1u) == 0) return true;
    return (header.values[field.place] & field.fixed_mask) == field.fixed_value;
  };
  return detail::every<Unroll, Most>(0, form.header_count, agrees_in) && (header.given & ~held) == 0;
}

/// The number of the header field of this place; absent where the form lacks it.
WIREBOND_INLINE constexpr Number number_at(const Form& form, std::uint8_t place) {
  for (std::size_t i = 0; i < form.header_count; ++i) {
    if (form.header[i].place == place) return form.header[i].number;
  }
  return {};
}

/// Does an exclusion keep a sender from this form, for message `id` with `payload` bytes before trimming? `header` may
/// be null: then the fields have their defaults, which the sender's own forms allow. `Unroll`, `Most`: as for `every`.
template <bool Unroll = false, std::size_t Most = max_exclusions, class Format>
WIREBOND_INLINE constexpr bool is_excluded(const Format& format, const Form& form, std::uint32_t id,
                                           std::size_t payload, const std::uint64_t* header) {
  return !detail::every<Unroll, Most>(0, form.exclusion_count, [&](std::size_t i) WIREBOND_INLINE_LAMBDA {
    const Exclusion& exclusion = format.exclusions[form.first_exclusion + i];
    std::uint64_t value = payload;
    if (exclusion.subject == Subject::id) value = id & exclusion.number.mask;
    if (exclusion.subject == Subject::field) {
      if (header == nullptr) return true;
      value = header[exclusion.place] & exclusion.number.mask;
    }
    return value < exclusion.low || exclusion.high < value;
  });
}

/// Does a payload of this size, with the zeros that were cut from its end, break a condition of the form? `Unroll`,
/// `Most`: as for `every`.
template <bool Unroll = false, std::size_t Most = max_exclusions, class Format>
WIREBOND_INLINE constexpr bool size_is_excluded(const Format& format, const Form& form, std::size_t payload) {
  return !detail::every<Unroll, Most>(0, form.exclusion_count, [&](std::size_t i) WIREBOND_INLINE_LAMBDA {
    const Exclusion& exclusion = format.exclusions[form.first_exclusion + i];
    if (exclusion.subject != Subject::size || !exclusion.on_receive) return true;
    return payload < exclusion.low || exclusion.high < payload;
  });
}

/// Bytes before the payload, of the form that has most.
template <class Format>
WIREBOND_INLINE constexpr std::size_t longest_prefix(const Format& format) {
  std::size_t longest = 0;
  for (std::size_t i = 0; i < format.form_count; ++i) {
    if (format.forms[i].prefix > longest) longest = format.forms[i].prefix;
  }
  return longest;
}

/// The byte that every frame begins with; -1: there are several forms, or it is not wholly constant.
template <class Format>
WIREBOND_INLINE constexpr int one_start(const Format& format) {
  const Form& form = format.forms[0];
  const bool is_one = format.form_count == 1 && form.prefix_constants != 0 && form.constants[0].at.offset == 0 &&
                      form.constants[0].mask == 0xFF;
  return is_one ? form.constants[0].value : -1;
}

}  // namespace wirebond
