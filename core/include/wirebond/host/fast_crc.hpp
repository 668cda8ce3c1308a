// CRCs whose parameters are known only at run time, as fast as the processor allows: carry-less multiplication if it
// has one, otherwise tables that take sixteen bytes at once. For hosts; for microcontrollers see check.hpp.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>

#include "wirebond/bytes.hpp"
#include "wirebond/check.hpp"

#if defined(__x86_64__) && defined(__GNUC__)
#include <immintrin.h>
#define WIREBOND_HAS_CARRYLESS 1
#elif defined(__aarch64__) && (defined(__ARM_FEATURE_AES) || defined(__ARM_FEATURE_CRYPTO))
#include <arm_neon.h>
#define WIREBOND_HAS_CARRYLESS 1
#endif

namespace wirebond {

/// Methods of computing a CRC. All give the same register.
enum class CrcMethod : std::uint8_t {
  byte_table,  ///< one look-up per byte
  slicing,     ///< sixteen independent look-ups for sixteen bytes; registers of up to 32 bits
  carry_less,  ///< one multiplication for eight bytes; registers of up to 32 bits
  automatic,   ///< the fastest that this processor supports
};

/// One CRC with all its precomputed tables. Immutable after construction: any thread. The register is the one of
/// check_begin and check_end: low bits first if the CRC is reflected.
class FastCrc {
 public:
  FastCrc() = default;

  explicit FastCrc(const CheckAlgorithm& a, CrcMethod wanted = CrcMethod::automatic)
      : reflected_(a.reflect_in), width_(a.width_bits) {
    for (unsigned i = 0; i < 256; ++i) wide_[i] = detail::crc_table_entry(i, width_, a.poly, reflected_);
    if (width_ > 32) {
      update_ = reflected_ ? &FastCrc::by_byte<true> : &FastCrc::by_byte<false>;
      return;
    }
    make_slices();
    make_multipliers(a.poly);
    if (wanted == CrcMethod::byte_table) {
      update_ = reflected_ ? &FastCrc::by_byte<true> : &FastCrc::by_byte<false>;
    } else if (wanted == CrcMethod::slicing || !has_carry_less()) {
      method_ = CrcMethod::slicing;
      update_ = reflected_ ? &FastCrc::by_slices<true> : &FastCrc::by_slices<false>;
    } else {
      method_ = CrcMethod::carry_less;
      update_ = reflected_ ? &FastCrc::by_products<true> : &FastCrc::by_products<false>;
      update_word_ = reflected_ ? &FastCrc::word_by_product<true> : &FastCrc::word_by_product<false>;
      by_word_of_64_ = true;
    }
  }

  /// Return the register after `size` more bytes.
  std::uint64_t update(std::uint64_t reg, const std::uint8_t* bytes, std::size_t size) const {
    return update_(*this, reg, bytes, size);
  }

  /// Maximum number of bytes for update_short.
  static constexpr unsigned longest_short = 8;

  /// Run from a register of zero over a word as it is in memory, for registers of up to 32 bits. Zero bytes before the
  /// first change nothing, so fewer bytes can be put at the word's end. The result has its own representation: compare
  /// it only with word_residue.
  std::uint64_t update_word(std::uint64_t word) const { return update_word_(*this, word); }

  /// Return the result of update_word for `size` bytes over which the register runs from `begin` to `end`: a CRC is
  /// linear.
  std::uint64_t word_residue(std::uint64_t begin, std::uint64_t end, std::size_t size) const {
    const std::uint8_t zeros[8] = {};
    const std::uint64_t difference = end ^ update(begin, zeros, size);
    if (reflected_) return difference;
    return difference << ((by_word_of_64_ ? 64u : 32u) - width_);
  }

  /// Return the method in use; never `automatic`.
  CrcMethod method() const { return method_; }

  /// Check whether this processor has carry-less multiplication.
  static bool has_carry_less() {
#if defined(__x86_64__) && defined(__GNUC__)
    return __builtin_cpu_supports("pclmul") && __builtin_cpu_supports("avx");
#elif defined(WIREBOND_HAS_CARRYLESS)
    return true;  // compiled for a processor that has it
#else
    return false;
#endif
  }

 private:
  using Slice = std::array<std::uint32_t, 256>;
  using Slices = std::array<Slice, 16>;
  using UpdateWord = std::uint64_t (*)(const FastCrc&, std::uint64_t);
  using Update = std::uint64_t (*)(const FastCrc&, std::uint64_t, const std::uint8_t*, std::size_t);
  static constexpr std::size_t shortest_product = 16;  ///< for fewer bytes, a few look-ups are faster
  static constexpr std::size_t longest_product = 256;  ///< bytes of one sum of products
  static constexpr std::size_t word_count = longest_product / 8;

  // ---- tables -----------------------------------------------------------------------------------------------------

  template <bool Reflected>
  static std::uint64_t by_byte(const FastCrc& crc, std::uint64_t reg, const std::uint8_t* bytes, std::size_t size) {
    if constexpr (Reflected) {
      for (std::size_t i = 0; i < size; ++i) reg = (reg >> 8) ^ crc.wide_[(reg ^ bytes[i]) & 0xFFu];
      return reg;
    } else {
      const unsigned top = crc.width_ - 8u;
      for (std::size_t i = 0; i < size; ++i) reg = (reg << 8) ^ crc.wide_[((reg >> top) ^ bytes[i]) & 0xFFu];
      return reg & detail::mask_of(crc.width_);
    }
  }

  /// slices_[k][b]: the register after byte b and k zero bytes. A plain register is at the top of 32 bits. M. E.
  /// Kounavis and F. L. Berry, IEEE Transactions on Computers 57(11), 2008.
  void make_slices() {
    const unsigned spare = reflected_ ? 0 : 32u - width_;
    for (unsigned i = 0; i < 256; ++i) slices_[0][i] = static_cast<std::uint32_t>(wide_[i] << spare);
    for (std::size_t k = 1; k < slices_.size(); ++k) {
      for (unsigned i = 0; i < 256; ++i) {
        const std::uint32_t reg = slices_[k - 1][i];
        slices_[k][i] = reflected_ ? (reg >> 8) ^ slices_[0][reg & 0xFFu] : (reg << 8) ^ slices_[0][reg >> 24];
      }
    }
  }

  /// Two bytes at a time: processors read either of the lowest two bytes of a register without a shift.
  WIREBOND_INLINE static std::uint64_t word_by_slices(const FastCrc& crc, std::uint64_t word) {
    const Slices& t = crc.slices_;
    std::uint32_t reg = t[7][word & 0xFFu] ^ t[6][(word >> 8) & 0xFFu];
    next_two(word);
    reg ^= t[5][word & 0xFFu] ^ t[4][(word >> 8) & 0xFFu];
    next_two(word);
    reg ^= t[3][word & 0xFFu] ^ t[2][(word >> 8) & 0xFFu];
    next_two(word);
    return reg ^ t[1][word & 0xFFu] ^ t[0][(word >> 8) & 0xFFu];
  }

  WIREBOND_INLINE static void next_two(std::uint64_t& word) {
    word >>= 16;
#if defined(__GNUC__)
    __asm__("" : "+r"(word));  // otherwise compilers shift the first word again for each byte
#endif
  }

  /// Take four bytes; the tables are indexed in their order in memory.
  template <bool Reflected>
  WIREBOND_INLINE static std::uint32_t four_bytes(const Slice* t, std::uint32_t reg, const std::uint8_t* bytes) {
    std::uint64_t word = load<std::uint32_t>(bytes) ^ (Reflected ? reg : __builtin_bswap32(reg));
    reg = t[3][word & 0xFFu] ^ t[2][(word >> 8) & 0xFFu];
    next_two(word);
    return reg ^ t[1][word & 0xFFu] ^ t[0][(word >> 8) & 0xFFu];
  }

  template <bool Reflected>
  static std::uint64_t by_slices(const FastCrc& crc, std::uint64_t reg64, const std::uint8_t* bytes, std::size_t size) {
    const Slices& t = crc.slices_;
    const unsigned spare = Reflected ? 0 : 32u - crc.width_;
    std::uint32_t reg = static_cast<std::uint32_t>(reg64 << spare);
    for (; size >= 16; bytes += 16, size -= 16) {  // only the first four bytes are combined with the register
      std::uint32_t next = t[11][bytes[4]] ^ t[10][bytes[5]] ^ t[9][bytes[6]] ^ t[8][bytes[7]];
      next ^= t[7][bytes[8]] ^ t[6][bytes[9]] ^ t[5][bytes[10]] ^ t[4][bytes[11]];
      next ^= t[3][bytes[12]] ^ t[2][bytes[13]] ^ t[1][bytes[14]] ^ t[0][bytes[15]];
      reg = next ^ four_bytes<Reflected>(&t[12], reg, bytes);
    }
    if ((size & 8) != 0) {
      const std::uint32_t next = t[3][bytes[4]] ^ t[2][bytes[5]] ^ t[1][bytes[6]] ^ t[0][bytes[7]];
      reg = next ^ four_bytes<Reflected>(&t[4], reg, bytes);
      bytes += 8;
    }
    if ((size & 4) != 0) {
      reg = four_bytes<Reflected>(&t[0], reg, bytes);
      bytes += 4;
    }
    size &= 3;
    for (; size != 0; ++bytes, --size) {
      reg = Reflected ? (reg >> 8) ^ t[0][(reg ^ *bytes) & 0xFFu] : (reg << 8) ^ t[0][(reg >> 24) ^ *bytes];
    }
    return reg >> spare;
  }

  template <bool Reflected>
  static std::uint64_t read(const std::uint8_t* bytes) {
    return load < std::uint64_t, Reflected ? ByteOrder::little : ByteOrder::big > (bytes);
  }

  // ---- products ---------------------------------------------------------------------------------------------------
  //
  // A CRC of width w is the remainder of M * x^w divided by its polynomial P. With P' = P * x^(64-w), of degree 64, it
  // is the top of (M * x^64) mod P' for any w. M is a sum of 64-bit words W_j * x^(64 j), so that
  //
  //   M * x^64  =  sum of W_j * K_j  (mod P')   with   K_j = x^(64 j + 64) mod P'
  //
  // The terms of the sum do not depend on each other. The result, 128 bits, is divided by P' with Barrett's method: the
  // quotient is the upper half times floor(x^128 / P'). (V. Gopal et al., "Fast CRC Computation for Generic Polynomials
  // Using PCLMULQDQ Instruction", Intel, 2009, has folding, Barrett and the reflected forms.)
  //
  // Reflected words hold x^63 in their lowest bit. Their product has x^126 there, one less than the position in its 128
  // bits means: K_j is computed for x^(64 j + 63) instead, and both divisors contain their leading one, which shifts
  // them.

  void make_multipliers(std::uint64_t poly) {
    const std::uint64_t scaled = poly << (64u - width_);
    std::uint64_t quotient = 0;  // of x^128 by P', without its leading x^64
    std::uint64_t rest = scaled;
    for (unsigned bit = 64; bit-- > 0;) {
      const bool top = (rest >> 63) != 0;
      rest = (rest << 1) ^ (top ? scaled : 0);
      if (top) quotient |= std::uint64_t{1} << bit;
    }
    std::uint64_t factor = reflected_ ? std::uint64_t{1} << 63 : scaled;  // x^63, x^64 mod P'
    for (unsigned j = 0; j <= word_count; ++j) {
      factors_[word_count - j] = reflected_ ? detail::reflect(factor, 64) : factor;
      for (unsigned i = 0; i < 64; ++i) factor = (factor << 1) ^ ((factor >> 63) != 0 ? scaled : 0);
    }
    division_[0] = reflected_ ? (detail::reflect(quotient, 64) << 1) | 1u : quotient;
    division_[1] = reflected_ ? (detail::reflect(scaled, 64) << 1) | 1u : scaled;
  }

#if defined(__x86_64__) && defined(__GNUC__)
#define WIREBOND_CARRYLESS __attribute__((target("avx,pclmul")))
  using Product = __m128i;
  WIREBOND_CARRYLESS static Product multiply(std::uint64_t a, std::uint64_t b) {
    return _mm_clmulepi64_si128(word(a), word(b), 0x00);
  }
  /// Multiply a word by the factor at `factors`, which another one follows: so it is loaded straight from memory.
  WIREBOND_CARRYLESS static Product multiply_first(std::uint64_t a, const std::uint64_t* factors) {
    return _mm_clmulepi64_si128(word(a), _mm_loadu_si128(reinterpret_cast<const __m128i*>(factors)), 0x00);
  }
  /// Multiply the lower half of a product by the first or the second of two factors.
  template <int Which>
  WIREBOND_CARRYLESS static Product multiply_lower(Product a, const std::uint64_t* factors) {
    return _mm_clmulepi64_si128(a, _mm_loadu_si128(reinterpret_cast<const __m128i*>(factors)), Which << 4);
  }
  /// Multiply two words by two factors.
  template <bool Reflected>
  WIREBOND_CARRYLESS static Product multiply_pair(const std::uint8_t* words, const std::uint64_t* factors) {
    __m128i a = _mm_loadu_si128(reinterpret_cast<const __m128i*>(words));
    const __m128i b = _mm_loadu_si128(reinterpret_cast<const __m128i*>(factors));
    if constexpr (!Reflected) {
      a = _mm_shuffle_epi8(a, _mm_set_epi8(8, 9, 10, 11, 12, 13, 14, 15, 0, 1, 2, 3, 4, 5, 6, 7));
    }
    return _mm_xor_si128(_mm_clmulepi64_si128(a, b, 0x00), _mm_clmulepi64_si128(a, b, 0x11));
  }
  WIREBOND_CARRYLESS static Product add(Product a, Product b) { return _mm_xor_si128(a, b); }
  WIREBOND_CARRYLESS static Product word(std::uint64_t value) {
    return _mm_cvtsi64_si128(static_cast<long long>(value));
  }
  WIREBOND_CARRYLESS static std::uint64_t low(Product a) { return static_cast<std::uint64_t>(_mm_cvtsi128_si64(a)); }
  WIREBOND_CARRYLESS static std::uint64_t high(Product a) {
    return static_cast<std::uint64_t>(_mm_extract_epi64(a, 1));
  }
#elif defined(WIREBOND_HAS_CARRYLESS)
#define WIREBOND_CARRYLESS
  using Product = uint64x2_t;
  WIREBOND_CARRYLESS static Product multiply(std::uint64_t a, std::uint64_t b) {
    return vreinterpretq_u64_p128(vmull_p64(a, b));
  }
  WIREBOND_CARRYLESS static Product multiply_first(std::uint64_t a, const std::uint64_t* factors) {
    return multiply(a, *factors);
  }
  template <int Which>
  WIREBOND_CARRYLESS static Product multiply_lower(Product a, const std::uint64_t* factors) {
    return multiply(low(a), factors[Which]);
  }
  template <bool Reflected>
  WIREBOND_CARRYLESS static Product multiply_pair(const std::uint8_t* words, const std::uint64_t* factors) {
    return add(multiply(read<Reflected>(words), factors[0]), multiply(read<Reflected>(words + 8), factors[1]));
  }
  WIREBOND_CARRYLESS static Product add(Product a, Product b) { return veorq_u64(a, b); }
  WIREBOND_CARRYLESS static std::uint64_t low(Product a) { return vgetq_lane_u64(a, 0); }
  WIREBOND_CARRYLESS static std::uint64_t high(Product a) { return vgetq_lane_u64(a, 1); }
#endif

#if defined(WIREBOND_HAS_CARRYLESS)
  template <bool Reflected>
  WIREBOND_CARRYLESS static std::uint64_t by_products(const FastCrc& crc, std::uint64_t reg, const std::uint8_t* bytes,
                                                      std::size_t size) {
    if (size - shortest_product > longest_product - shortest_product) return by_parts<Reflected>(crc, reg, bytes, size);
    const unsigned spare = Reflected ? 0 : 64u - crc.width_;  // a plain register is at the top of its word
    return sum_of_products<Reflected>(crc, reg << spare, bytes, size) >> spare;
  }

  /// For too few bytes for products, or too many for one sum of them.
  template <bool Reflected>
  __attribute__((noinline)) static std::uint64_t by_parts(const FastCrc& crc, std::uint64_t reg,
                                                          const std::uint8_t* bytes, std::size_t size) {
    while (size > longest_product) {
      reg = by_products<Reflected>(crc, reg, bytes, longest_product);
      bytes += longest_product;
      size -= longest_product;
    }
    return size < shortest_product ? by_slices<Reflected>(crc, reg, bytes, size)
                                   : by_products<Reflected>(crc, reg, bytes, size);
  }

  /// 8 <= size <= longest_product.
  template <bool Reflected>
  WIREBOND_CARRYLESS WIREBOND_INLINE static std::uint64_t sum_of_products(const FastCrc& crc, std::uint64_t reg,
                                                                          const std::uint8_t* bytes, std::size_t size) {
    // A word is as far from the end of the bytes as its factor from the end of the factors.
    const std::uint8_t* const end = bytes + size;
    const std::uint64_t* const last = crc.factors_.data() + word_count + 1;
    std::ptrdiff_t left = -static_cast<std::ptrdiff_t>(size / 8);  // words, counted up to 0
    const unsigned odd = static_cast<unsigned>(size % 8) * 8;      // bits of a first, incomplete word
    Product sum{};
    if (odd != 0) {
      const std::uint64_t first = read<Reflected>(bytes) ^ reg;
      sum = multiply_first(Reflected ? first << (64 - odd) : first >> (64 - odd), last + left - 1);
      reg = Reflected ? reg >> odd : reg << odd;
    }
    sum = add(sum, multiply_first(read<Reflected>(end + 8 * left) ^ reg, last + left));
    ++left;
    if (left % 2 != 0) {
      sum = add(sum, multiply_first(read<Reflected>(end + 8 * left), last + left));
      ++left;
    }
    for (; left != 0; left += 2) sum = add(sum, multiply_pair<Reflected>(end + 8 * left, last + left));
    return remainder<Reflected>(crc, sum);
  }

  template <bool Reflected>
  WIREBOND_CARRYLESS WIREBOND_INLINE static std::uint64_t remainder(const FastCrc& crc, Product sum) {
    if constexpr (Reflected) {
      const Product quotient = multiply_lower<0>(sum, crc.division_.data());
      return high(add(sum, multiply_lower<1>(quotient, crc.division_.data())));
    } else {
      const std::uint64_t upper = high(sum);
      const std::uint64_t quotient = upper ^ high(multiply(upper, crc.division_[0]));
      return low(sum) ^ low(multiply(quotient, crc.division_[1]));
    }
  }

  template <bool Reflected>
  WIREBOND_CARRYLESS static std::uint64_t word_by_product(const FastCrc& crc, std::uint64_t word) {
    if constexpr (!Reflected) word = __builtin_bswap64(word);
    return remainder<Reflected>(crc, multiply_first(word, crc.factors_.data() + word_count));
  }
#else
  template <bool Reflected>
  static std::uint64_t by_products(const FastCrc& crc, std::uint64_t reg, const std::uint8_t* bytes, std::size_t size) {
    return by_slices<Reflected>(crc, reg, bytes, size);
  }
  template <bool Reflected>
  static std::uint64_t word_by_product(const FastCrc& crc, std::uint64_t word) {
    return word_by_slices(crc, word);
  }
#endif

  Update update_ = nullptr;
  UpdateWord update_word_ = &FastCrc::word_by_slices;
  bool reflected_ = false;
  bool by_word_of_64_ = false;
  CrcMethod method_ = CrcMethod::byte_table;
  unsigned width_ = 8;
  std::array<std::uint64_t, 2>
      division_{};  ///< x^128 by P', and P', both without their leading one where not reflected
  std::array<std::uint64_t, word_count + 2> factors_{};  ///< K_32 to K_0, and one that is loaded but never used
  Slices slices_{};
  std::array<std::uint64_t, 256> wide_{};
};

}  // namespace wirebond
