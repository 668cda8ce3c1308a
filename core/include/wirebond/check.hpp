// Check algorithms only: how a register runs over bytes. The place of a check in a frame belongs to format.hpp.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <type_traits>

#include "wirebond/bytes.hpp"

namespace wirebond {

enum class CheckKind : std::uint8_t {
  crc,  ///< any cyclic redundancy check, given by the parameters of the Rocksoft model
  sum,  ///< sum of bytes modulo 2^width
  exclusive_or,
  fletcher,  ///< two sums of width/2 bits, the second of the first's values; the first is the low half
};

/// One algorithm, by parameters. CRC parameters follow Williams' "A Painless Guide to CRC Error Detection Algorithms"
/// (1993), as in the reveng catalogue: `poly` and `init` are written most significant bit first.
struct CheckAlgorithm {
  CheckKind kind = CheckKind::crc;
  std::uint8_t width_bits = 16;  ///< 8, 16, 24, 32 or 64
  bool reflect_in = false;
  bool reflect_out = false;
  std::uint64_t poly = 0;
  std::uint64_t init = 0;
  std::uint64_t xor_out = 0;
  std::uint16_t modulus = 0;  ///< Fletcher: of both sums; 0: 2^(width/2)
  bool negate = false;        ///< two's complement of the value, before xor_out
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

/// Register before the first byte.
WIREBOND_INLINE constexpr std::uint64_t check_begin(const CheckAlgorithm& a) {
  if (a.kind == CheckKind::crc && a.reflect_in) return detail::reflect(a.init, a.width_bits);
  return a.init & detail::mask_of(a.width_bits);
}

namespace detail {

WIREBOND_INLINE constexpr bool reflects_end(const CheckAlgorithm& a) {
  return a.kind == CheckKind::crc && a.reflect_in != a.reflect_out;
}

/// Do the part of `check_end` after the reflection.
WIREBOND_INLINE constexpr std::uint64_t check_finish(const CheckAlgorithm& a, std::uint64_t reg) {
  if (a.negate) reg = ~reg + 1;
  return (reg ^ a.xor_out) & mask_of(a.width_bits);
}

}  // namespace detail

/// Return the check's value, computed from the register after the last byte.
WIREBOND_INLINE constexpr std::uint64_t check_end(const CheckAlgorithm& a, std::uint64_t reg) {
  if (detail::reflects_end(a)) reg = detail::reflect(reg, a.width_bits);
  return detail::check_finish(a, reg);
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

/// Run a sum, an exclusive-or or a Fletcher checksum (J. G. Fletcher, IEEE Transactions on Communications 30(1), 1982).
WIREBOND_INLINE std::uint64_t sum_update(const CheckAlgorithm& a, std::uint64_t reg64, const std::uint8_t* bytes,
                                         std::size_t size) {
  std::uint32_t reg = static_cast<std::uint32_t>(reg64);  // widths up to 32 bits: 2^24 bytes of 0xFF fit
  switch (a.kind) {
    case CheckKind::exclusive_or:
      for (std::size_t i = 0; i < size; ++i) reg ^= bytes[i];
      break;
    case CheckKind::fletcher: {
      const unsigned half = a.width_bits / 2u;
      const std::uint32_t modulus = a.modulus != 0 ? a.modulus : std::uint32_t{1} << half;
      std::uint32_t first = reg & static_cast<std::uint32_t>(detail::mask_of(half));
      std::uint32_t second = reg >> half;
      for (std::size_t i = 0; i < size; ++i) {
        first = (first + bytes[i]) % modulus;
        second = (second + first) % modulus;
      }
      reg = (second << half) | first;
      break;
    }
    default:
      for (std::size_t i = 0; i < size; ++i) reg += bytes[i];
      break;
  }
  return reg & detail::mask_of(a.width_bits);
}

}  // namespace wirebond
