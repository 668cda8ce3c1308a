// A value that is repeated while its writer lives: its rhythm, and the microsecond at which it ends.
#include "wirebond/host/lease.hpp"

#include <doctest/doctest.h>

#include <array>
#include <cstdint>

using wirebond::Lease;

namespace {

constexpr std::uint64_t every = 50'000, begin = 1'000, end = begin + 200'000;
constexpr std::array<std::uint8_t, 3> frame{1, 2, 3};

struct Repeated {
  Repeated() { lease.renew(frame.data(), frame.size(), -1, false, end, begin); }
  std::array<std::uint8_t, 8> room{};
  Lease lease{every, room.data(), room.size()};
};

}  // namespace

TEST_CASE("a lease ends at its time, not a microsecond later") {
  Repeated repeated;
  CHECK_FALSE(repeated.lease.is_over(end - 1));
  CHECK(repeated.lease.is_over(end));
  repeated.lease.end();
  CHECK_FALSE(repeated.lease.is_over(end));
  CHECK_FALSE(repeated.lease.is_due(end));
}

TEST_CASE("the driver of a lease is called for each repetition, and at its end where that comes first") {
  Repeated repeated;
  std::uint64_t now = begin;
  for (int i = 0; i < 4; ++i, now += every) {
    CHECK(repeated.lease.next_us() == now);
    CHECK(repeated.lease.is_due(now));
    CHECK_FALSE(repeated.lease.is_due(now));
  }
  CHECK(repeated.lease.next_us() == end);  // with the fifth repetition
  repeated.lease.renew(frame.data(), frame.size(), -1, false, end + 1, now - 1);
  CHECK(repeated.lease.next_us() == end);  // the rhythm goes on where a lease is renewed
  repeated.lease.renew(frame.data(), frame.size(), -1, false, end - 1, now - 1);
  CHECK(repeated.lease.next_us() == end - 1);
}
