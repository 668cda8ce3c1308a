// A frame that waits for its sequence number: laid out, without number, checks and stuffing. No queue, no counter.
#pragma once

#include <cstddef>
#include <cstdint>

#include "wirebond/encoder.hpp"
#include "wirebond/examine.hpp"
#include "wirebond/format.hpp"
#include "wirebond/placed_number.hpp"
#include "wirebond/source.hpp"
#include "wirebond/stuffing.hpp"
#include "wirebond/unroll.hpp"

namespace wirebond {

namespace detail {

/// Check whether the frame, if it is of this form, gives its payload this many bytes. Forms with the same constants may
/// differ in their sizes. A length that counts stuffed bytes is not compared, because no part of such
/// a frame has a condition.
template <class Source>
WIREBOND_INLINE bool says_size(const Source& source, const Form& form, const std::uint8_t* frame, std::size_t size,
                               std::size_t payload) {
  if (form.payload_size == PayloadSize::fixed) return payload == form.fixed_payload;
  if (form.payload_size == PayloadSize::by_length && !source.format().length_on_wire) {
    const std::int64_t counted = read_number(form.length, frame, size);
    return counted * form.length_unit + form.length_bias == static_cast<std::int64_t>(payload);
  }
  if constexpr (may_have<Source>(PayloadSize::by_id)) {
    if (form.payload_size == PayloadSize::by_id) {
      const std::uint32_t id = form.id.present() ? read_number(form.id, frame, size) : 0;
      const MessageShape shape = shape_of(source, form, id, frame, 0, 0);
      if constexpr (HasPayloadRules<Source>::value) {
        if (shape.known() && shape.min_payload != shape.max_payload) {
          const ToldSize told = told_size<CountsBytes<Source>::value>(
              source.payload_rules(shape.index), frame + form.prefix, size - form.prefix, shape.min_payload);
          return told.is_told && payload == told.size;
        }
      }
      return payload == shape.max_payload;
    }
  }
  return true;
}

}  // namespace detail

/// Find the form of a frame as `lay_out_frame` made it, or as it was unstuffed: the first whose constants match, none
/// of whose exclusions holds, and whose payload has the size that the frame says. If zeros at the payload's end were
/// cut, its size excludes nothing: such forms differ in other bytes.
template <class Source>
WIREBOND_INLINE std::size_t form_of(const Source& source, const std::uint8_t* frame, std::size_t size) {
  constexpr bool unroll = Source::is_constant;
  constexpr detail::PartCounts most = detail::part_counts<Source>;
  const auto& format = source.format();
  std::size_t found = 0;
  detail::every<unroll, most.forms>(0, format.form_count, [&](std::size_t i) WIREBOND_INLINE_LAMBDA {
    const Form& form = format.forms[i];
    found = i;
    if (i + 1u == format.form_count) return false;  // the only one left
    if (size < std::size_t{form.prefix} + form.suffix) return true;
    const auto stands = [&](std::size_t c) WIREBOND_INLINE_LAMBDA {
      const Constant& constant = form.constants[c];
      return (frame[constant.at.in(size)] & constant.mask) == constant.value;
    };
    const auto allows = [&](std::size_t e) WIREBOND_INLINE_LAMBDA {
      const Exclusion& exclusion = format.exclusions[form.first_exclusion + e];
      if (exclusion.subject == Subject::size || !exclusion.number.present()) return true;
      const std::uint64_t value = detail::read_wide(exclusion.number, frame, size);
      return value < exclusion.low || value > exclusion.high;
    };
    const std::size_t payload = size - form.prefix - form.suffix;
    if constexpr (most.exclusions != 0) {
      if (!form.trims_zeros && size_is_excluded<unroll, most.exclusions>(format, form, payload)) return true;
      if (!detail::says_size(source, form, frame, size, payload)) return true;
    }
    return !(detail::every<unroll, most.constants>(0, form.constant_count, stands) &&
             detail::every<unroll, most.exclusions>(0, form.exclusion_count, allows));
  });
  return found;
}

/// Return the place of the sequence number in a frame of this form; absent if it has none.
template <class Source>
WIREBOND_INLINE Number sequence_number(const Source& source, std::size_t form_index) {
  if constexpr (detail::folds<Source>(0)) {
    return detail::field_numbers<Source, Source{}.format().sequence_place>[form_index];
  } else {
    return number_at(source.format().forms[form_index], source.format().sequence_place);
  }
}

/// Write the number into the laid-out frame of `size` bytes at buffer + frame_lead, if its form has one, and close the
/// frame. Returns the size on the wire. `next()` returns the number; it is called only for a frame that has one.
template <class Source, class Next>
WIREBOND_INLINE std::size_t close_numbered(const Source& source, std::uint8_t* buffer, std::size_t size, Next&& next) {
  const auto& format = source.format();
  std::uint8_t* const frame = buffer + frame_lead(format);
  const std::size_t taken = form_of(source, frame, size);
  std::size_t on_wire = 0;
  detail::every<Source::is_constant, detail::part_counts<Source>.forms>(
      0, format.form_count, [&](std::size_t i) WIREBOND_INLINE_LAMBDA {
        if (i != taken) return true;
        const Form& form = format.forms[i];
        const Number number = sequence_number(source, i);
        if (number.present()) {
          detail::clear_number(number, frame, size);
          detail::write_number(number, frame, size, next());
        }
        const std::uint32_t id = form.id.present() ? detail::read_number(form.id, frame, size) : format.no_id;
        on_wire = close_frame(source, buffer, size, id, i);
        return false;
      });
  return on_wire;
}

/// Return how many bytes a laid-out frame of `size` bytes takes in a queue until `waiting_size` and `close_numbered`
/// read it there: enough for its number, checks, stuffing and delimiters, and never more than `wire_bytes`. If stuffing
/// depends on the bytes, they are counted here, and the size is stored after the frame.
template <class Source>
WIREBOND_INLINE std::size_t set_aside(const Source& source, std::uint8_t* buffer, std::size_t size,
                                      std::size_t form_index) {
  const auto& format = source.format();
  if (format.stuffing != Stuffing::escape) return size + delimiter_bytes(format) + stuffing_overhead(format, size);
  const Form& form = format.forms[form_index];
  std::size_t added = size;  // bytes after the stuffed part move while it is stuffed, so this much is needed
  if (format.plain_back == 0) {
    added = sequence_number(source, form_index).bytes + escapes_needed(detail::escapes_of(source),
                                                                       buffer + frame_lead(format) + format.plain_front,
                                                                       size - format.plain_front);
    for (std::size_t i = 0; i < form.check_count; ++i)
      added += form.checks[i].bytes * (form.checks[i].as_hex ? 2u : 1u);
    if (added == 0) added = 1;  // for the size, with a delimiter
    if (added > size) added = size;
  }
  const std::size_t room = size + delimiter_bytes(format) + added;
  store_bytes(buffer + room - 2, size, 2, ByteOrder::little);
  return room;
}

/// Replaces `Sealed`: the frame waits in a queue, which later closes it with `waiting_size` and `close_numbered`.
struct Waiting {
  template <class Source>
  WIREBOND_INLINE static std::size_t end(const Source& source, std::uint8_t* buffer, std::size_t capacity,
                                         std::uint32_t id, std::size_t payload_size, std::size_t form_index,
                                         const std::uint64_t* header = nullptr) {
    std::size_t size = 0;
    if (!lay_out_frame(source, buffer, capacity, id, payload_size, form_index, header, size)) return 0;
    return set_aside(source, buffer, size, form_index);
  }
};

/// Return the size of a laid-out frame that takes `room` bytes in the queue.
WIREBOND_INLINE std::size_t waiting_size(const FormatRules& format, const std::uint8_t* buffer, std::size_t room) {
  if (format.stuffing == Stuffing::escape)
    return static_cast<std::size_t>(load_bytes(buffer + room - 2, 2, ByteOrder::little));
  const std::size_t size = room - delimiter_bytes(format);
  if (format.stuffing == Stuffing::none) return size;
  if (is_hex(format.stuffing)) return size / 2;
  if (format.stuffing == Stuffing::decimal_check) return size - stuffing_overhead(format, size);
  if (format.stuffing == Stuffing::insertion) return size - size / (format.insertion.size + 1u);
  return size - 1 - (size - 1) / 255;  // COBS: 1 + size / 254 more
}

}  // namespace wirebond
