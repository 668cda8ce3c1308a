// Integers, floats and strings on their way to bytes and back.
#include "wirebond/bytes.hpp"

#include <doctest/doctest.h>

#include <array>
#include <cmath>
#include <cstdint>
#include <limits>

#include "wirebond/bounded.hpp"
#include "wirebond/number.hpp"

using namespace wirebond;

namespace {

const std::uint8_t wire[] = {0x00, 0x12, 0x34, 0x56, 0x78, 0x9A, 0xBC, 0xDE, 0xF0};

}  // namespace

TEST_CASE("numbers are read at any alignment in either order") {
  CHECK(load<std::uint16_t>(wire + 1) == 0x3412);
  CHECK(load<std::uint16_t, ByteOrder::big>(wire + 1) == 0x1234);
  CHECK(load<std::uint32_t>(wire + 1) == 0x78563412);
  CHECK(load<std::int32_t, ByteOrder::big>(wire + 1) == 0x12345678);
  CHECK(load<std::uint64_t>(wire + 1) == 0xF0DEBC9A78563412);
  CHECK(load<std::uint64_t, ByteOrder::big>(wire + 1) == 0x123456789ABCDEF0);
  for (const ByteOrder order : {ByteOrder::little, ByteOrder::big}) {
    for (unsigned bytes = 1; bytes <= 8; ++bytes) {
      std::uint8_t to[9] = {};
      store_bytes(to + 1, load_bytes(wire + 1, bytes, order), bytes, order);
      for (unsigned i = 1; i <= bytes; ++i) CHECK(to[i] == wire[i]);
    }
  }
}

TEST_CASE("a stored number reads back, byte for byte") {
  std::uint8_t to[9] = {};
  store<double, ByteOrder::big>(to + 1, -2.5);
  CHECK(to[1] == 0xC0);
  CHECK(to[2] == 0x04);
  CHECK(load<double, ByteOrder::big>(to + 1) == -2.5);
  store<float>(to + 1, 1.0F);
  CHECK(to[4] == 0x3F);
  CHECK(load<float>(to + 1) == 1.0F);
  const std::array<std::int16_t, 3> numbers = {1, -2, 300};
  std::array<std::int16_t, 3> back{};
  store_array<std::int16_t, 3, ByteOrder::big>(to + 1, numbers);
  CHECK(to[3] == 0xFF);
  CHECK(to[4] == 0xFE);
  load_array<std::int16_t, 3, ByteOrder::big>(to + 1, back);
  CHECK(back == numbers);
  store_array(to + 1, numbers);
  CHECK(to[3] == 0xFE);
  load_array(to + 1, back);
  CHECK(back == numbers);
}

TEST_CASE("24-bit integers carry their sign and refuse what does not fit") {
  std::uint8_t to[3] = {};
  for (const std::int32_t value : {0, 1, -1, 8388607, -8388608, -1193046}) {
    CHECK(store_integer<std::int32_t, ByteOrder::big, 3>(to, value));
    CHECK(load_integer<std::int32_t, ByteOrder::big, 3>(to) == value);
    CHECK(store_integer<std::int32_t, ByteOrder::little, 3>(to, value));
    CHECK(load_integer<std::int32_t, ByteOrder::little, 3>(to) == value);
  }
  CHECK_FALSE(store_integer<std::int32_t, ByteOrder::little, 3>(to, 8388608));
  CHECK_FALSE(store_integer<std::int32_t, ByteOrder::little, 3>(to, -8388609));
  CHECK(store_integer<std::uint32_t, ByteOrder::little, 3>(to, 0xFFFFFFu));
  CHECK(load_integer<std::uint32_t, ByteOrder::little, 3>(to) == 0xFFFFFFu);
  CHECK_FALSE(store_integer<std::uint32_t, ByteOrder::little, 3>(to, 0x1000000u));
}

TEST_CASE("the nearest integer: halves go away from zero, and nothing is rounded twice") {
  std::int16_t small = 0;
  CHECK(nearest<2>(0.49999997F, small));
  CHECK(small == 0);
  CHECK(nearest<2>(-0.5F, small));
  CHECK(small == -1);
  CHECK(nearest<2>(2.5F, small));
  CHECK(small == 3);
  CHECK(nearest<2>(-32768.25F, small));
  CHECK(small == -32768);
  std::int32_t wide = 0;
  CHECK(nearest<3>(8388607.0F, wide));
  CHECK(wide == 8388607);
  CHECK(nearest<4>(8388609.0F, wide));
  CHECK(wide == 8388609);
  CHECK(nearest<3>(-8388608.0F, wide));
  CHECK(wide == -8388608);
  std::int64_t least = 0;
  CHECK(nearest<8>(-9223372036854775808.0, least));
  CHECK(least == std::numeric_limits<std::int64_t>::min());
  std::uint64_t huge = 0;
  CHECK(nearest<8>(18446744073709549568.0, huge));
  CHECK(huge == 18446744073709549568u);
  std::uint8_t byte = 9;
  CHECK(nearest<1>(-0.25F, byte));
  CHECK(byte == 0);
}

TEST_CASE("the nearest integer is refused where it has no room") {
  const float infinity = std::numeric_limits<float>::infinity();
  std::int16_t small = 7;
  for (const float value : {32767.5F, -32768.5F, 1e9F, infinity, -infinity, std::nanf("")}) {
    CAPTURE(value);
    CHECK_FALSE(nearest<2>(value, small));
  }
  CHECK(small == 7);
  std::uint8_t byte = 7;
  CHECK_FALSE(nearest<1>(-0.5F, byte));
  CHECK_FALSE(nearest<1>(255.5F, byte));
  std::int32_t wide = 7;
  CHECK_FALSE(nearest<3>(8388608.0F, wide));
  CHECK_FALSE(nearest<3>(-8388609.0F, wide));
  std::uint32_t plain = 7;
  CHECK_FALSE(nearest<3>(16777216.0F, plain));
  CHECK(nearest<3>(16777215.0F, plain));
  CHECK_FALSE(nearest<4>(2147483648.0, wide));
  std::uint64_t huge = 7;
  CHECK_FALSE(nearest<8>(18446744073709551616.0, huge));
  CHECK(huge == 7);
}

template <class Real, std::size_t Size>
void expect_each_to_count() {
  for (const Real wrong : {std::numeric_limits<Real>::infinity(), -std::numeric_limits<Real>::infinity(),
                           std::numeric_limits<Real>::quiet_NaN(), -std::numeric_limits<Real>::signaling_NaN()}) {
    for (std::size_t at = 0; at < Size; ++at) {
      std::array<Real, Size> values;
      values.fill(std::numeric_limits<Real>::lowest());
      CHECK(all_finite(values));
      values[at] = wrong;
      CHECK_FALSE(all_finite(values));
    }
  }
  std::array<Real, Size> values{};
  CHECK(all_finite(values));
  values.fill(std::numeric_limits<Real>::max());
  CHECK(all_finite(values));
}

TEST_CASE("an array is finite when each of its floats is") {
  expect_each_to_count<float, 1>();
  expect_each_to_count<float, 4>();
  expect_each_to_count<float, 8>();
  expect_each_to_count<float, 9>();
  expect_each_to_count<double, 2>();
  expect_each_to_count<double, 11>();
}

TEST_CASE("finite is what is neither NaN nor infinite") {
  CHECK(is_finite(0.0F));
  CHECK(is_finite(std::numeric_limits<float>::max()));
  CHECK(is_finite(std::numeric_limits<double>::denorm_min()));
  CHECK_FALSE(is_finite(-std::numeric_limits<float>::infinity()));
  CHECK_FALSE(is_finite(std::numeric_limits<double>::infinity()));
  CHECK_FALSE(is_finite(std::nan("")));
  CHECK_FALSE(is_finite(std::nanf("")));
  std::uint8_t to[4] = {1, 2, 3, 4};
  CHECK_FALSE(store_finite(to, std::nanf("")));
  CHECK(to[0] == 1);
  CHECK_FALSE(store_nearest<std::int16_t>(to, 40000.0F));
  CHECK(to[0] == 1);
}

TEST_CASE("a bounded string takes what fits and keeps its content otherwise") {
  Bounded<char, 5> text;
  CHECK(text.view().empty());
  CHECK(text.assign("hello"));
  CHECK(text.view() == "hello");
  CHECK_FALSE(text.assign("hello!"));
  CHECK(text.view() == "hello");
  CHECK(text.assign(nullptr, 0));
  CHECK(text.size == 0);
}
