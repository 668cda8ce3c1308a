// Describes a frame as plain data: one description that is a compile-time constant on the MCU and a value on the host.
// No byte is examined here.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>

#include "wirebond/bytes.hpp"
#include "wirebond/check.hpp"
#include "wirebond/unroll.hpp"

namespace wirebond {

/// A place in a frame: `offset` from its first byte or, with `from_end` (then negative or zero), from one past its
/// last. "Frame" means the bytes after unstuffing, without delimiters.
struct Position {
  std::int16_t offset = 0;
  bool from_end = false;

  WIREBOND_INLINE constexpr std::size_t in(std::size_t frame_size) const {
    return from_end ? frame_size - static_cast<std::size_t>(-static_cast<std::int32_t>(offset))
                    : static_cast<std::size_t>(offset);
  }
};

/// A byte that must have a certain value: part of a magic, a constant or a tail. `mask` selects the bits that count.
struct Constant {
  Position at{};
  std::uint8_t mask = 0xFF;
  std::uint8_t value = 0;
};

/// A number in the frame's own parts: (wire integer >> shift) & mask. Absent if `bytes` is 0. Default mask: all bits of
/// its bytes, up to 64.
struct Number {
  Position at{};
  std::uint8_t bytes = 0;
  ByteOrder order = ByteOrder::little;
  std::uint8_t shift = 0;
  std::uint64_t mask = ~std::uint64_t{0};

  constexpr bool present() const { return bytes != 0; }
  /// Maximum value of an id or a length, which has at most 32 bits.
  WIREBOND_INLINE constexpr std::int64_t most() const {
    return static_cast<std::int64_t>(mask & (detail::mask_of(8u * bytes) >> shift) & 0xFFFFFFFFu);
  }
};

/// How the payload's size is known.
enum class PayloadSize : std::uint8_t {
  by_length,  ///< payload bytes = length number * unit + bias
  fixed,      ///< always `fixed_payload` bytes
  by_id,      ///< the message's own size, or as its counts give it; without an id: of the only or the expected message
  rest,       ///< all bytes between the delimiters
};

/// Maximum number of ranges that a check covers.
constexpr std::size_t max_check_ranges = 4;

/// Bytes [from, to) that a check covers.
struct CheckRange {
  Position from{};
  Position to{};
};

/// A check over [from, to) and then over the ranges in `more`, stored in `bytes` bytes at `at`, or in `run`.
struct CheckRule {
  std::uint8_t algorithm = 0;  ///< index into FrameFormat::algorithms
  Position from{};
  Position to{};
  Position at{};
  std::uint8_t bytes = 0;
  ByteOrder order = ByteOrder::little;
  std::uint8_t shift = 0;      ///< value on the wire = check >> shift (8: the high byte of a 16-bit sum)
  bool seeded = false;         ///< the message's seed is included after the range, and not sent
  bool as_hex = false;         ///< on the wire as two hex digits per byte, the higher one first
  bool on_wire = false;        ///< over the bytes as they are sent, after stuffing; the check itself is not stuffed
  std::int8_t continues = -1;  ///< an earlier check with the same start and algorithm, whose register is continued
  std::uint8_t more_count = 0;
  std::array<CheckRange, max_check_ranges - 1> more{};  ///< in the order of the check, each outside the others
  Number run{};             ///< where it has only some bits of its bytes; `at`, `bytes` and `order` are then unused
  bool covers_run = false;  ///< a range holds the bytes of `run`, whose bits count as zeros
};

/// Place in a form of a number that is neither length nor id: a named field or a sequence number. Its bits are as on
/// the wire; their meaning is known elsewhere.
struct HeaderField {
  Number number{};
  std::uint64_t default_value = 0;  ///< of the sender
  std::uint8_t place = 0;           ///< index into the format's list of header fields, which is the same for all forms
  std::uint64_t fixed_mask = 0;     ///< bits that distinguish this form from others: they are constants, too,
  std::uint64_t fixed_value = 0;    ///< of these values
  bool is_magic = false;            ///< any form is acceptable if no value was given
};

/// The number that a condition compares, besides constants.
enum class Subject : std::uint8_t {
  field,  ///< a header field
  id,
  size,  ///< of the payload, before it is trimmed
};

/// Excludes the form for frames whose number is in [low, high].
struct Exclusion {
  Subject subject = Subject::field;
  std::uint8_t place = 0;  ///< index of a header field in the format's list
  bool on_receive = true;  ///< false: it only chooses the sender's form
  Number number{};         ///< where a receiver finds it, and which of its bits count; absent for the size
  std::uint64_t low = 0;
  std::uint64_t high = 0;
};

/// Header values of a frame to send: bits as on the wire, by index. Points to as many values as the format has header
/// fields; the caller keeps them alive during the call.
struct HeaderValues {
  const std::uint64_t* values = nullptr;  ///< null: the sender's defaults
  std::uint32_t given = 0;  ///< bit i: the sender asked for value i, so a form without that field is not used
};

/// Marks a missing header field, instead of an index.
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
/// (`suffix`). A format whose header varies (two magics, optional parts) has several forms, distinguished by their
/// constants.
struct Form {
  std::uint16_t prefix = 0;
  std::uint16_t suffix = 0;
  std::uint8_t prefix_constants = 0;  ///< this many of the first `constants` are in the prefix, by rising offset
  std::uint8_t constant_count = 0;
  std::uint8_t header_checks = 0;  ///< this many of the first `checks` cover and are in the prefix only
  std::uint8_t check_count = 0;
  PayloadSize payload_size = PayloadSize::fixed;
  std::uint8_t length_unit = 1;
  std::int32_t length_bias = 0;
  std::uint16_t fixed_payload = 0;
  std::uint8_t payload_unit = 1;  ///< a check refuses payloads whose size, divided by this, does not leave this rest:
  std::uint8_t payload_rest = 0;
  bool trims_zeros = false;  ///< zeros at the payload's end are not sent; the receiver restores them
  std::uint8_t header_count = 0;
  std::uint8_t first_exclusion = 0;  ///< index into FrameFormat::exclusions
  std::uint8_t exclusion_count = 0;
  Number length{};
  Number id{};
  std::uint32_t id_mask = 0;   ///< bits of the id that distinguish this form from others: they are constants, too,
  std::uint32_t id_value = 0;  ///< of these values
  std::array<Constant, max_constants> constants{};
  std::array<CheckRule, max_checks> checks{};
  std::array<HeaderField, max_header_fields> header{};
};

enum class Framing : std::uint8_t {
  by_start,   ///< a frame is found by its first constant and its size
  delimited,  ///< a frame is between two equal delimiters and cannot contain one; neighbours may share one
  bracketed,  ///< a frame is between an opening and a closing delimiter that differ
  silence,    ///< a frame is the bytes between two silences of the line
  sized,      ///< a frame is found by its first constant, and stuffed; its length gives its end
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
  hex,              ///< each byte is sent as two hex digits
  insertion,        ///< a byte is inserted after each occurrence of a certain sequence
  hex_after_digit,  ///< as hex, but the first byte, which is below 16, is sent as one digit
  decimal_check,    ///< the check at the end, big-endian, is sent in decimal digits; other bytes as they are
};

WIREBOND_INLINE constexpr bool is_hex(Stuffing stuffing) {
  return stuffing == Stuffing::hex || stuffing == Stuffing::hex_after_digit;
}

/// A forbidden byte is sent as `escape` and a code: its value xor `exclusive_or` or, if that is 0, the code beside it
/// in the table (SLIP). A receiver with `exclusive_or` takes any escaped byte (HDLC). If the escape is the first byte
/// of both delimiters it is doubled: its own code is the escape again (DLE).
struct EscapeRule {
  std::uint8_t escape = 0;
  std::uint8_t exclusive_or = 0;
  std::uint8_t count = 0;
  std::array<std::uint8_t, max_escapes> plain{};
  std::array<std::uint8_t, max_escapes> code{};
  std::uint8_t starts =
      0;  ///< this many of the first `plain` begin frames found by their start; none occurs inside a frame
};

/// After each occurrence of the bytes `after` in the stuffed part, `byte` is sent (Dynamixel 2.0: 0xFD after FF FF FD).
/// The sequence does not begin as it ends, so two of them never overlap.
struct InsertionRule {
  std::uint8_t size = 0;
  std::uint8_t byte = 0;
  std::array<std::uint8_t, max_insertion> after{};
};

/// Rules that hold for all forms of a format.
struct FormatRules {
  Framing framing = Framing::by_start;
  Stuffing stuffing = Stuffing::none;
  Mark opening{};             ///< delimiter before a frame
  Mark closing{};             ///< delimiter after it
  bool sends_opening = true;  ///< delimited: false where only the end of a frame is marked
  std::uint8_t form_count = 1;
  std::uint8_t own_forms = 1;  ///< the first of the forms: those that a sender chooses from by itself
  std::uint8_t algorithm_count = 0;
  bool deliver_unknown = false;    ///< unknown ids and other payload sizes are frames, not false starts
  bool skips_failed = false;       ///< a candidate that failed after its header is not searched again
  bool length_on_wire = false;     ///< sized: the length counts the bytes as they are sent, after stuffing
  std::uint8_t plain_front = 0;    ///< this many bytes before the stuffed ones are sent as they are
  std::uint8_t plain_back = 0;     ///< and this many after them
  std::uint8_t decimal_bytes = 0;  ///< with Stuffing::decimal_check: bytes of that check, at most 4
  std::uint8_t sequence_place = no_header_field;  ///< the header field that counts a sender's frames
  bool sequence_per_message = false;              ///< it counts those of each message
  std::uint8_t peer_place = no_header_field;      ///< the header field that identifies the sender
  std::uint16_t max_payload = 0;
  /// Id that Source::message is asked for, for a frame without an id. Where other frames of this sender have one, it is
  /// not 0 but a value that no message has as its id.
  std::uint32_t no_id = 0;
  std::array<CheckAlgorithm, max_algorithms> algorithms{};
  EscapeRule escapes{};
  InsertionRule insertion{};
};

/// A whole format with memory for `Forms` forms and `Exclusions` exclusions. A constant has only as many as it needs:
/// without optimisation all of it takes flash.
template <std::size_t Forms, std::size_t Exclusions>
struct SizedFormat : FormatRules {
  std::array<Form, Forms> forms{};
  std::array<Exclusion, Exclusions> exclusions{};  ///< of all forms
};

/// A format with memory for anything that a protocol file may say: for formats read at run time.
using FrameFormat = SizedFormat<max_forms, max_exclusions>;

/// Copy a format into one of maximum size.
template <class Format>
constexpr FrameFormat widened(const Format& format) {
  FrameFormat wide{};
  static_cast<FormatRules&>(wide) = format;
  for (std::size_t i = 0; i < format.forms.size(); ++i) wide.forms[i] = format.forms[i];
  for (std::size_t i = 0; i < format.exclusions.size(); ++i) wide.exclusions[i] = format.exclusions[i];
  return wide;
}

/// All that the deframer knows about a message: nothing about its fields.
struct MessageShape {
  std::int16_t index = -1;  ///< index in the protocol's table; -1: unknown id
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

/// Maximum number of bytes that COBS adds to `size` bytes (Cheshire and Baker 1999: one code byte per started 254
/// bytes).
WIREBOND_INLINE constexpr std::size_t cobs_overhead(std::size_t size) { return 1 + size / 254; }

/// Maximum number of decimal digits of a number of `bytes` bytes, at most 4.
WIREBOND_INLINE constexpr std::size_t decimal_digits(std::size_t bytes) {
  return bytes == 1 ? 3 : bytes == 2 ? 5 : bytes == 3 ? 8 : 10;
}

/// Maximum number of bytes that stuffing adds to a frame of `size` bytes.
WIREBOND_INLINE constexpr std::size_t stuffing_overhead(const FormatRules& format, std::size_t size) {
  switch (format.stuffing) {
    case Stuffing::cobs: return cobs_overhead(size);
    case Stuffing::escape:
    case Stuffing::hex:
    case Stuffing::hex_after_digit: return size;
    case Stuffing::insertion: return size / format.insertion.size;
    case Stuffing::decimal_check: return decimal_digits(format.decimal_bytes) - format.decimal_bytes;
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

/// Wire bytes that a sender reserves for a frame of this form: exact without stuffing, otherwise the worst case.
template <class Format>
WIREBOND_INLINE constexpr std::size_t wire_bytes(const Format& format, std::size_t payload_size,
                                                 std::size_t form_index = 0) {
  const Form& form = format.forms[form_index];
  const std::size_t payload = form.payload_size == PayloadSize::fixed ? form.fixed_payload : payload_size;
  const std::size_t frame = form.prefix + payload + form.suffix;
  return frame + delimiter_bytes(format) + stuffing_overhead(format, frame);
}

/// Check whether a frame of this form can have a payload of this size. A length must be able to express it; a form
/// without the length that others have carries no payload.
WIREBOND_INLINE constexpr bool carries(const Form& form, std::size_t payload) {
  if (form.payload_unit > 1 && payload % form.payload_unit != form.payload_rest) return false;
  if (form.payload_size == PayloadSize::fixed) return payload <= form.fixed_payload;
  if (form.payload_size != PayloadSize::by_length) return true;
  if (!form.length.present()) return payload == 0;
  const std::int64_t counted = static_cast<std::int64_t>(payload) - form.length_bias;
  return counted >= 0 && counted % form.length_unit == 0 && counted / form.length_unit <= form.length.most();
}

/// Maximum payload that the form's own size rule allows; the format's `max_payload` limits it, too.
WIREBOND_INLINE constexpr std::int64_t most_payload(const Form& form) {
  if (form.payload_size == PayloadSize::fixed) return form.fixed_payload;
  if (form.payload_size != PayloadSize::by_length) return 0xFFFF;
  return form.length.present() ? form.length.most() * form.length_unit + form.length_bias : 0;
}

/// Check whether `carries` holds for every size up to the format's maximum: then no code needs to call it.
WIREBOND_INLINE constexpr bool carries_all(const FormatRules& format, const Form& form) {
  if (form.payload_unit > 1) return false;
  if (form.payload_size != PayloadSize::by_length) return true;  // `seal` compares with a fixed size itself
  return form.length.present() && form.length_unit == 1 && form.length_bias <= 0 &&
         static_cast<std::int64_t>(format.max_payload) - form.length_bias <= form.length.most();
}

/// Check whether a frame of this form can carry message `id`: the id must fit. A form without an id carries only the
/// message `no_id`.
WIREBOND_INLINE constexpr bool carries_id(const FormatRules& format, const Form& form, std::uint32_t id) {
  if (!form.id.present()) return id == format.no_id;
  return (format.no_id == 0 || id != format.no_id) && id <= form.id.most() && (id & form.id_mask) == form.id_value;
}

/// Check whether these header values allow a frame of this form: it has every field that was given, and the bits that
/// distinguish it from other forms match. `Unroll`, `Most`: as for `every`.
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

/// Return the number of this header field; absent if the form lacks it.
WIREBOND_INLINE constexpr Number number_at(const Form& form, std::uint8_t place) {
  for (std::size_t i = 0; i < form.header_count; ++i) {
    if (form.header[i].place == place) return form.header[i].number;
  }
  return {};
}

/// Check whether an exclusion keeps a sender from this form, for message `id` with `payload` bytes before trimming.
/// `header` may be null: then the fields have their defaults, which the sender's own forms allow. `Unroll`, `Most`: as
/// for `every`.
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

/// Check whether a payload of this size, including the zeros cut from its end, breaks a condition of the form.
/// `Unroll`, `Most`: as for `every`.
template <bool Unroll = false, std::size_t Most = max_exclusions, class Format>
WIREBOND_INLINE constexpr bool size_is_excluded(const Format& format, const Form& form, std::size_t payload) {
  return !detail::every<Unroll, Most>(0, form.exclusion_count, [&](std::size_t i) WIREBOND_INLINE_LAMBDA {
    const Exclusion& exclusion = format.exclusions[form.first_exclusion + i];
    if (exclusion.subject != Subject::size || !exclusion.on_receive) return true;
    return payload < exclusion.low || exclusion.high < payload;
  });
}

/// Maximum number of bytes before the payload, over all forms.
template <class Format>
WIREBOND_INLINE constexpr std::size_t longest_prefix(const Format& format) {
  std::size_t longest = 0;
  for (std::size_t i = 0; i < format.form_count; ++i) {
    if (format.forms[i].prefix > longest) longest = format.forms[i].prefix;
  }
  return longest;
}

/// Return the byte that every frame begins with; -1 if there are several forms, or it is not entirely constant.
template <class Format>
WIREBOND_INLINE constexpr int one_start(const Format& format) {
  const Form& form = format.forms[0];
  const bool is_one = format.form_count == 1 && form.prefix_constants != 0 && form.constants[0].at.offset == 0 &&
                      form.constants[0].mask == 0xFF;
  return is_one ? form.constants[0].value : -1;
}

}  // namespace wirebond
