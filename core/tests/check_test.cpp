// Check algorithms: published check values, and every length and split against a register that runs bit by bit.
#include "wirebond/check.hpp"

#include <doctest/doctest.h>

#include <cstdint>
#include <random>
#include <vector>

#include "wirebond/host/runtime_source.hpp"

using namespace wirebond;

namespace {

const std::uint8_t digits[] = {'1', '2', '3', '4', '5', '6', '7', '8', '9'};

/// The register of the Rocksoft model, one bit at a time, never reflected: slow and obvious.
std::uint64_t bit_by_bit(const CheckAlgorithm& a, const std::uint8_t* bytes, std::size_t size) {
  const std::uint64_t top = std::uint64_t{1} << (a.width_bits - 1);
  const std::uint64_t mask = (top - 1) | top;
  std::uint64_t reg = a.init;
  for (std::size_t i = 0; i < size; ++i) {
    for (unsigned bit = 0; bit < 8; ++bit) {
      if (((bytes[i] >> (a.reflect_in ? bit : 7 - bit)) & 1) != 0) reg ^= top;
      const bool out = (reg & top) != 0;
      reg = (reg << 1) & mask;
      if (out) reg ^= a.poly;  // as `in != out`, GCC 12.2 compiles it wrongly with -O1 and -O2 for 64 bits
    }
  }
  if (a.reflect_out) {
    std::uint64_t reversed = 0;
    for (unsigned bit = 0; bit < a.width_bits; ++bit) reversed = reversed << 1 | ((reg >> bit) & 1);
    reg = reversed;
  }
  return (reg ^ a.xor_out) & mask;
}

template <unsigned Width, std::uint64_t Poly, std::uint64_t Init, bool In, bool Out, std::uint64_t XorOut>
void expect(std::uint64_t published) {
  constexpr CheckAlgorithm a{CheckKind::crc, Width, In, Out, Poly, Init, XorOut};
  CAPTURE(Width);
  CAPTURE(Poly);
  CHECK(bit_by_bit(a, digits, sizeof digits) == published);

  FrameFormat format{};
  format.algorithm_count = 1;
  format.algorithms[0] = a;
  const RuntimeTables by_byte(format, nullptr, 0, CrcMethod::byte_table);
  const RuntimeTables by_slices(format, nullptr, 0, CrcMethod::slicing);
  const RuntimeTables fastest(format, nullptr, 0);

  std::mt19937 random(Width + Poly);
  std::vector<std::uint8_t> bytes(700);  // more than one sum of products takes
  for (auto& byte : bytes) byte = static_cast<std::uint8_t>(random());
  for (std::size_t size = 0; size <= bytes.size(); ++size) {
    const std::uint64_t wanted = bit_by_bit(a, bytes.data(), size);
    const std::size_t split = size == 0 ? 0 : random() % size;
    std::uint64_t folded = crc_update<Width, Poly, In>(check_begin(a), bytes.data(), split);
    folded = crc_update<Width, Poly, In>(folded, bytes.data() + split, size - split);
    CHECK(check_end(a, folded) == wanted);
    if (size >= 3) {  // sizes that the compiler knows go another way
      folded = crc_update<Width, Poly, In>(check_begin(a), bytes.data(), 1);
      folded = crc_update<Width, Poly, In>(folded, bytes.data() + 1, 2);
      folded = crc_update<Width, Poly, In>(folded, bytes.data() + 3, size - 3);
      CHECK(check_end(a, folded) == wanted);
      folded = crc_update<Width, Poly, In>(check_begin(a), bytes.data(), 3);
      folded = crc_update<Width, Poly, In>(folded, bytes.data() + 3, size - 3);
      CHECK(check_end(a, folded) == wanted);
    }
    for (const RuntimeTables* tables : {&by_byte, &by_slices, &fastest}) {
      const RuntimeSource source(*tables);
      std::uint64_t read = source.check_update(0, source.check_begin_of(0), bytes.data(), split);
      read = source.check_update(0, read, bytes.data() + split, size - split);
      CHECK(source.check_end_of(0, read) == wanted);
    }
  }
}

}  // namespace

TEST_CASE("CRCs of every width give their published check values, whole and in two runs") {
  expect<8, 0x07, 0x00, false, false, 0x00>(0xF4);                           // crc-8/smbus
  expect<8, 0x31, 0x00, true, true, 0x00>(0xA1);                             // crc-8/maxim-dow
  expect<8, 0x2F, 0xFF, false, false, 0xFF>(0xDF);                           // crc-8/autosar
  expect<16, 0x1021, 0xFFFF, false, false, 0x0000>(0x29B1);                  // crc-16/ibm-3740
  expect<16, 0x1021, 0xFFFF, true, true, 0x0000>(0x6F91);                    // crc-16/mcrf4xx
  expect<16, 0x1021, 0xFFFF, true, true, 0xFFFF>(0x906E);                    // crc-16/ibm-sdlc
  expect<16, 0x8005, 0xFFFF, true, true, 0x0000>(0x4B37);                    // crc-16/modbus
  expect<16, 0x1021, 0xB2AA, true, true, 0x0000>(0x63D0);                    // crc-16/riello: init is not a palindrome
  expect<24, 0x864CFB, 0xB704CE, false, false, 0x000000>(0x21CF02);          // crc-24/openpgp
  expect<24, 0x00065B, 0x555555, true, true, 0x000000>(0xC25A56);            // crc-24/ble
  expect<32, 0x04C11DB7, 0xFFFFFFFF, true, true, 0xFFFFFFFF>(0xCBF43926);    // crc-32/iso-hdlc
  expect<32, 0x04C11DB7, 0xFFFFFFFF, false, false, 0x00000000>(0x0376E6E7);  // crc-32/mpeg-2
  expect<64, 0x42F0E1EBA9EA3693, 0, false, false, 0>(0x6C40DF5F0B497347);    // crc-64/ecma-182
  expect<64, 0x42F0E1EBA9EA3693, ~std::uint64_t{0}, true, true, ~std::uint64_t{0}>(0x995DC9BBDF1939FA);  // crc-64/xz
}

#if defined(WIREBOND_EXPECTS_CARRYLESS)  // the build for aarch64 says so, lest it test the tables alone
TEST_CASE("this processor's CRCs of up to 32 bits are products without carry") {
  CHECK(FastCrc(CheckAlgorithm{CheckKind::crc, 16, true, true, 0x1021}).method() == CrcMethod::carry_less);
  CHECK(FastCrc(CheckAlgorithm{CheckKind::crc, 32, false, false, 0x04C11DB7}).method() == CrcMethod::carry_less);
}
#endif

TEST_CASE("a CRC whose result is reflected and whose input is not, and the other way round") {
  constexpr CheckAlgorithm out{CheckKind::crc, 16, false, true, 0x1021, 0x1234, 0x0F0F};
  constexpr CheckAlgorithm in{CheckKind::crc, 16, true, false, 0x1021, 0x1234, 0x0F0F};
  CHECK(check_end(out, crc_update<16, 0x1021, false>(check_begin(out), digits, 9)) == bit_by_bit(out, digits, 9));
  CHECK(check_end(in, crc_update<16, 0x1021, true>(check_begin(in), digits, 9)) == bit_by_bit(in, digits, 9));
}

CheckAlgorithm algorithm(CheckKind kind, std::uint8_t width) { return {kind, width}; }

TEST_CASE("sums and exclusive-ors keep their width and go on from a register") {
  const std::uint8_t bytes[] = {0xFF, 0xFF, 0x02, 0x80};
  CHECK(sum_update(algorithm(CheckKind::sum, 8), 0, bytes, 4) == 0x80);
  CHECK(sum_update(algorithm(CheckKind::sum, 16), 0, bytes, 4) == 0x0280);
  CHECK(sum_update(algorithm(CheckKind::sum, 16), 0xFFFF, bytes, 1) == 0x00FE);
  CHECK(sum_update(algorithm(CheckKind::exclusive_or, 8), 0, bytes, 4) == 0x82);
  CHECK(sum_update(algorithm(CheckKind::exclusive_or, 8), 0x82, bytes, 4) == 0);
  CHECK(sum_update(algorithm(CheckKind::sum, 16), 0x1234, nullptr, 0) == 0x1234);
}

namespace {

/// The check's value over `size` bytes, of which `first` come in a run of their own.
std::uint64_t value_of(const CheckAlgorithm& a, const std::uint8_t* bytes, std::size_t size, std::size_t first) {
  std::uint64_t reg = sum_update(a, check_begin(a), bytes, first);
  reg = sum_update(a, reg, bytes + first, size - first);
  return is_refused(a, reg) ? ~std::uint64_t{0} : check_end(a, reg);
}

CheckAlgorithm over_words(CheckKind kind, std::uint8_t width, std::uint8_t unit, bool is_little = false) {
  CheckAlgorithm a = algorithm(kind, width);
  a.unit = unit;
  a.unit_is_little = is_little;
  return a;
}

}  // namespace

TEST_CASE("a check over words goes on from any byte") {
  const std::uint8_t hoverboard[] = {0xCD, 0xAB, 0xCE, 0xFF, 0x2C, 0x01};  // a command to its controller: 0x552F
  const std::uint8_t pioneer[] = {0x20, 0x50, 0x69};                       // a report of a robot: 0x2039
  const CheckAlgorithm exclusive_or = over_words(CheckKind::exclusive_or, 16, 2, true);
  CheckAlgorithm odd = over_words(CheckKind::sum, 16, 2);
  odd.odd_tail = OddTail::exclusive_or;
  CheckAlgorithm strict = odd;
  strict.odd_tail = OddTail::refuse;
  for (std::size_t first = 0; first <= 3; ++first) {
    CAPTURE(first);
    CHECK(value_of(exclusive_or, hoverboard, 6, first) == 0x552F);
    CHECK(value_of(odd, pioneer, 3, first) == 0x2039);
    CHECK(value_of(over_words(CheckKind::sum, 16, 2), pioneer, 3, first) == 0x2050 + 0x6900);
    CHECK(value_of(over_words(CheckKind::sum, 16, 2, true), pioneer, 3, first) == 0x5020 + 0x0069);
    CHECK(value_of(strict, pioneer, 3, first) == ~std::uint64_t{0});
    if (first <= 2) CHECK(value_of(strict, pioneer, 2, first) == 0x2050);
  }
}

TEST_CASE("a CRC over words of the STM32 gives the value of its manual") {
  const std::uint8_t word[] = {0x78, 0x56, 0x34, 0x12};
  CheckAlgorithm a{CheckKind::crc, 32, false, false, 0x04C11DB7, 0xFFFFFFFF};
  a.unit = 4;
  a.unit_is_little = true;
  std::uint64_t reg = crc_words_update<32, 0x04C11DB7, false>(a, check_begin(a), word, 3);
  CHECK(check_end(a, reg) == bit_by_bit({CheckKind::crc, 32, false, false, 0x04C11DB7, 0xFFFFFFFF},
                                        reinterpret_cast<const std::uint8_t*>("\x00\x34\x56\x78"), 4));
  reg = crc_words_update<32, 0x04C11DB7, false>(a, reg, word + 3, 1);
  CHECK(check_end(a, reg) == 0xDF8A8A2B);
}

TEST_CASE("a carry out of a sum's highest bit is dropped, added at the lowest, or taken modulo a number") {
  const std::uint8_t bytes[] = {0xFF, 0xFF, 0x02};
  CheckAlgorithm a = algorithm(CheckKind::sum, 8);
  a.end_around = true;
  CHECK(value_of(a, bytes, 3, 1) == 0x02);
  CHECK(value_of(a, bytes, 2, 1) == 0xFF);
  a.end_around = false;
  a.modulus = 100;
  CHECK(value_of(a, bytes, 3, 1) == 512 % 100);
  CheckAlgorithm internet = over_words(CheckKind::sum, 16, 2);  // the example of RFC 1071, section 3
  internet.end_around = true;
  const std::uint8_t example[] = {0x00, 0x01, 0xF2, 0x03, 0xF4, 0xF5, 0xF6, 0xF7};
  CHECK(value_of(internet, example, 8, 3) == 0xDDF2);
}

TEST_CASE("a value is negated, raised, masked and combined in this order") {
  const std::uint8_t bytes[] = {0x82, 0x00, 0x40};  // a command to a Sabertooth driver: 0x42
  CheckAlgorithm a = algorithm(CheckKind::sum, 8);
  a.keep = 0x7F;
  CHECK(value_of(a, bytes, 3, 0) == 0x42);
  a.negate = true;
  a.plus = 0x55;
  a.xor_out = 0x80;
  CHECK(value_of(a, bytes, 3, 0) == (((0x55 - 0xC2) & 0x7F) ^ 0x80));
}

TEST_CASE("a sum is sent in decimal digits") {
  const std::uint8_t bytes[] = {0xFF, 0x02};
  CheckAlgorithm a = algorithm(CheckKind::sum, 16);
  a.bcd = true;
  CHECK(value_of(a, bytes, 2, 1) == 0x0257);
  a.width_bits = 12;
  a.plus = 900;
  CHECK(value_of(a, bytes, 2, 1) == 0x157);  // 1 157: the highest digit has no room
}

TEST_CASE("a value that is to be avoided is raised once") {
  CheckAlgorithm a = algorithm(CheckKind::exclusive_or, 8);
  a.avoided_count = 2;
  a.avoided = {{{0x00, 0x1F}, {0x7F, 0x7F}}};
  a.avoided_plus = 0xC0;
  for (unsigned byte = 0; byte < 256; ++byte) {
    const std::uint8_t one[] = {static_cast<std::uint8_t>(byte)};
    const bool is_avoided = byte <= 0x1F || byte == 0x7F;
    CHECK(value_of(a, one, 1, 0) == (is_avoided ? (byte + 0xC0) % 256 : byte));
  }
}

TEST_CASE("bits are reflected within their width") {
  static_assert(detail::reflect(0x1, 8) == 0x80);
  static_assert(detail::reflect(0x1021, 16) == 0x8408);
  static_assert(detail::reflect(0x04C11DB7, 32) == 0xEDB88320);
  static_assert(detail::reflect(0x1, 64) == 0x8000000000000000);
  CHECK(detail::reflect(detail::reflect(0x123456, 24), 24) == 0x123456);
}
