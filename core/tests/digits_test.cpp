// Numbers in characters: the ends of every type, and what is not a number.
#include "wirebond/digits.hpp"

#include <doctest/doctest.h>

#include <cstdint>
#include <limits>
#include <string>

namespace {

template <class T, std::uint8_t Base = 10, std::uint8_t Decimals = 0>
std::string written(T number, std::size_t size = 0) {
  if (size == 0) size = wirebond::digits_size<Base, Decimals>(number);
  std::string out(size, '?');
  if (!wirebond::write_digits<Base, Decimals>(reinterpret_cast<std::uint8_t*>(out.data()), size, number)) return "";
  return out;
}

template <class T, unsigned Width = 8 * sizeof(T), std::uint8_t Base = 10, std::uint8_t Decimals = 0>
bool reads(const std::string& text, T expected) {
  T number = 0;
  const auto* const from = reinterpret_cast<const std::uint8_t*>(text.data());
  return wirebond::read_digits<T, Width, Base, Decimals>(from, text.size(), number) && number == expected;
}

template <class T, unsigned Width = 8 * sizeof(T), std::uint8_t Base = 10, std::uint8_t Decimals = 0>
bool refuses(const std::string& text) {
  T number = 42;
  const auto* const from = reinterpret_cast<const std::uint8_t*>(text.data());
  return !wirebond::read_digits<T, Width, Base, Decimals>(from, text.size(), number) && number == 42;
}

template <class T>
void check_ends() {
  for (const T end : {std::numeric_limits<T>::min(), std::numeric_limits<T>::max()}) {
    const std::string text = std::to_string(end);
    CHECK(written(end) == text);
    CHECK(reads<T>(text, end));
    if (end == 0) continue;
    CHECK(refuses<T>(text + "0"));
    std::string beyond = text;  // the last digit of none of these is a 9
    beyond.back() = static_cast<char>(beyond.back() + 1);
    CHECK(refuses<T>(beyond));
  }
}

}  // namespace

TEST_CASE("the ends of every type are written and read, and what is beyond them is refused") {
  check_ends<std::uint8_t>();
  check_ends<std::int8_t>();
  check_ends<std::uint16_t>();
  check_ends<std::int16_t>();
  check_ends<std::uint32_t>();
  check_ends<std::int32_t>();
  check_ends<std::uint64_t>();
  check_ends<std::int64_t>();
  CHECK(reads<std::uint32_t, 24>("16777215", 16777215));
  CHECK(refuses<std::uint32_t, 24>("16777216"));
  CHECK(reads<std::int32_t, 24>("-8388608", -8388608));
  CHECK(refuses<std::int32_t, 24>("8388608"));
}

TEST_CASE("a point stands before the last decimals, and zeros before the digits") {
  CHECK(written<std::int16_t, 10, 2>(-5) == "-0.05");
  CHECK(written<std::int16_t, 10, 2>(1234) == "12.34");
  CHECK(written<std::int16_t, 10, 2>(-5, 8) == "-0000.05");
  CHECK(written<std::uint16_t, 16>(0xAB, 4) == "00AB");
  CHECK(written<std::uint16_t>(1234, 3).empty());
  CHECK(reads<std::int16_t, 16, 10, 2>("-.05", -5));
  CHECK(reads<std::int16_t, 16, 10, 2>("12.345", 1235));
  CHECK(reads<std::int16_t, 16, 10, 2>("12.3449", 1234));
  CHECK(refuses<std::int16_t, 16, 10, 2>("1.2.3"));
  CHECK(refuses<std::int16_t>("1.0"));
  CHECK(refuses<std::int16_t, 16, 10, 2>("327.675"));
}

TEST_CASE("blanks and a sign may come first, and nothing else than digits behind them") {
  CHECK(reads<std::int16_t>("  +7", 7));
  CHECK(reads<std::uint16_t, 16, 16>(" fF", 255));
  for (const char* const text : {"", " ", "-", "+", "1 ", "- 1", "--1", "0x1", "1e3", "A"}) {
    CHECK(refuses<std::int16_t>(text));
  }
  CHECK(refuses<std::uint16_t>("-0"));
  CHECK(refuses<std::uint16_t, 16, 16>("-1"));
}
