// Check algorithms only: how a register runs over bytes. The place of a check in a frame belongs to format.hpp.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <type_traits>

#include "wirebond/bits.hpp"
#include "wirebond/bytes.hpp"

namespace wirebond {

enum class CheckKind : std::uint8_t {
  crc,  ///< any cyclic redundancy check, given by the parameters of the Rocksoft model
  sum,  ///< sum of bytes modulo 2^width
  exclusive_or,
  fletcher,  ///< two sums of width/2 bits, the second of the first's values; the first is the low half
};

/// Treatment of bytes after the last whole word, if the unit of a check is a word.
enum class OddTail : std::uint8_t {
  pad,           ///< zero bytes complete the word
  exclusive_or,  ///< each byte is combined with the register as a number of its own
  refuse,        ///< no value fits: the frame is refused, and not sent
};

/// Values from `low` to `high` that a check of one byte must not have on the wire.
struct AvoidedValues {
  std::uint8_t low;
  std::uint8_t high;
};

/// Maximum number of ranges of values that a check avoids.
constexpr std::size_t max_avoided = 4;

/// One algorithm, by parameters. CRC parameters follow Williams' "A Painless Guide to CRC Error Detection Algorithms"
/// (1993), as in the reveng catalogue: `poly` and `init` are written most significant bit first.
struct CheckAlgorithm {
  CheckKind kind = CheckKind::crc;
  std::uint8_t width_bits = 16;  ///< 8 to 64 of a CRC; up to 32 of others, and of all whose unit is a word
  bool reflect_in = false;
  bool reflect_out = false;
  std::uint64_t poly = 0;
  std::uint64_t init = 0;
  std::uint64_t xor_out = 0;
  std::uint16_t modulus = 0;  ///< of a sum, and of both of Fletcher's; 0: 2^width and 2^(width/2)
  bool negate = false;        ///< two's complement of the value, before `plus`
  std::uint8_t unit = 1;      ///< bytes of a word: 1, 2 or 4
  bool unit_is_little = false;
  OddTail odd_tail = OddTail::pad;
  bool end_around = false;     ///< sum: a carry out of the highest bit is added to the lowest one
  std::uint64_t plus = 0;      ///< added before `keep`
  std::uint64_t keep = ~0ull;  ///< bits of the value that are kept, before xor_out
  bool bcd = false;            ///< of a sum: in decimal digits of four bits each, after xor_out
  std::uint8_t avoided_count = 0;
  std::uint8_t avoided_plus = 0;  ///< added, once, to a value that is to be avoided
  std::array<AvoidedValues, max_avoided> avoided{};
};

namespace detail {

WIREBOND_INLINE constexpr std::uint64_t mask_of(unsigned bits) {
  return bits >= 64 ? ~std::uint64_t{0} : (std::uint64_t{1} << bits) - 1;
}

/// Reverse the order of the low `bits` bits. Without a loop, so that compilers fold it for a constant.
WIREBOND_INLINE constexpr std::uint64_t reflect(std::uint64_t value, unsigned bits) {
  value = ((value >> 1) & 0x5555555555555555u) | ((value & 0x5555555555555555u) << 1);
  value = ((value >> 2) & 0x3333333333333333u) | ((value & 0x3333333333333333u) << 2);
  value = ((value >> 4) & 0x0F0F0F0F0F0F0F0Fu) | ((value & 0x0F0F0F0F0F0F0F0Fu) << 4);
  value = ((value >> 8) & 0x00FF00FF00FF00FFu) | ((value & 0x00FF00FF00FF00FFu) << 8);
  value = ((value >> 16) & 0x0000FFFF0000FFFFu) | ((value & 0x0000FFFF0000FFFFu) << 16);
  return ((value >> 32) | (value << 32)) >> (64 - bits);
}

/// Return entry `index` of the byte table. A reflected register keeps its first bit lowest, a plain one highest.
constexpr std::uint64_t crc_table_entry(unsigned index, unsigned width, std::uint64_t poly, bool reflected) {
  if (reflected) {
    const std::uint64_t reversed = reflect(poly, width);
    std::uint64_t reg = index;
    for (unsigned bit = 0; bit < 8; ++bit) reg = (reg & 1u) ? (reg >> 1) ^ reversed : reg >> 1;
    return reg;
  }
  const std::uint64_t top = std::uint64_t{1} << (width - 1);
  std::uint64_t reg = static_cast<std::uint64_t>(index) << (width - 8);
  for (unsigned bit = 0; bit < 8; ++bit) reg = (reg & top) ? (reg << 1) ^ poly : reg << 1;
  return reg & mask_of(width);
}

template <unsigned Width>
struct RegisterOf {
  using type = typename UnsignedOf<(Width <= 8 ? 1 : Width <= 16 ? 2 : Width <= 32 ? 4 : 8)>::type;
};

/// The byte table in read-only memory: 256 entries of the register's width (512 bytes for a CRC-16).
template <unsigned Width, std::uint64_t Poly, bool Reflected>
struct CrcTable {
  using Entry = typename RegisterOf<Width>::type;
  struct Entries {
    Entry at[256];  // with std::array each byte would cost two calls without optimisation
  };
  static constexpr Entries make() {
    Entries table{};
    for (unsigned i = 0; i < 256; ++i) table.at[i] = static_cast<Entry>(crc_table_entry(i, Width, Poly, Reflected));
    return table;
  }
  static constexpr Entries value = make();
};

}  // namespace detail

/// Return the register before the first byte.
WIREBOND_INLINE constexpr std::uint64_t check_begin(const CheckAlgorithm& a) {
  if (a.kind == CheckKind::crc && a.reflect_in) return detail::reflect(a.init, a.width_bits);
  return a.init & detail::mask_of(a.width_bits);
}

namespace detail {

WIREBOND_INLINE constexpr bool reflects_end(const CheckAlgorithm& a) {
  return a.kind == CheckKind::crc && a.reflect_in != a.reflect_out;
}

/// Do the part of `check_end` from the reflection to the final exclusive-or.
WIREBOND_INLINE constexpr std::uint64_t check_finish(const CheckAlgorithm& a, std::uint64_t reg) {
  if (a.negate) reg = ~reg + 1;
  return (((reg + a.plus) & a.keep) ^ a.xor_out) & mask_of(a.width_bits);
}

/// Check whether the sent value differs from the computed one in form: digits, or a replacement.
WIREBOND_INLINE constexpr bool is_sent_otherwise(const CheckAlgorithm& a) { return a.bcd || a.avoided_count != 0; }

/// Return the sent form of a value: its decimal digits, or a replacement.
WIREBOND_INLINE constexpr std::uint64_t sent_for(const CheckAlgorithm& a, std::uint64_t value) {
  if (a.bcd) value = to_bcd(value) & mask_of(a.width_bits);
  for (std::size_t i = 0; i < a.avoided_count; ++i) {
    const bool is_avoided = a.avoided[i].low <= value && value <= a.avoided[i].high;
    if (is_avoided) return (value + a.avoided_plus) & mask_of(a.width_bits);
  }
  return value;
}

/// Check whether a check ends with an exclusive-or with `xor_out`, and nothing else.
WIREBOND_INLINE constexpr bool finishes_plainly(const CheckAlgorithm& a) {
  return !a.negate && a.plus == 0 && (a.keep & mask_of(a.width_bits)) == mask_of(a.width_bits) && !is_sent_otherwise(a);
}

/// Take one number: a byte or a word. Not for CRCs.
WIREBOND_INLINE constexpr std::uint32_t sum_step(const CheckAlgorithm& a, std::uint32_t reg, std::uint32_t number) {
  switch (a.kind) {
    case CheckKind::exclusive_or: return reg ^ number;
    case CheckKind::fletcher: {
      const unsigned half = a.width_bits / 2u;
      const std::uint32_t modulus = a.modulus != 0 ? a.modulus : std::uint32_t{1} << half;
      const std::uint32_t first = ((reg & static_cast<std::uint32_t>(mask_of(half))) + number) % modulus;
      const std::uint32_t second = ((reg >> half) + first) % modulus;
      return (second << half) | first;
    }
    case CheckKind::sum:
    case CheckKind::crc: break;
  }
  std::uint64_t sum = std::uint64_t{reg} + number;
  if (a.end_around) {
    while ((sum >> a.width_bits) != 0) sum = (sum & mask_of(a.width_bits)) + (sum >> a.width_bits);
  }
  return static_cast<std::uint32_t>(a.modulus != 0 ? sum % a.modulus : sum);
}

// Where the unit is a word, a register of up to 32 bits has those bytes above it that are not a whole word yet: three
// at most, the first one lowest, and their number in the highest eight bits. So it goes on from any byte.

WIREBOND_INLINE constexpr unsigned waiting_bytes(std::uint64_t reg) { return static_cast<unsigned>(reg >> 56); }

/// Call step(register, word) for each word; `word` has the first byte lowest.
template <class Step>
WIREBOND_INLINE std::uint64_t by_words(const CheckAlgorithm& a, std::uint64_t reg, const std::uint8_t* bytes,
                                       std::size_t size, Step&& step) {
  std::uint32_t value = static_cast<std::uint32_t>(reg);
  std::uint32_t word = static_cast<std::uint32_t>(reg >> 32) & 0xFFFFFFu;
  unsigned waiting = waiting_bytes(reg);
  for (std::size_t i = 0; i < size; ++i) {
    word |= static_cast<std::uint32_t>(bytes[i]) << (8 * waiting);
    if (++waiting < a.unit) continue;
    value = step(value, word);
    word = 0;
    waiting = 0;
  }
  return (std::uint64_t{waiting} << 56) | (std::uint64_t{word} << 32) | value;
}

/// Return the number that a word is in its byte order.
WIREBOND_INLINE constexpr std::uint32_t number_of(const CheckAlgorithm& a, std::uint32_t word) {
  if (a.unit_is_little) return word;
  std::uint32_t number = 0;
  for (unsigned i = 0; i < a.unit; ++i) number = (number << 8) | ((word >> (8 * i)) & 0xFFu);
  return number;
}

/// Return the bytes of a word in the order in which a CRC takes them: as the word's bits enter, its highest first, or
/// its lowest if they are reflected.
struct OrderedBytes {
  std::uint8_t at[4];
};
WIREBOND_INLINE constexpr OrderedBytes ordered(const CheckAlgorithm& a, std::uint32_t word) {
  const std::uint32_t number = number_of(a, word);
  OrderedBytes bytes{};
  for (unsigned i = 0; i < a.unit; ++i) {
    bytes.at[i] = static_cast<std::uint8_t>(number >> (8 * (a.reflect_in ? i : a.unit - 1u - i)));
  }
  return bytes;
}

/// Run a CRC over one byte, bit by bit.
WIREBOND_INLINE constexpr std::uint64_t crc_bits(const CheckAlgorithm& a, std::uint64_t reg, std::uint8_t byte) {
  const std::uint64_t poly = a.reflect_in ? reflect(a.poly, a.width_bits) : a.poly;
  const std::uint64_t top = std::uint64_t{1} << (a.width_bits - 1);
  reg ^= a.reflect_in ? std::uint64_t{byte} : std::uint64_t{byte} << (a.width_bits - 8);
  for (unsigned bit = 0; bit < 8; ++bit) {
    if (a.reflect_in) {
      reg = (reg & 1u) != 0 ? (reg >> 1) ^ poly : reg >> 1;
    } else {
      reg = (reg & top) != 0 ? (reg << 1) ^ poly : reg << 1;
    }
  }
  return reg & mask_of(a.width_bits);
}

/// Process the bytes of an incomplete word, as `odd_tail` defines.
WIREBOND_INLINE constexpr std::uint64_t end_words(const CheckAlgorithm& a, std::uint64_t reg) {
  const unsigned waiting = waiting_bytes(reg);
  std::uint32_t word = static_cast<std::uint32_t>(reg >> 32) & 0xFFFFFFu;
  reg &= 0xFFFFFFFFu;
  if (waiting == 0) return reg & mask_of(a.width_bits);
  if (a.odd_tail == OddTail::exclusive_or) {
    for (; word != 0; word >>= 8) reg ^= word & 0xFFu;
  } else if (a.kind == CheckKind::crc) {
    const OrderedBytes bytes = ordered(a, word);
    for (unsigned i = 0; i < a.unit; ++i) reg = crc_bits(a, reg, bytes.at[i]);
  } else {
    reg = sum_step(a, static_cast<std::uint32_t>(reg), number_of(a, word));
  }
  return reg & mask_of(a.width_bits);
}

}  // namespace detail

/// Return the check's value, computed from the register after the last byte.
WIREBOND_INLINE constexpr std::uint64_t check_end(const CheckAlgorithm& a, std::uint64_t reg) {
  if (a.unit > 1) reg = detail::end_words(a, reg);
  if (detail::reflects_end(a)) reg = detail::reflect(reg, a.width_bits);
  reg = detail::check_finish(a, reg);
  return detail::is_sent_otherwise(a) ? detail::sent_for(a, reg) : reg;
}

/// Check whether the register has an incomplete word that `odd_tail` refuses.
WIREBOND_INLINE constexpr bool is_refused(const CheckAlgorithm& a, std::uint64_t reg) {
  return a.unit > 1 && a.odd_tail == OddTail::refuse && detail::waiting_bytes(reg) != 0;
}

namespace detail {

/// Runs the register of a CRC of up to 32 bits over bytes, with its byte table. A plain register is held at the top of
/// 32 bits.
template <unsigned Width, std::uint64_t Poly, bool Reflected>
struct CrcRun {
  using Table = CrcTable<Width, Poly, Reflected>;
  static constexpr unsigned spare = Reflected ? 0 : 32 - Width;

  WIREBOND_INLINE static std::uint32_t step(std::uint32_t reg) {
    if constexpr (Reflected) {
      return (reg >> 8) ^ Table::value.at[reg & 0xFFu];
    } else {
      return (reg << 8) ^ (static_cast<std::uint32_t>(Table::value.at[reg >> 24]) << spare);
    }
  }

  WIREBOND_INLINE static std::uint32_t over_byte(std::uint32_t reg, std::uint8_t byte) {
    return step(reg ^ (static_cast<std::uint32_t>(byte) << (Reflected ? 0 : 24)));
  }

  /// Take four bytes at once: a register is linear, so bytes may be added before it reaches them, above it where it is
  /// narrower.
  WIREBOND_INLINE static std::uint32_t over_word(std::uint32_t reg, const std::uint8_t* bytes) {
    constexpr ByteOrder order = Reflected ? ByteOrder::little : ByteOrder::big;
    reg ^= load<std::uint32_t, order>(bytes);
    return step(step(step(step(reg))));
  }

  /// Take `size` bytes, with less than four instructions per byte on a Cortex-M4. Not inlined: among a deframer's
  /// variables the loop would not get enough registers.
  WIREBOND_NOINLINE static std::uint32_t over(std::uint32_t reg, const std::uint8_t* bytes, std::size_t size) {
    const std::uint8_t* const end = bytes + (size & ~std::size_t{7});
    for (; bytes != end; bytes += 8) reg = over_word(over_word(reg, bytes), bytes + 4);
    if ((size & 4u) != 0) {
      reg = over_word(reg, bytes);
      bytes += 4;
    }
    if ((size & 2u) != 0) {
      reg = over_byte(over_byte(reg, bytes[0]), bytes[1]);
      bytes += 2;
    }
    return (size & 1u) != 0 ? over_byte(reg, *bytes) : reg;
  }
};

}  // namespace detail

/// Run a CRC with its byte table, known at compile time. Any thread or interrupt; one table look-up per byte.
template <unsigned Width, std::uint64_t Poly, bool Reflected>
WIREBOND_INLINE std::uint64_t crc_update(std::uint64_t reg64, const std::uint8_t* bytes, std::size_t size) {
  if constexpr (Width > 32) {
    using Table = detail::CrcTable<Width, Poly, Reflected>;
    std::uint64_t reg = reg64;
    for (std::size_t i = 0; i < size; ++i) {
      if constexpr (Reflected) {
        reg = (reg >> 8) ^ Table::value.at[(reg ^ bytes[i]) & 0xFFu];
      } else {
        reg = ((reg << 8) ^ Table::value.at[((reg >> (Width - 8)) ^ bytes[i]) & 0xFFu]) & detail::mask_of(Width);
      }
    }
    return reg;
  } else {
    using Crc = detail::CrcRun<Width, Poly, Reflected>;
    std::uint32_t reg = static_cast<std::uint32_t>(reg64) << Crc::spare;
#if defined(__GNUC__)
    if (__builtin_constant_p(size) && size <= 3) {  // a short header: without a loop, its constants fold
      if (size >= 1) reg = Crc::over_byte(reg, bytes[0]);
      if (size >= 2) reg = Crc::over_byte(reg, bytes[1]);
      if (size == 3) reg = Crc::over_byte(reg, bytes[2]);
      return reg >> Crc::spare;
    }
#endif
    return Crc::over(reg, bytes, size) >> Crc::spare;
  }
}

/// Run a CRC over words, with its byte table, known at compile time.
template <unsigned Width, std::uint64_t Poly, bool Reflected>
WIREBOND_INLINE std::uint64_t crc_words_update(const CheckAlgorithm& a, std::uint64_t reg, const std::uint8_t* bytes,
                                               std::size_t size) {
  static_assert(Width <= 32, "a register of more bits has no room for the bytes of an incomplete word");
  return detail::by_words(a, reg, bytes, size, [&a](std::uint32_t value, std::uint32_t word) WIREBOND_INLINE_LAMBDA {
    const detail::OrderedBytes ordered = detail::ordered(a, word);
    return static_cast<std::uint32_t>(crc_update<Width, Poly, Reflected>(value, ordered.at, a.unit));
  });
}

/// Run a sum, an exclusive-or or a Fletcher checksum (J. G. Fletcher, IEEE Transactions on Communications 30(1), 1982).
WIREBOND_INLINE std::uint64_t sum_update(const CheckAlgorithm& a, std::uint64_t reg64, const std::uint8_t* bytes,
                                         std::size_t size) {
  if (a.unit > 1) {
    return detail::by_words(a, reg64, bytes, size,
                            [&a](std::uint32_t value, std::uint32_t word) WIREBOND_INLINE_LAMBDA {
                              return detail::sum_step(a, value, detail::number_of(a, word)) &
                                     static_cast<std::uint32_t>(detail::mask_of(a.width_bits));
                            });
  }
  std::uint32_t reg = static_cast<std::uint32_t>(reg64);  // widths up to 32 bits: 2^24 bytes of 0xFF fit
  if (a.kind == CheckKind::exclusive_or) {
    for (std::size_t i = 0; i < size; ++i) reg ^= bytes[i];
  } else if (a.kind == CheckKind::sum && a.modulus == 0 && !a.end_around) {
    for (std::size_t i = 0; i < size; ++i) reg += bytes[i];
  } else {
    for (std::size_t i = 0; i < size; ++i) reg = detail::sum_step(a, reg, bytes[i]);
  }
  return reg & detail::mask_of(a.width_bits);
}

}  // namespace wirebond
