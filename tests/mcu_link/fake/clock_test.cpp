// The clock service on the simulated UART: how exactly the MCU stamps a request and its reply, with a poll every 10 ms.
#include <doctest/doctest.h>

#include "clock_exchange.hpp"

namespace fake = wirebond::fake;
using clock_exchange::exchange;
using clock_exchange::Exchanges;

TEST_CASE("with a clock at the port the offset is right within 20 us, with a poll every 10 ms") {
  for (const bool with_others : {false, true}) {
    const Exchanges found = exchange<fake::ClockedUart>(200, with_others);
    CHECK(found.worst_us <= 20);
    CHECK(found.with_different_times > 190);
  }
}

TEST_CASE("without one it is as wrong as half the time between two polls") {
  const Exchanges found = exchange<fake::Uart>(200, false);
  CHECK(found.worst_us > 1'000);
  CHECK(found.worst_us <= 5'100);
  CHECK(found.with_different_times == 0);
}
