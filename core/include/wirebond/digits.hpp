// Whole numbers in characters: decimal digits with a point at a fixed place, or hex digits. No locale, no float.
#pragma once

#include <cstddef>
#include <cstdint>
#include <limits>
#include <type_traits>

#include "wirebond/bits.hpp"

namespace wirebond {

/// How a whole number is written. With `decimals`, a point comes before the last that many digits; `base` is 10 then.
struct Digits {
  std::uint8_t base = 10;
  std::uint8_t decimals = 0;
};

namespace detail {

/// A number without its sign.
template <class Wide>
struct Magnitude {
  static_assert(std::is_unsigned_v<Wide>, "the sign is apart");

  Wide amount = 0;
  bool negative = false;

  /// Append a digit. Returns false if there is no room for it.
  bool append(Digits digits, unsigned digit) {
    constexpr Wide most = std::numeric_limits<Wide>::max();
    if (amount > (digits.base == 16 ? most / 16 : most / 10)) return false;
    amount = static_cast<Wide>(amount * digits.base);
    if (amount > most - digit) return false;
    amount = static_cast<Wide>(amount + digit);
    return true;
  }
};

/// Return the value of a digit; `base` or more: it is none.
inline unsigned digit_of(std::uint8_t c) {
  return c >= '0' && c <= '9'   ? c - unsigned{'0'}
         : c >= 'A' && c <= 'F' ? c - 'A' + 10u
         : c >= 'a' && c <= 'f' ? c - 'a' + 10u
                                : 255u;
}

/// Read the number that these characters spell: blanks, a sign, digits and, with `decimals`, at most one point. Missing
/// decimals are zeros; further ones are rounded, halves away from zero. Returns false if they spell no number, or it is
/// too large.
template <class Wide>
bool read_magnitude(Digits digits, const std::uint8_t* from, std::size_t size, Magnitude<Wide>& number) {
  std::size_t i = 0;
  while (i < size && from[i] == ' ') ++i;
  if (i < size && (from[i] == '+' || (from[i] == '-' && digits.base == 10))) number.negative = from[i++] == '-';
  bool any = false;
  bool behind_point = false;
  bool rounds_up = false;
  unsigned taken = 0;  // decimals that are in the number
  bool has_more = false;
  for (; i < size; ++i) {
    if (from[i] == '.' && digits.decimals != 0 && !behind_point) {
      behind_point = true;
      continue;
    }
    const unsigned digit = digit_of(from[i]);
    if (digit >= digits.base) return false;
    any = true;
    if (taken < digits.decimals || !behind_point) {
      if (!number.append(digits, digit)) return false;
      taken += behind_point ? 1u : 0u;
    } else {
      if (!has_more) rounds_up = digit >= 5;
      has_more = true;
    }
  }
  if (!any) return false;
  for (; taken < digits.decimals; ++taken) {
    if (!number.append(digits, 0)) return false;
  }
  if (rounds_up) {
    number.amount = static_cast<Wide>(number.amount + 1);
    if (number.amount == 0) return false;
  }
  return true;
}

/// Return the number of characters of a number.
template <class Wide>
std::size_t size_of_magnitude(Digits digits, Magnitude<Wide> number) {
  std::size_t count = 0;
  for (; number.amount != 0; number.amount = static_cast<Wide>(number.amount / digits.base)) ++count;
  if (count < digits.decimals + 1u) count = digits.decimals + 1u;
  return count + (digits.decimals != 0 ? 1 : 0) + (number.negative ? 1 : 0);
}

/// Write the number as exactly `size` characters, at least `size_of_magnitude`: zeros come before the first digit.
template <class Wide>
void write_magnitude(Digits digits, std::uint8_t* to, std::size_t size, Magnitude<Wide> number) {
  if (number.negative) *to = '-';
  const std::size_t first = number.negative ? 1 : 0;
  for (std::size_t i = size, place = 0; i-- > first; ++place) {
    if (digits.decimals != 0 && place == digits.decimals) {
      to[i] = '.';
      continue;
    }
    to[i] = static_cast<std::uint8_t>("0123456789ABCDEF"[number.amount % digits.base]);
    number.amount = static_cast<Wide>(number.amount / digits.base);
  }
}

/// The unsigned type in which a number of `T` is read and written.
template <class T>
using WideOf = std::conditional_t<(sizeof(T) > 4), std::uint64_t, std::uint32_t>;

template <class T>
Magnitude<WideOf<T>> magnitude_of(T number) {
  using Wide = WideOf<T>;
  if constexpr (std::is_signed_v<T>) {
    if (number < 0) return {static_cast<Wide>(Wide{0} - static_cast<Wide>(number)), true};
  }
  return {static_cast<Wide>(number), false};
}

}  // namespace detail

/// Read a number of `Width` bits from `size` characters. Returns false if they spell none, or one that `Width` bits do
/// not hold; `number` is then unchanged. Any thread or interrupt.
template <class T, unsigned Width, std::uint8_t Base, std::uint8_t Decimals>
bool read_digits(const std::uint8_t* from, std::size_t size, T& number) {
  static_assert(std::is_integral_v<T> && Width <= 8 * sizeof(T), "the number needs room for its bits");
  using Wide = detail::WideOf<T>;
  detail::Magnitude<Wide> found;
  if (!detail::read_magnitude({Base, Decimals}, from, size, found)) return false;
  if constexpr (std::is_signed_v<T>) {
    constexpr Wide most = static_cast<Wide>(low_bits(Width) >> 1);
    if (found.amount > most + (found.negative ? 1u : 0u)) return false;
    const auto amount = static_cast<std::int64_t>(found.amount);
    number = static_cast<T>(found.negative ? -amount : amount);
  } else {
    if (found.amount > low_bits(Width) || found.negative) return false;
    number = static_cast<T>(found.amount);
  }
  return true;
}

/// Return how many characters a number has.
template <std::uint8_t Base, std::uint8_t Decimals, class T>
std::size_t digits_size(T number) {
  return detail::size_of_magnitude({Base, Decimals}, detail::magnitude_of(number));
}

/// Write a number as exactly `size` characters, with zeros before its digits. Returns false if it has more of them;
/// nothing is written then. Any thread or interrupt.
template <std::uint8_t Base, std::uint8_t Decimals, class T>
bool write_digits(std::uint8_t* to, std::size_t size, T number) {
  const auto magnitude = detail::magnitude_of(number);
  if (detail::size_of_magnitude({Base, Decimals}, magnitude) > size) return false;
  detail::write_magnitude({Base, Decimals}, to, size, magnitude);
  return true;
}

}  // namespace wirebond
