// Numbers of any width and coding: inside a string of bits, with their sign in the top bit, or in decimal digits. For
// binary numbers of whole bytes see bytes.hpp.
#pragma once

#include <cstddef>
#include <cstdint>
#include <cstring>
#include <type_traits>

#include "wirebond/bytes.hpp"

namespace wirebond {

/// Which bit of each byte comes first in a string of bits.
enum class BitOrder : std::uint8_t { low_first, high_first };

/// Return a value whose lowest `bits` (1 to 64) bits are set.
constexpr std::uint64_t low_bits(unsigned bits) { return ~std::uint64_t{0} >> (64 - bits); }

/// Read the number of `width` (1 to 64) bits that begins `bit` bits after `from`. Bytes without a bit of it are not
/// read. The first bit is the number's lowest if `order` is low_first, otherwise its highest.
WIREBOND_INLINE std::uint64_t load_bits(const std::uint8_t* from, std::size_t bit, unsigned width, BitOrder order) {
  const std::uint8_t* byte = from + bit / 8;
  unsigned skipped = static_cast<unsigned>(bit % 8);
  std::uint64_t value = 0;
  for (unsigned done = 0; done < width; ++byte) {
    const unsigned rest = width - done;
    const unsigned taken = rest < 8 - skipped ? rest : 8 - skipped;
    if (order == BitOrder::low_first) {
      value |= ((static_cast<std::uint64_t>(*byte) >> skipped) & low_bits(taken)) << done;
    } else {
      value = (value << taken) | ((static_cast<std::uint64_t>(*byte) >> (8 - skipped - taken)) & low_bits(taken));
    }
    done += taken;
    skipped = 0;
  }
  return value;
}

/// Store a number; pairs with `load_bits`. Bits beside the number keep their value. Bits of `value` above `width` are
/// dropped.
WIREBOND_INLINE void store_bits(std::uint8_t* to, std::size_t bit, unsigned width, BitOrder order,
                                std::uint64_t value) {
  std::uint8_t* byte = to + bit / 8;
  unsigned skipped = static_cast<unsigned>(bit % 8);
  for (unsigned done = 0; done < width; ++byte) {
    const unsigned rest = width - done;
    const unsigned taken = rest < 8 - skipped ? rest : 8 - skipped;
    const bool low = order == BitOrder::low_first;
    const unsigned place = low ? skipped : 8 - skipped - taken;
    const std::uint64_t part = (low ? value >> done : value >> (rest - taken)) & low_bits(taken);
    *byte = static_cast<std::uint8_t>((*byte & ~(low_bits(taken) << place)) | (part << place));
    done += taken;
    skipped = 0;
  }
}

/// Return the number that the lowest `width` bits of `raw` hold in two's complement.
constexpr std::int64_t from_twos_complement(std::uint64_t raw, unsigned width) {
  return static_cast<std::int64_t>(raw << (64 - width)) >> (64 - width);
}

/// Return the number whose sign is bit `width` - 1 of `raw` and whose magnitude is in the bits below. Minus zero is
/// zero.
constexpr std::int64_t from_sign_magnitude(std::uint64_t raw, unsigned width) {
  const auto amount = static_cast<std::int64_t>(raw & (low_bits(width) >> 1));
  return ((raw >> (width - 1)) & 1) != 0 ? -amount : amount;
}

/// Return 10 to the power of the number of decimal digits, of four bits each, in `width` bits.
constexpr std::uint64_t bcd_end(unsigned width) {
  std::uint64_t end = 1;
  for (; width >= 4; width -= 4) end *= 10;
  return end;
}

/// Return the number whose decimal digits are the lowest `width` (4 to 60) bits of `raw`, four bits each, the highest
/// first. If one of them is above 9, this is not a number, and the result is `bcd_end`, which is above all of them.
constexpr std::uint64_t from_bcd(std::uint64_t raw, unsigned width) {
  std::uint64_t number = 0;
  for (unsigned place = width; place >= 4; place -= 4) {
    const std::uint64_t digit = (raw >> (place - 4)) & 0xF;
    if (digit > 9) return bcd_end(width);
    number = 10 * number + digit;
  }
  return number;
}

/// Return the decimal digits of a number, four bits each; pairs with `from_bcd`.
constexpr std::uint64_t to_bcd(std::uint64_t number) {
  std::uint64_t raw = 0;
  for (unsigned place = 0; number != 0; place += 4, number /= 10) raw |= (number % 10) << place;
  return raw;
}

/// Coding of a whole number: its value, two's complement if signed; sign and magnitude; or decimal digits.
enum class Coding : std::uint8_t { binary, sign_magnitude, bcd };

/// Return the number in the lowest `Width` bits of `raw`; higher bits are ignored.
template <class T, unsigned Width, Coding Encoding = Coding::binary>
constexpr T from_bits(std::uint64_t raw) {
  static_assert(std::is_integral_v<T> && Width <= 8 * sizeof(T), "the number needs room for its bits");
  if constexpr (Encoding == Coding::bcd) {
    return static_cast<T>(from_bcd(raw, Width));
  } else if constexpr (std::is_unsigned_v<T>) {
    return static_cast<T>(raw & low_bits(Width));
  } else if constexpr (Encoding == Coding::sign_magnitude) {
    return static_cast<T>(from_sign_magnitude(raw, Width));
  } else {
    return static_cast<T>(from_twos_complement(raw, Width));
  }
}

/// Encode `value`; pairs with `from_bits`. Returns false if it does not fit; `raw` is then unchanged.
template <unsigned Width, Coding Encoding = Coding::binary, class T>
constexpr bool to_bits(T value, std::uint64_t& raw) {
  static_assert(std::is_integral_v<T> && Width <= 8 * sizeof(T), "the number needs room for its bits");
  if constexpr (Encoding == Coding::bcd) {
    if (value >= bcd_end(Width)) return false;
    raw = to_bcd(value);
  } else if constexpr (std::is_unsigned_v<T>) {
    if (value > low_bits(Width)) return false;
    raw = value;
  } else {
    const auto wide = static_cast<std::int64_t>(value);
    constexpr auto most = static_cast<std::int64_t>(low_bits(Width) >> 1);
    constexpr std::int64_t least = Encoding == Coding::sign_magnitude ? -most : -most - 1;
    if (wide > most || wide < least) return false;
    const std::uint64_t bits = static_cast<std::uint64_t>(wide) & low_bits(Width);
    if constexpr (Encoding == Coding::sign_magnitude) {
      raw = wide < 0 ? (std::uint64_t{1} << (Width - 1)) | static_cast<std::uint64_t>(-wide) : bits;
    } else {
      raw = bits;
    }
  }
  return true;
}

/// Return the number in the lowest `width` bits of `raw`, in two's complement of 64 bits: `from_bits` for a coding that
/// only run time knows.
constexpr std::uint64_t number_of_bits(std::uint64_t raw, unsigned width, Coding coding, bool is_signed) {
  switch (coding) {
    case Coding::bcd: return from_bcd(raw, width);
    case Coding::sign_magnitude: return static_cast<std::uint64_t>(from_sign_magnitude(raw, width));
    case Coding::binary: break;
  }
  return is_signed ? static_cast<std::uint64_t>(from_twos_complement(raw, width)) : raw & low_bits(width);
}

/// Return the bits of a number that fits; pairs with `number_of_bits`.
constexpr std::uint64_t bits_of_number(std::uint64_t number, unsigned width, Coding coding) {
  const bool is_negative = static_cast<std::int64_t>(number) < 0;
  switch (coding) {
    case Coding::bcd: return to_bcd(number);
    case Coding::sign_magnitude: return is_negative ? (std::uint64_t{1} << (width - 1)) | (0 - number) : number;
    case Coding::binary: break;
  }
  return number & low_bits(width);
}

/// Read number `index` of a packed stream of numbers of `Width` bits that begins at `from`.
template <class T, unsigned Width, BitOrder Order, Coding Encoding = Coding::binary>
WIREBOND_INLINE T load_packed(const std::uint8_t* from, std::size_t index) {
  return from_bits<T, Width, Encoding>(load_bits(from, index * Width, Width, Order));
}

/// Store a number; pairs with `load_packed`. Returns false if `value` does not fit; nothing is stored then.
template <unsigned Width, BitOrder Order, Coding Encoding = Coding::binary, class T>
WIREBOND_INLINE bool store_packed(std::uint8_t* to, std::size_t index, T value) {
  std::uint64_t raw = 0;
  if (!to_bits<Width, Encoding>(value, raw)) return false;
  store_bits(to, index * Width, Width, Order, raw);
  return true;
}

/// Return the number of `Width` bits whose lowest is bit `Shift` of `bits`.
template <class T, unsigned Width, unsigned Shift, Coding Encoding = Coding::binary, class Bits>
constexpr T extract_bits(Bits bits) {
  return from_bits<T, Width, Encoding>(static_cast<std::uint64_t>(bits) >> Shift);
}

/// Insert a number into bits that are zero there; pairs with `extract_bits`. Returns false if `value` does not fit;
/// nothing is changed then.
template <unsigned Width, unsigned Shift, Coding Encoding = Coding::binary, class Bits, class T>
constexpr bool insert_bits(Bits& bits, T value) {
  std::uint64_t raw = 0;
  if (!to_bits<Width, Encoding>(value, raw)) return false;
  bits = static_cast<Bits>(bits | (raw << Shift));
  return true;
}

/// Pieces, two or more, of a number whose bits are in several places: place and width of each, the lowest first.
template <unsigned... PlacesAndWidths>
struct Pieces {
  static constexpr std::size_t size = sizeof...(PlacesAndWidths);
  static constexpr unsigned values[size] = {PlacesAndWidths...};

  static constexpr unsigned width() {
    unsigned sum = 0;
    for (std::size_t i = 1; i < size; i += 2) sum += values[i];
    return sum;
  }

  static constexpr std::uint64_t gather(std::uint64_t bits) {
    std::uint64_t raw = 0;
    unsigned done = 0;
    for (std::size_t i = 0; i < size; i += 2) {
      raw |= ((bits >> values[i]) & low_bits(values[i + 1])) << done;
      done += values[i + 1];
    }
    return raw;
  }

  static constexpr std::uint64_t scatter(std::uint64_t raw) {
    std::uint64_t bits = 0;
    unsigned done = 0;
    for (std::size_t i = 0; i < size; i += 2) {
      bits |= ((raw >> done) & low_bits(values[i + 1])) << values[i];
      done += values[i + 1];
    }
    return bits;
  }
};

/// Return the number whose pieces are at these places of `bits`: place and width of each, the lowest piece first.
template <class T, Coding Encoding, unsigned... PlacesAndWidths, class Bits>
constexpr T extract_split(Bits bits) {
  using Places = Pieces<PlacesAndWidths...>;
  return from_bits<T, Places::width(), Encoding>(Places::gather(static_cast<std::uint64_t>(bits)));
}

/// Insert a number into bits that are zero there; pairs with `extract_split`. Returns false if `value` does not fit;
/// nothing is changed then.
template <Coding Encoding, unsigned... PlacesAndWidths, class Bits, class T>
constexpr bool insert_split(Bits& bits, T value) {
  using Places = Pieces<PlacesAndWidths...>;
  std::uint64_t raw = 0;
  if (!to_bits<Places::width(), Encoding>(value, raw)) return false;
  bits = static_cast<Bits>(bits | Places::scatter(raw));
  return true;
}

/// Read a number of whole bytes that is not plain binary; otherwise as load_integer of bytes.hpp.
template <Coding Encoding, class T, ByteOrder Order = ByteOrder::little, unsigned Bytes = sizeof(T)>
WIREBOND_INLINE T load_coded(const std::uint8_t* from) {
  return from_bits<T, 8 * Bytes, Encoding>(load_bytes<Bytes, Order>(from));
}

/// Store a number; pairs with `load_coded`. Returns false if `value` does not fit; nothing is stored then.
template <Coding Encoding, class T, ByteOrder Order = ByteOrder::little, unsigned Bytes = sizeof(T)>
WIREBOND_INLINE bool store_coded(std::uint8_t* to, T value) {
  std::uint64_t raw = 0;
  if (!to_bits<8 * Bytes, Encoding>(value, raw)) return false;
  store_bytes(to, raw, Bytes, Order);
  return true;
}

}  // namespace wirebond
