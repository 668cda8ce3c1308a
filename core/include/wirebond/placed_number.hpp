// Reads and writes the numbers of a frame's own parts, such as length and id.
#pragma once

#include <cstddef>
#include <cstdint>

#include "wirebond/format.hpp"

namespace wirebond::detail {

/// Set a number's bits to zero and keep the other bits of its bytes.
WIREBOND_INLINE void clear_number(const Number& number, std::uint8_t* frame, std::size_t frame_size) {
  std::uint8_t* const at = frame + number.at.in(frame_size);
  const std::uint64_t bits = number.mask << number.shift;
  for (unsigned i = 0; i < number.bytes; ++i) {
    const unsigned place = number.order == ByteOrder::little ? i : number.bytes - 1u - i;
    at[i] = static_cast<std::uint8_t>(at[i] & ~static_cast<std::uint8_t>(bits >> (8 * place)));
  }
}

/// Merge a number into bytes whose bits are zero there.
WIREBOND_INLINE void write_number(const Number& number, std::uint8_t* frame, std::size_t frame_size,
                                  std::uint64_t value) {
  std::uint8_t* const at = frame + number.at.in(frame_size);
  const std::uint64_t bits = (value & number.mask) << number.shift;
  for (unsigned i = 0; i < number.bytes; ++i) {
    const unsigned place = number.order == ByteOrder::little ? i : number.bytes - 1u - i;
    at[i] = static_cast<std::uint8_t>(at[i] | static_cast<std::uint8_t>(bits >> (8 * place)));
  }
}

/// Read a number of up to 64 bits.
WIREBOND_INLINE std::uint64_t read_wide(const Number& number, const std::uint8_t* frame, std::size_t frame_size) {
  const std::uint8_t* const at = frame + number.at.in(frame_size);
  std::uint64_t value = 0;
  switch (number.bytes) {  // constant widths let the compiler use one load
    case 1: value = at[0]; break;
    case 2:
      value = number.order == ByteOrder::little ? load<std::uint16_t>(at) : load<std::uint16_t, ByteOrder::big>(at);
      break;
    case 4:
      value = number.order == ByteOrder::little ? load<std::uint32_t>(at) : load<std::uint32_t, ByteOrder::big>(at);
      break;
    default: value = load_bytes(at, number.bytes, number.order); break;
  }
  return (value >> number.shift) & number.mask;
}

/// Read a number of up to 32 bits, such as an id or a length.
WIREBOND_INLINE std::uint32_t read_number(const Number& number, const std::uint8_t* frame, std::size_t frame_size) {
  return static_cast<std::uint32_t>(read_wide(number, frame, frame_size));
}

}  // namespace wirebond::detail
