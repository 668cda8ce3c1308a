// Numbers of any width against one bit at a time.
#include "wirebond/bits.hpp"

#include <doctest/doctest.h>

#include <array>
#include <cstdint>
#include <random>
#include <type_traits>
#include <vector>

#include "wirebond/list.hpp"

using wirebond::BitOrder;
using wirebond::Coding;

namespace {

bool bit_of(const std::vector<std::uint8_t>& bytes, std::size_t bit, BitOrder order) {
  const std::size_t place = order == BitOrder::low_first ? bit % 8 : 7 - bit % 8;
  return ((bytes[bit / 8] >> place) & 1) != 0;
}

std::uint64_t slow_load(const std::vector<std::uint8_t>& bytes, std::size_t bit, unsigned width, BitOrder order) {
  std::uint64_t value = 0;
  for (unsigned i = 0; i < width; ++i) {
    const std::uint64_t one = bit_of(bytes, bit + i, order) ? 1 : 0;
    value = order == BitOrder::low_first ? value | (one << i) : (value << 1) | one;
  }
  return value;
}

}  // namespace

TEST_CASE("every width at every place is what its bits are one by one, and the bits beside it stay") {
  std::mt19937 random(1);
  for (const BitOrder order : {BitOrder::low_first, BitOrder::high_first}) {
    for (unsigned width = 1; width <= 64; ++width) {
      for (std::size_t bit = 0; bit < 16; ++bit) {
        std::vector<std::uint8_t> bytes((bit + width + 7) / 8);  // no byte more: the sanitizer sees an overrun
        for (std::uint8_t& byte : bytes) byte = static_cast<std::uint8_t>(random());
        REQUIRE(wirebond::load_bits(bytes.data(), bit, width, order) == slow_load(bytes, bit, width, order));
        const std::uint64_t value = ((std::uint64_t{random()} << 32) | random()) & wirebond::low_bits(width);
        std::vector<std::uint8_t> changed = bytes;
        wirebond::store_bits(changed.data(), bit, width, order, value | ~wirebond::low_bits(width));
        REQUIRE(wirebond::load_bits(changed.data(), bit, width, order) == value);
        for (std::size_t i = 0; i < 8 * bytes.size(); ++i) {
          if (i < bit || i >= bit + width) REQUIRE(bit_of(changed, i, order) == bit_of(bytes, i, order));
        }
      }
    }
  }
}

TEST_CASE("a sign lies in two's complement or before its amount") {
  CHECK(wirebond::from_bits<std::int8_t, 5>(0x1F) == -1);
  CHECK(wirebond::from_bits<std::int8_t, 5, Coding::sign_magnitude>(0x1F) == -15);
  CHECK(wirebond::from_bits<std::int8_t, 5, Coding::sign_magnitude>(0x10) == 0);
  CHECK(wirebond::from_bits<std::uint8_t, 5>(0xFF) == 31);
  CHECK(wirebond::from_bits<std::int64_t, 64, Coding::sign_magnitude>(~std::uint64_t{0}) == -INT64_MAX);
  std::uint64_t raw = 99;
  CHECK(wirebond::to_bits<5>(std::int8_t{-16}, raw));
  CHECK(raw == 0x10);
  CHECK(wirebond::to_bits<5, Coding::sign_magnitude>(std::int8_t{-15}, raw));
  CHECK(raw == 0x1F);
  CHECK(wirebond::to_bits<64>(INT64_MIN, raw));
  CHECK(raw == std::uint64_t{1} << 63);
}

TEST_CASE("a number that does not fit is refused and nothing is changed") {
  std::uint64_t raw = 99;
  CHECK_FALSE(wirebond::to_bits<5>(std::int8_t{16}, raw));
  CHECK_FALSE(wirebond::to_bits<5>(std::int8_t{-17}, raw));
  CHECK_FALSE(wirebond::to_bits<5, Coding::sign_magnitude>(std::int8_t{-16}, raw));
  CHECK_FALSE(wirebond::to_bits<64, Coding::sign_magnitude>(INT64_MIN, raw));
  CHECK_FALSE(wirebond::to_bits<3>(std::uint8_t{8}, raw));
  CHECK(raw == 99);
  std::array<std::uint8_t, 2> bytes{0xAB, 0xCD};
  CHECK_FALSE(wirebond::store_packed<3, BitOrder::low_first>(bytes.data(), 1, std::uint8_t{8}));
  CHECK_FALSE(wirebond::store_coded<Coding::sign_magnitude, std::int16_t>(bytes.data(), INT16_MIN));
  CHECK(bytes == std::array<std::uint8_t, 2>{0xAB, 0xCD});
  std::uint16_t bits = 0x8001;
  CHECK_FALSE(wirebond::insert_bits<3, 4>(bits, std::uint8_t{8}));
  CHECK(bits == 0x8001);
}

TEST_CASE("decimal digits are a number, and what is not a digit is above all of them") {
  CHECK(wirebond::from_bits<std::uint32_t, 28, Coding::bcd>(0xF1112694) == 1112694);
  CHECK(wirebond::from_bits<std::uint8_t, 8, Coding::bcd>(0x99) == 99);
  CHECK(wirebond::from_bits<std::uint8_t, 8, Coding::bcd>(0x0A) == 100);
  CHECK(wirebond::from_bits<std::uint8_t, 4, Coding::bcd>(0x19) == 9);
  CHECK(wirebond::from_bits<std::uint64_t, 60, Coding::bcd>(0x123456789012345) == 123456789012345);
  CHECK(wirebond::from_bits<std::uint64_t, 60, Coding::bcd>(0xF23456789012345) == 1000000000000000);
  std::uint64_t raw = 99;
  CHECK_FALSE(wirebond::to_bits<8, Coding::bcd>(std::uint8_t{100}, raw));
  CHECK(raw == 99);
  CHECK(wirebond::to_bits<28, Coding::bcd>(std::uint32_t{1112694}, raw));
  CHECK(raw == 0x1112694);
  std::array<std::uint8_t, 3> bytes{};
  CHECK(wirebond::store_coded<Coding::bcd, std::uint32_t, wirebond::ByteOrder::big, 3>(bytes.data(), 42863));
  CHECK(bytes == std::array<std::uint8_t, 3>{0x04, 0x28, 0x63});
  CHECK(wirebond::load_coded<Coding::bcd, std::uint32_t, wirebond::ByteOrder::big, 3>(bytes.data()) == 42863);
  for (std::uint32_t number = 0; number < 10000; ++number) {
    CHECK(wirebond::to_bits<16, Coding::bcd>(number, raw));
    CHECK(wirebond::from_bits<std::uint32_t, 16, Coding::bcd>(raw) == number);
  }
}

namespace {

/// Whether a coding that only run time knows gives all numbers of `Width` bits as `from_bits` and `to_bits` do.
template <class T, unsigned Width, Coding Encoding>
bool agrees_at_run_time() {
  for (std::uint64_t raw = 0; raw <= wirebond::low_bits(Width); ++raw) {
    const T number = wirebond::from_bits<T, Width, Encoding>(raw);
    const auto wide = static_cast<std::uint64_t>(number);
    if (wirebond::number_of_bits(raw, Width, Encoding, std::is_signed_v<T>) != wide) return false;
    std::uint64_t back = 0;
    if (!wirebond::to_bits<Width, Encoding>(number, back)) continue;  // digits that are none
    if (wirebond::bits_of_number(wide, Width, Encoding) != back) return false;
  }
  return true;
}

}  // namespace

TEST_CASE("a coding that only run time knows means the same numbers") {
  CHECK(agrees_at_run_time<std::uint16_t, 9, Coding::binary>());
  CHECK(agrees_at_run_time<std::int16_t, 9, Coding::binary>());
  CHECK(agrees_at_run_time<std::int16_t, 9, Coding::sign_magnitude>());
  CHECK(agrees_at_run_time<std::uint16_t, 12, Coding::bcd>());
}

TEST_CASE("a number whose bits lie in several places is gathered from them, its lowest piece first") {
  constexpr std::uint64_t bits = 0xF1F711269474;  // one digit behind F, six behind another byte
  CHECK(wirebond::extract_split<std::uint32_t, Coding::bcd, 8, 24, 40, 4>(bits) == 1112694);
  CHECK(wirebond::extract_split<std::int16_t, Coding::binary, 0, 3, 6, 2>(std::uint8_t{0xC5}) == -3);
  CHECK(wirebond::extract_split<std::uint64_t, Coding::binary, 63, 1, 0, 63>(~std::uint64_t{1}) == ~std::uint64_t{2});
  std::uint64_t filled = 0xF0F700000074;
  CHECK(wirebond::insert_split<Coding::bcd, 8, 24, 40, 4>(filled, std::uint32_t{1112694}));
  CHECK(filled == bits);
  CHECK_FALSE(wirebond::insert_split<Coding::bcd, 8, 24, 40, 4>(filled, std::uint32_t{10000000}));
  CHECK(filled == bits);
  std::uint8_t small = 0;
  CHECK(wirebond::insert_split<Coding::binary, 0, 3, 6, 2>(small, std::int16_t{-3}));
  CHECK(small == 0xC5);
}

TEST_CASE("a list takes what it has room for, and never shows more than that") {
  wirebond::List<int, 2> list;
  CHECK(list.push_back(7));
  CHECK(list.push_back(8));
  CHECK_FALSE(list.push_back(9));
  CHECK(list.size == 2);
  list.size = 9;
  CHECK(list.used() == 2);
  CHECK(list.end() - list.begin() == 2);
}
