// COBS: every length around the block size, in place, against the rule as plainly as it can be written.
#include "wirebond/stuffing.hpp"

#include <doctest/doctest.h>

#include <cstdint>
#include <cstring>
#include <random>
#include <vector>

#include "wirebond/format.hpp"

using wirebond::cobs_decode;
using wirebond::cobs_encode_in_place;
using Bytes = std::vector<std::uint8_t>;

namespace {

/// Cut at the zeros, and after 254 bytes without one; each piece is preceded by its size plus one.
Bytes by_the_rule(const Bytes& data) {
  Bytes out;
  std::size_t begin = 0;
  while (true) {
    std::size_t end = begin;
    while (end < data.size() && data[end] != 0 && end - begin < 254) ++end;
    out.push_back(static_cast<std::uint8_t>(end - begin + 1));
    out.insert(out.end(), data.begin() + static_cast<std::ptrdiff_t>(begin),
               data.begin() + static_cast<std::ptrdiff_t>(end));
    if (end == data.size()) return out;
    begin = end - begin < 254 ? end + 1 : end;  // a full piece stands for no zero
  }
}

Bytes encode(const Bytes& data) {
  Bytes buffer(data.size() + wirebond::cobs_overhead(data.size()), 0xCC);  // exactly the room it may use
  if (!data.empty()) std::memcpy(buffer.data() + 1, data.data(), data.size());
  buffer.resize(cobs_encode_in_place(buffer.data(), data.size()));
  return buffer;
}

void check_round_trip(const Bytes& data) {
  const Bytes stuffed = encode(data);
  CAPTURE(data.size());
  REQUIRE(stuffed == by_the_rule(data));
  REQUIRE(std::memchr(stuffed.data(), 0, stuffed.size()) == nullptr);
  Bytes back(data.size());  // exactly the room it may use
  back.reserve(1);          // but a real address
  const std::ptrdiff_t size = cobs_decode(stuffed.data(), stuffed.size(), back.data(), back.size());
  REQUIRE(size == static_cast<std::ptrdiff_t>(data.size()));
  REQUIRE(back == data);
  if (!data.empty()) {
    REQUIRE(cobs_decode(stuffed.data(), stuffed.size(), back.data(), data.size() - 1) == -1);
  }
}

}  // namespace

TEST_CASE("examples of the paper") {
  CHECK(encode({}) == Bytes{0x01});
  CHECK(encode({0x00}) == Bytes{0x01, 0x01});
  CHECK(encode({0x00, 0x00}) == Bytes{0x01, 0x01, 0x01});
  CHECK(encode({0x11, 0x22, 0x00, 0x33}) == Bytes{0x03, 0x11, 0x22, 0x02, 0x33});
  CHECK(encode({0x11, 0x00, 0x00, 0x00}) == Bytes{0x02, 0x11, 0x01, 0x01, 0x01});
}

TEST_CASE("every size from 0 to 600 comes back, with no zero, few and many") {
  std::mt19937 random(1);
  for (std::size_t size = 0; size <= 600; ++size) {
    Bytes data(size);
    check_round_trip(data);
    for (auto& byte : data) byte = static_cast<std::uint8_t>(1 + random() % 255);
    check_round_trip(data);
    for (const std::size_t at :
         {std::size_t{0}, std::size_t{253}, std::size_t{254}, std::size_t{255}, std::size_t{508}, size - 1}) {
      if (at >= size) continue;
      Bytes with_zero = data;
      with_zero[at] = 0;
      check_round_trip(with_zero);
    }
    for (auto& byte : data) byte = static_cast<std::uint8_t>(random() % 4);
    check_round_trip(data);
  }
}

TEST_CASE("what no encoder makes is refused") {
  std::uint8_t to[300];
  const auto refused = [&](const Bytes& bytes) { return cobs_decode(bytes.data(), bytes.size(), to, sizeof to) == -1; };
  CHECK(refused({0x02}));
  CHECK(refused({0xFF, 0x01}));
  CHECK(refused({0x03, 0x11, 0x22, 0x04, 0x33}));
  CHECK(refused({0x00}));
  CHECK(refused({0x02, 0x11, 0x00}));
  Bytes full(255, 0x55);
  full[0] = 0xFF;
  CHECK_FALSE(refused(full));
  full.pop_back();
  CHECK(refused(full));
}
