// Closing a frame around a payload that already lies in place: constants, length, id, checks, stuffing.
#pragma once

#include <cstddef>
#include <cstdint>
#include <cstring>

#include "wirebond/format.hpp"
#include "wirebond/stuffing.hpp"

namespace wirebond {

/// Where in the frame's buffer the payload is written, so that `seal` can finish the frame without moving it.
template <class Source>
WIREBOND_INLINE constexpr std::size_t payload_lead(const Source& source) {
  const FrameFormat& format = source.format();
  const std::size_t opening = format.framing == Framing::delimited ? 1 : 0;
  const std::size_t code = format.stuffing == Stuffing::cobs ? 1 : 0;
  return opening + code + format.layouts[0].prefix;
}

/// Finish the frame for message `id` whose `payload_size` bytes lie at buffer + payload_lead. Formats with a fixed
/// payload are padded with zeros. Returns the size on the wire, 0 when the frame does not fit `capacity` or the format.
/// Any thread or interrupt; no allocation.
template <class Source>
WIREBOND_INLINE std::size_t seal(const Source& source, std::uint8_t* buffer, std::size_t capacity, std::uint32_t id,
                                 std::size_t payload_size) {
  constexpr bool unroll = Source::is_constant;
  const FrameFormat& format = source.format();
  const Layout& layout = format.layouts[0];
  const bool delimited = format.framing == Framing::delimited;
  const std::size_t lead = payload_lead(source);
  std::uint8_t* const frame = buffer + lead - layout.prefix;

  std::size_t payload = payload_size;
  if (layout.payload_size == PayloadSize::fixed) payload = layout.fixed_payload;
  const std::size_t size = layout.prefix + payload + layout.suffix;
  const std::size_t on_wire =
      size + (delimited ? 2u : 0u) + (format.stuffing == Stuffing::cobs ? cobs_overhead(size) : 0u);
  if (payload_size > payload || payload > format.max_payload || on_wire > capacity) return 0;

  std::memset(frame, 0, layout.prefix);
  std::memset(frame + layout.prefix + payload_size, 0, payload - payload_size + layout.suffix);
  detail::every<unroll, max_constants>(0, layout.constant_count, [&](std::size_t i) WIREBOND_INLINE_LAMBDA {
    const Constant& constant = layout.constants[i];
    frame[constant.at.in(size)] |= constant.value;
    return true;
  });
  const auto put = [&](const Number& number, std::uint32_t value) WIREBOND_INLINE_LAMBDA {
    std::uint8_t* const at = frame + number.at.in(size);
    const std::uint64_t bits = static_cast<std::uint64_t>(value & number.mask) << number.shift;
    for (unsigned i = 0; i < number.bytes; ++i) {
      const unsigned place = number.order == ByteOrder::little ? i : number.bytes - 1u - i;
      at[i] |= static_cast<std::uint8_t>(bits >> (8 * place));
    }
  };
  if (layout.length.present()) {
    const std::int64_t length = (static_cast<std::int64_t>(payload) - layout.length_bias) / layout.length_unit;
    put(layout.length, static_cast<std::uint32_t>(length));
  }
  if (layout.id.present()) put(layout.id, id);

  std::uint64_t registers[max_checks] = {};
  detail::every<unroll, max_checks>(0, layout.check_count, [&](std::size_t i) WIREBOND_INLINE_LAMBDA {
    const CheckRule& rule = layout.checks[i];
    const CheckAlgorithm& algorithm = format.algorithms[rule.algorithm];
    const std::size_t covered = i < layout.header_checks ? layout.prefix : size;
    std::size_t from = rule.from.in(covered);
    std::uint64_t reg = check_begin(algorithm);
    if (rule.continues >= 0) {
      const std::size_t earlier = static_cast<std::size_t>(rule.continues);
      reg = registers[earlier];
      from = layout.checks[earlier].to.in(earlier < layout.header_checks ? layout.prefix : size);
    }
    reg = source.check_update(rule.algorithm, reg, frame + from, rule.to.in(covered)-from);
    registers[i] = reg;
    store_bytes(frame + rule.at.in(covered), check_end(algorithm, reg) >> rule.shift, rule.bytes, rule.order);
    return true;
  });

  if (!delimited) return size;
  std::size_t stuffed = size;
  if (format.stuffing == Stuffing::cobs) stuffed = cobs_encode_in_place(frame - 1, size);
  buffer[0] = format.delimiter;
  buffer[1 + stuffed] = format.delimiter;
  return stuffed + 2;
}

}  // namespace wirebond
