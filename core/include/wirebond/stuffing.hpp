// Byte stuffing only: taking a delimiter's value out of a run of bytes, and putting it back.
#pragma once

#include <cstddef>
#include <cstdint>
#include <cstring>

#include "wirebond/bytes.hpp"

namespace wirebond {

/// Consistent Overhead Byte Stuffing (Cheshire and Baker, IEEE/ACM Transactions on Networking 7(2), 1999), in place.
/// `buffer[0]` is free, the data lies in buffer[1 .. size]; room for cobs_overhead(size) more bytes in all.
/// Returns the stuffed size; the result holds no zero.
inline std::size_t cobs_encode_in_place(std::uint8_t* buffer, std::size_t size) {
  std::size_t code_at = 0;
  std::size_t end = 1 + size;
  for (std::size_t i = 1; i < end; ++i) {
    if (i - code_at == 0xFF) {  // a full block of 254 bytes: its code stands for no zero, so a new one is put in
      buffer[code_at] = 0xFF;
      std::memmove(buffer + i + 1, buffer + i, end - i);
      ++end;
      code_at = i;
      continue;
    }
    if (buffer[i] == 0) {
      buffer[code_at] = static_cast<std::uint8_t>(i - code_at);
      code_at = i;
    }
  }
  buffer[code_at] = static_cast<std::uint8_t>(end - code_at);
  return end;
}

/// Undo it: `size` bytes without a zero at `from`, at most `capacity` bytes to `to`.
/// Returns the size, or -1 where a code points past the end or the result does not fit.
inline std::ptrdiff_t cobs_decode(const std::uint8_t* from, std::size_t size, std::uint8_t* to, std::size_t capacity) {
  std::size_t at = 0;
  std::size_t out = 0;
  while (at < size) {
    const std::size_t code = from[at];
    if (code == 0 || code > size - at) return -1;
    const std::size_t run = code - 1;
    if (run > capacity - out) return -1;
    std::memcpy(to + out, from + at + 1, run);
    out += run;
    at += code;
    if (code != 0xFF && at < size) {
      if (out == capacity) return -1;
      to[out++] = 0;
    }
  }
  return static_cast<std::ptrdiff_t>(out);
}

}  // namespace wirebond
