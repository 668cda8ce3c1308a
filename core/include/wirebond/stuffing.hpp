// Byte stuffing only: removes a delimiter's value from a run of bytes, and restores it.
#pragma once

#include <cstddef>
#include <cstdint>
#include <cstring>

#include "wirebond/bytes.hpp"
#include "wirebond/format.hpp"
#include "wirebond/source.hpp"

namespace wirebond {

/// Encode with Consistent Overhead Byte Stuffing (Cheshire and Baker, IEEE/ACM Transactions on Networking 7(2), 1999),
/// in place. `buffer[0]` is free, the data is in buffer[1 .. size]; the buffer has cobs_overhead(size) bytes more in
/// all. Returns the stuffed size; the result holds no zero.
inline std::size_t cobs_encode_in_place(std::uint8_t* buffer, std::size_t size) {
  std::size_t code_at = 0;
  std::size_t end = 1 + size;
  for (std::size_t i = 1; i < end; ++i) {
    if (i - code_at == 0xFF) {  // a full block of 254 bytes: its code stands for no zero, so a new code is inserted
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

/// Decode `size` bytes without a zero at `from`, writing at most `capacity` bytes to `to`. Returns the size, or -1 if a
/// code points past the end or the result does not fit.
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

/// Count the bytes that `escape_in_place` will add.
inline std::size_t escapes_needed(const EscapeRule& rule, const std::uint8_t* bytes, std::size_t size) {
  std::size_t count = 0;
  for (std::size_t i = 0; i < size; ++i) {
    for (std::size_t j = 0; j < rule.count; ++j) count += bytes[i] == rule.plain[j] ? 1 : 0;
  }
  return count;
}

/// Escape `size` bytes at `buffer`, which has escapes_needed bytes more. Returns the stuffed size.
inline std::size_t escape_in_place(const EscapeRule& rule, std::uint8_t* buffer, std::size_t size) {
  const std::size_t stuffed = size + escapes_needed(rule, buffer, size);
  std::size_t to = stuffed;
  for (std::size_t from = size; from-- > 0 && to != from + 1;) {  // from the end, so that nothing is overwritten unread
    const std::uint8_t byte = buffer[from];
    buffer[--to] = byte;
    for (std::size_t j = 0; j < rule.count; ++j) {
      if (byte != rule.plain[j]) continue;
      buffer[to] = rule.exclusive_or != 0 ? static_cast<std::uint8_t>(byte ^ rule.exclusive_or) : rule.code[j];
      buffer[--to] = rule.escape;
      break;
    }
  }
  return stuffed;
}

/// Undo `escape_in_place`. Returns the size, or -1 if an escape is the last byte, its code is not in the rule, or the
/// result does not fit.
inline std::ptrdiff_t unescape(const EscapeRule& rule, const std::uint8_t* from, std::size_t size, std::uint8_t* to,
                               std::size_t capacity) {
  std::size_t out = 0;
  for (std::size_t i = 0; i < size; ++i) {
    std::uint8_t byte = from[i];
    if (byte == rule.escape) {
      if (++i == size) return -1;
      byte = from[i];
      if (rule.exclusive_or != 0) {
        byte = static_cast<std::uint8_t>(byte ^ rule.exclusive_or);
      } else {
        std::size_t j = 0;
        while (j < rule.count && rule.code[j] != byte) ++j;
        if (j == rule.count) return -1;
        byte = rule.plain[j];
      }
    }
    if (out == capacity) return -1;
    to[out++] = byte;
  }
  return static_cast<std::ptrdiff_t>(out);
}

/// Replace `size` bytes at `buffer`, which can hold twice as many, by their hex digits. Returns the number of digits.
inline std::size_t hex_in_place(std::uint8_t* buffer, std::size_t size) {
  for (std::size_t i = size; i-- > 0;) {  // from the end, so that nothing is overwritten unread
    const std::uint8_t byte = buffer[i];
    buffer[2 * i] = static_cast<std::uint8_t>("0123456789ABCDEF"[byte >> 4]);
    buffer[2 * i + 1] = static_cast<std::uint8_t>("0123456789ABCDEF"[byte & 0xF]);
  }
  return 2 * size;
}

/// Return the value of a hex digit of either case; -1: not a digit.
inline int hex_digit(std::uint8_t c) {
  return c >= '0' && c <= '9'   ? c - '0'
         : c >= 'A' && c <= 'F' ? c - 'A' + 10
         : c >= 'a' && c <= 'f' ? c - 'a' + 10
                                : -1;
}

/// Undo `hex_in_place`. Returns the size, or -1 if a digit is missing or invalid, or the result does not fit.
inline std::ptrdiff_t unhex(const std::uint8_t* from, std::size_t size, std::uint8_t* to, std::size_t capacity) {
  if (size % 2 != 0 || size / 2 > capacity) return -1;
  for (std::size_t i = 0; i < size / 2; ++i) {
    const int high = hex_digit(from[2 * i]);
    const int low = hex_digit(from[2 * i + 1]);
    if (high < 0 || low < 0) return -1;
    to[i] = static_cast<std::uint8_t>(high << 4 | low);
  }
  return static_cast<std::ptrdiff_t>(size / 2);
}

/// The same for a first byte of one digit.
inline std::size_t hex_after_digit_in_place(std::uint8_t* buffer, std::size_t size) {
  const std::size_t digits = hex_in_place(buffer, size);
  if (digits == 0) return 0;
  std::memmove(buffer, buffer + 1, digits - 1);
  return digits - 1;
}

/// Undo `hex_after_digit_in_place`, as `unhex` does.
inline std::ptrdiff_t unhex_after_digit(const std::uint8_t* from, std::size_t size, std::uint8_t* to,
                                        std::size_t capacity) {
  if (size == 0) return 0;
  const int digit = hex_digit(from[0]);
  if (digit < 0 || capacity == 0) return -1;
  to[0] = static_cast<std::uint8_t>(digit);
  const std::ptrdiff_t rest = unhex(from + 1, size - 1, to + 1, capacity - 1);
  return rest < 0 ? -1 : rest + 1;
}

/// Replace the number in the last `bytes` of the `size` bytes at `buffer`, which has room for its digits, by its
/// decimal digits, without leading zeros. Returns the new size.
inline std::size_t decimal_check_in_place(std::uint8_t* buffer, std::size_t size, std::uint8_t bytes) {
  auto number = static_cast<std::uint32_t>(load_bytes(buffer + size - bytes, bytes, ByteOrder::big));
  std::size_t digits = 1;
  for (std::uint32_t rest = number / 10; rest != 0; rest /= 10) ++digits;
  const std::size_t end = size - bytes + digits;
  for (std::size_t i = 1; i <= digits; ++i, number /= 10)
    buffer[end - i] = static_cast<std::uint8_t>('0' + number % 10);
  return end;
}

/// Undo `decimal_check_in_place`. Takes leading zeros up to the longest number. Returns the size, or -1 if there are no
/// digits at the end, their number has more bytes, or the result does not fit.
inline std::ptrdiff_t undecimal_check(const std::uint8_t* from, std::size_t size, std::uint8_t bytes, std::uint8_t* to,
                                      std::size_t capacity) {
  const std::size_t most = decimal_digits(bytes) < size ? decimal_digits(bytes) : size;
  std::size_t digits = 0;
  while (digits < most && from[size - digits - 1] >= '0' && from[size - digits - 1] <= '9') ++digits;
  const std::size_t begin = size - digits;
  std::uint64_t number = 0;
  for (std::size_t i = begin; i < size; ++i) number = 10 * number + (from[i] - std::uint64_t{'0'});
  if (digits == 0 || number >> (8u * bytes) != 0 || begin + bytes > capacity) return -1;
  if (begin != 0) std::memcpy(to, from, begin);
  store_bytes(to + begin, number, bytes, ByteOrder::big);
  return static_cast<std::ptrdiff_t>(begin + bytes);
}

/// Check whether the `size` bytes at `bytes` end with the rule's sequence.
inline bool ends_with(const InsertionRule& rule, const std::uint8_t* bytes, std::size_t size) {
  if (size < rule.size) return false;
  for (std::size_t i = 0; i < rule.size; ++i) {
    if (bytes[size - rule.size + i] != rule.after[i]) return false;
  }
  return true;
}

/// Insert the rule's byte where needed among `size` bytes at `buffer`, which is large enough. Returns the new size.
inline std::size_t insert_in_place(const InsertionRule& rule, std::uint8_t* buffer, std::size_t size) {
  std::size_t stuffed = size;
  for (std::size_t i = 1; i <= size; ++i) stuffed += ends_with(rule, buffer, i) ? 1 : 0;
  std::size_t to = stuffed;
  for (std::size_t from = size; from != to; --from) {  // until all remaining bytes stay in place
    if (ends_with(rule, buffer, from)) buffer[--to] = rule.byte;
    buffer[--to] = buffer[from - 1];
  }
  return stuffed;
}

/// Undo `insert_in_place`. Returns the size, or -1 if an inserted byte is missing, or the result does not fit.
inline std::ptrdiff_t uninsert(const InsertionRule& rule, const std::uint8_t* from, std::size_t size, std::uint8_t* to,
                               std::size_t capacity) {
  std::size_t out = 0;
  for (std::size_t i = 0; i < size; ++i) {
    if (out == capacity) return -1;
    to[out++] = from[i];
    if (ends_with(rule, to, out) && (++i == size || from[i] != rule.byte)) return -1;
  }
  return static_cast<std::ptrdiff_t>(out);
}

/// Stuff the frame of `size` bytes at `frame`, except bytes that are sent as they are. The buffer has stuffing_overhead
/// bytes more, under COBS the first of them before the frame. Returns the stuffed size; under COBS the result begins at
/// frame - 1.
template <class Source>
WIREBOND_INLINE std::size_t stuff_in_place(const Source& source, std::uint8_t* frame, std::size_t size) {
  const auto& format = source.format();
  if (format.stuffing == Stuffing::none) return size;
  const std::size_t front = format.plain_front;
  const std::size_t back = format.plain_back;
  const std::size_t inner = size - front - back;
  std::uint8_t* const begin = frame + front;
  const std::size_t code = format.stuffing == Stuffing::cobs ? 1 : 0;  // its first byte goes before the others
  std::uint8_t* const kept = begin + inner + stuffing_overhead(format, inner) - code;  // after all that is written
  if (back != 0) std::memmove(kept, begin + inner, back);
  std::size_t stuffed;
  if (format.stuffing == Stuffing::cobs) {
    if (front != 0) std::memmove(frame - code, frame, front);
    stuffed = cobs_encode_in_place(begin - code, inner);
  } else if (format.stuffing == Stuffing::hex) {
    stuffed = hex_in_place(begin, inner);
  } else if (format.stuffing == Stuffing::hex_after_digit) {
    stuffed = hex_after_digit_in_place(begin, inner);
  } else if (format.stuffing == Stuffing::decimal_check) {
    stuffed = decimal_check_in_place(begin, inner, format.decimal_bytes);
  } else if (format.stuffing == Stuffing::insertion) {
    stuffed = insert_in_place(detail::insertion_of(source), begin, inner);
  } else {
    stuffed = escape_in_place(detail::escapes_of(source), begin, inner);
  }
  if (back != 0) std::memmove(begin - code + stuffed, kept, back);
  return front + stuffed + back;
}

/// Undo the stuffing of a block of `size` bytes; `to` holds max_wire_bytes. Returns the size, or -1 if stuffing cannot
/// produce these bytes.
template <class Source>
WIREBOND_INLINE std::ptrdiff_t unstuff(const Source& source, const std::uint8_t* block, std::size_t size,
                                       std::uint8_t* to) {
  const auto& format = source.format();
  const std::size_t front = format.plain_front;
  const std::size_t back = format.plain_back;
  if (size < front + back) return -1;
  const std::size_t inner = size - front - back;
  const std::size_t room = detail::of_format<max_wire_bytes<detail::FormatOf<Source>>>(source) - front - back;
  const std::ptrdiff_t result = format.stuffing == Stuffing::cobs  ? cobs_decode(block + front, inner, to + front, room)
                                : format.stuffing == Stuffing::hex ? unhex(block + front, inner, to + front, room)
                                : format.stuffing == Stuffing::hex_after_digit
                                    ? unhex_after_digit(block + front, inner, to + front, room)
                                : format.stuffing == Stuffing::decimal_check
                                    ? undecimal_check(block + front, inner, format.decimal_bytes, to + front, room)
                                : format.stuffing == Stuffing::insertion
                                    ? uninsert(detail::insertion_of(source), block + front, inner, to + front, room)
                                    : unescape(detail::escapes_of(source), block + front, inner, to + front, room);
  if (result < 0) return -1;
  if (front != 0) std::memcpy(to, block, front);
  if (back != 0) std::memcpy(to + front + result, block + front + inner, back);
  return result + static_cast<std::ptrdiff_t>(front + back);
}

}  // namespace wirebond
