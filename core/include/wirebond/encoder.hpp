// Completes a frame around a payload that is already in place: constants, length, id, checks, stuffing.
#pragma once

#include <cstddef>
#include <cstdint>
#include <cstring>

#include "wirebond/format.hpp"
#include "wirebond/placed_number.hpp"
#include "wirebond/source.hpp"
#include "wirebond/stuffing.hpp"
#include "wirebond/unroll.hpp"

namespace wirebond {

/// Offset of the frame's first byte in its buffer before it is stuffed.
WIREBOND_INLINE constexpr std::size_t frame_lead(const FormatRules& format) {
  return opening_bytes(format) + (format.stuffing == Stuffing::cobs ? 1 : 0);
}

/// Offset in the frame's buffer at which the payload must be written, so that `seal` can finish the frame without
/// moving it.
template <class Source>
WIREBOND_INLINE constexpr std::size_t payload_lead(const Source& source, std::size_t form = 0) {
  return frame_lead(source.format()) + source.format().forms[form].prefix;
}

namespace detail {

inline void write_hex(std::uint8_t* digits, std::uint64_t value, unsigned bytes) {
  for (unsigned i = 2 * bytes; i-- > 0; value >>= 4) {
    digits[i] = static_cast<std::uint8_t>("0123456789ABCDEF"[value & 0xFu]);
  }
}

/// Write a mark. Returns its size.
WIREBOND_INLINE std::size_t write_mark(const Mark& mark, std::uint8_t* to) {
  to[0] = mark.first;
  if (mark.size == 2) to[1] = mark.second;
  return mark.size;
}

/// Put the delimiters around `size` bytes that follow the place of the opening one. Returns the size on the wire.
WIREBOND_INLINE std::size_t enclose(const FormatRules& format, std::uint8_t* buffer, std::size_t size) {
  if (!has_marks(format)) return size;
  const std::size_t opening = opening_bytes(format);
  if (opening != 0) write_mark(format.opening, buffer);
  return opening + size + write_mark(format.closing, buffer + opening + size);
}

/// Write the length of a frame with `payload` bytes, including bytes that stuffing added if it counts them. Returns
/// false if the length cannot express them.
WIREBOND_INLINE bool write_length(const Form& form, std::uint8_t* frame, std::size_t size, std::size_t payload) {
  const std::int64_t counted = static_cast<std::int64_t>(payload) - form.length_bias;
  write_number(form.length, frame, size, static_cast<std::uint64_t>(counted / form.length_unit));
  return counted <= form.length.most();
}

/// Bytes that the check's places refer to.
template <class Source>
WIREBOND_INLINE std::size_t covered_by([[maybe_unused]] const Form& form, [[maybe_unused]] std::size_t index,
                                       std::size_t size) {
  if constexpr (part_counts<Source>.header_checks != 0) {
    if (index < form.header_checks) return form.prefix;
  }
  return size;
}

/// Write a check over the range of `frame` that its rule gives, or over the bytes as they are sent.
template <class Source>
WIREBOND_INLINE void write_check(const Source& source, const Form& form, std::size_t index, std::uint8_t* frame,
                                 std::size_t size, std::uint32_t id, CheckRegisters<Source>& registers) {
  constexpr PartCounts most = part_counts<Source>;
  const CheckRule& rule = form.checks[index];
  const std::size_t covered = covered_by<Source>(form, index, size);
  std::size_t from = rule.from.in(covered);
  std::uint64_t reg = begin_of(source, rule.algorithm);
  if constexpr (most.is_continued) {
    if (rule.continues >= 0) {
      const std::size_t earlier = static_cast<std::size_t>(rule.continues);
      reg = registers.of[earlier];
      from = form.checks[earlier].to.in(covered_by<Source>(form, earlier, size));
    }
  }
  if constexpr (most.is_in_bits) {
    if (rule.run.present()) clear_number(rule.run, frame, covered);  // of a frame that is closed again
    reg = over_range(source, rule, reg, frame, from, rule.to.in(covered), covered);
  } else {
    reg = source.check_update(rule.algorithm, reg, frame + from, rule.to.in(covered)-from);
  }
  if constexpr (most.more_ranges != 0) reg = over_more_ranges(source, rule, reg, frame, covered);
  if constexpr (most.is_continued) registers.of[index] = reg;
  if constexpr (most.is_seeded) {
    if (rule.seeded) {
      const std::uint8_t seed = source.message(id).seed;
      reg = source.check_update(rule.algorithm, reg, &seed, 1);
    }
  }
  if constexpr (most.is_in_bits) {
    if (rule.run.present()) {
      return write_number(rule.run, frame, covered, end_of(source, rule.algorithm, reg) >> rule.shift);
    }
  }
  const std::uint64_t value = (end_of(source, rule.algorithm, reg) >> rule.shift) & mask_of(8u * rule.bytes);
  std::uint8_t* const at = frame + rule.at.in(covered);
  if constexpr (most.is_hex) {
    if (rule.as_hex) return write_hex(at, value, rule.bytes);
  }
  store_bytes(at, value, rule.bytes, rule.order);
}

/// Write all checks over the frame or, if `on_wire`, those over the bytes as they are sent.
template <class Source>
WIREBOND_INLINE void write_checks(const Source& source, const Form& form, [[maybe_unused]] bool on_wire,
                                  std::uint8_t* bytes, std::size_t size, std::uint32_t id,
                                  CheckRegisters<Source>& registers) {
  constexpr PartCounts most = part_counts<Source>;
  if constexpr (most.checks == 1 && !most.is_on_wire) {  // as in most formats
    if (form.check_count != 0) write_check(source, form, 0, bytes, size, id, registers);
  } else {
    every<Source::is_constant, most.checks>(0, form.check_count, [&](std::size_t i) WIREBOND_INLINE_LAMBDA {
      if constexpr (most.is_on_wire) {
        if (form.checks[i].on_wire != on_wire) return true;
      }
      write_check(source, form, i, bytes, size, id, registers);
      return true;
    });
  }
}

}  // namespace detail

/// Do the first half of `seal`: everything that does not depend on the frame's number. Writes constants, header fields,
/// length and id around the payload; checks, stuffing and delimiters are left to `close_frame`, but memory for them is
/// checked as `seal` does. `size` becomes the frame's size without them. Returns false where `seal` makes no frame.
template <class Source>
WIREBOND_INLINE bool lay_out_frame(const Source& source, std::uint8_t* buffer, std::size_t capacity, std::uint32_t id,
                                   std::size_t payload_size, std::size_t form_index, const std::uint64_t* header,
                                   std::size_t& size) {
  constexpr bool unroll = Source::is_constant;
  const auto& format = source.format();
  const Form& form = format.forms[form_index];
  std::uint8_t* const frame = buffer + frame_lead(format);

  [[maybe_unused]] const std::size_t whole_payload = payload_size;
  std::size_t payload = payload_size;
  if (form.payload_size == PayloadSize::fixed) payload = form.fixed_payload;
  if (form.trims_zeros) {  // one byte remains, as receivers of such formats expect
    while (payload > 1 && frame[form.prefix + payload - 1] == 0) --payload;
    payload_size = payload;
  }
  size = form.prefix + payload + form.suffix;
  const std::size_t on_wire = size + stuffing_overhead(format, size) + delimiter_bytes(format);
  const bool is_nothing = size == 0 && format.framing != Framing::bracketed && format.stuffing != Stuffing::cobs;
  if (payload_size > payload || payload > format.max_payload || on_wire > capacity || is_nothing) return false;
  if (!carries_id(format, form, id) || (!carries_all(format, form) && !carries(form, payload))) return false;
  constexpr std::size_t exclusions = detail::part_counts<Source>.exclusions;
  if constexpr (exclusions != 0) {
    if (is_excluded<unroll, exclusions>(format, form, id, whole_payload, header)) return false;
  }

  std::memset(frame, 0, form.prefix);
  std::memset(frame + form.prefix + payload_size, 0, payload - payload_size + form.suffix);
  detail::every<unroll, detail::part_counts<Source>.constants>(0, form.constant_count,
                                                               [&](std::size_t i) WIREBOND_INLINE_LAMBDA {
                                                                 const Constant& constant = form.constants[i];
                                                                 frame[constant.at.in(size)] |= constant.value;
                                                                 return true;
                                                               });
  detail::every<unroll, detail::part_counts<Source>.header_fields>(
      0, form.header_count, [&](std::size_t i) WIREBOND_INLINE_LAMBDA {
        const HeaderField& field = form.header[i];
        const std::uint64_t value = header != nullptr ? header[field.place] : field.default_value;
        detail::write_number(field.number, frame, size, value & ~field.fixed_mask);
        return true;
      });
  if (form.length.present() && !format.length_on_wire) detail::write_length(form, frame, size, payload);
  if (form.id.present()) detail::write_number(form.id, frame, size, id);
  return true;
}

/// Do the second half of `seal`: checks, stuffing and delimiters for the `size` bytes from `lay_out_frame`, whose
/// number may have been changed since. Returns the size on the wire.
template <class Source>
WIREBOND_INLINE std::size_t close_frame(const Source& source, std::uint8_t* buffer, std::size_t size, std::uint32_t id,
                                        std::size_t form_index = 0) {
  const auto& format = source.format();
  const Form& form = format.forms[form_index];
  std::uint8_t* const frame = buffer + frame_lead(format);
  detail::CheckRegisters<Source> registers{};
  detail::write_checks(source, form, false, frame, size, id, registers);
  std::size_t between = size;
  if constexpr (detail::may_be_stuffed<Source>()) between = stuff_in_place(source, frame, size);
  if constexpr (detail::may_be<Source>(Framing::sized)) {
    if (format.length_on_wire) {
      detail::clear_number(form.length, frame, size);  // a frame that is closed again still has its old one
      if (!detail::write_length(form, frame, size, between - form.prefix - form.suffix)) return 0;
    }
  }
  if constexpr (detail::part_counts<Source>.is_on_wire) {
    detail::write_checks(source, form, true, buffer + opening_bytes(format), between, id, registers);
  }
  return detail::enclose(format, buffer, between);
}

/// Finishes a written frame: whole here, or waiting for its number (numbering.hpp).
struct Sealed {
  template <class Source>
  WIREBOND_INLINE static std::size_t end(const Source& source, std::uint8_t* buffer, std::size_t capacity,
                                         std::uint32_t id, std::size_t payload_size, std::size_t form_index,
                                         const std::uint64_t* header = nullptr) {
    if constexpr (!Source::is_constant) {
      const std::size_t size = form_index == 0 ? source.fast_path().seal(buffer, capacity, id, payload_size) : 0;
      if (size != 0) return size;
    }
    std::size_t size = 0;
    if (!lay_out_frame(source, buffer, capacity, id, payload_size, form_index, header, size)) return 0;
    return close_frame(source, buffer, size, id, form_index);
  }
};

/// Finish the frame for message `id` whose `payload_size` bytes are at buffer + payload_lead. Formats with a fixed
/// payload are padded with zeros. `header` holds a value for each header field of the format, by index; the form takes
/// those that it has; null: the defaults. Returns the size on the wire, or 0 if no frame was made, because
/// - it does not fit in `capacity`,
/// - the form cannot carry it: the payload's size does not fit in its length, the id does not fit, only one of form and
///   message has an id, or a condition of the form excludes it,
/// - it would have no byte at all, which a receiver cannot distinguish from fill or silence.
/// Any thread or interrupt; no allocation.
template <class Source>
WIREBOND_INLINE std::size_t seal(const Source& source, std::uint8_t* buffer, std::size_t capacity, std::uint32_t id,
                                 std::size_t payload_size, std::size_t form_index = 0,
                                 const std::uint64_t* header = nullptr) {
  return Sealed::end(source, buffer, capacity, id, payload_size, form_index, header);
}

}  // namespace wirebond
