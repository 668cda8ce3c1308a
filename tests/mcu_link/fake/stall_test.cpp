// A rover whose program and interrupts stand still, as they do while a flash page is erased, and whose host goes on:
// what came meanwhile is not acted on, and the account closes.
#include <doctest/doctest.h>

#include <cstdint>

#include "diffdrive_link.hpp"
#include "wirebond/fake/uart.hpp"

namespace fake = wirebond::fake;

namespace {

struct Rover {
  void on(const diffdrive::Velocity&) { ++commands; }
  void stop() { ++stops; }
  void safe_mode() { ++safe_modes; }
  std::uint32_t commands = 0;
  std::uint32_t stops = 0;
  std::uint32_t safe_modes = 0;
};

template <class Port>
struct Bench {
  fake::Line in{diffdrive::baud, 10};
  fake::Line out{diffdrive::baud, 10};
  Port uart{in, out};
  Rover rover;
  diffdrive::McuBuffers<256, 256> buffers;
  diffdrive::McuLink<Rover, Port, decltype(buffers)> link{rover, uart, buffers};
  fake::Time now = 0;

  void tick(fake::Time time) {
    now += time;
    uart.run(now, link);
    link.poll(static_cast<std::uint32_t>(now / 1000));
  }
  void drive() {
    std::uint8_t frame[diffdrive::Velocity::Info::max_frame_bytes];
    std::size_t size = 0;
    REQUIRE(diffdrive::encode(diffdrive::Velocity{0.5F, 0.0F}, frame, sizeof frame, size) == wirebond::Status::ok);
    in.put(frame, size, now);
  }
  void check_sums() const {
    const wirebond::ReceiveAccount ring = link.receive_account();
    CHECK(ring.received == ring.handed_out + ring.lapped + ring.dropped + static_cast<std::uint32_t>(link.unread()));
    CHECK(link.receiver().bytes() == ring.handed_out);
    CHECK(link.receiver().account().settled() + link.receiver().pending() == ring.handed_out);
    CHECK((uart.counts().written - ring.received) % 256 == 0);
  }
};

}  // namespace

TEST_CASE_TEMPLATE("commands that came while everything stood still are not acted on", Port, fake::Uart,
                   fake::ClockedUart) {
  Bench<Port> bench;
  for (int i = 0; i < 20; ++i) bench.tick(1'000'000);
  bench.drive();
  for (int i = 0; i < 3; ++i) bench.tick(1'000'000);
  REQUIRE(bench.rover.commands == 1);
  for (int i = 0; i < 1'000; ++i) bench.drive();  // 11 000 bytes, and the last of them 0.95 s later
  bench.uart.mask(bench.now + 990'000'000);
  bench.tick(990'000'000);
  CHECK(bench.rover.commands == 1);
  const wirebond::ReceiveAccount account = bench.link.receive_account();
  CHECK(account.laps_unknown == 1);
  CHECK(account.dropped > 0);
  CHECK(account.lapped == 0);
  bench.check_sums();
  bench.tick(20'000'000);
  CHECK(bench.rover.stops == 1);  // it counts from the last command that was acted on
  bench.drive();
  for (int i = 0; i < 3; ++i) bench.tick(1'000'000);
  CHECK(bench.rover.commands == 2);
  bench.check_sums();
}

TEST_CASE(
    "with a clock and interrupts that are served, a poll that stalls acts on what is fresh, and on nothing else") {
  Bench<fake::ClockedUart> bench;
  bench.tick(1'000'000);
  for (int i = 0; i < 1'150; ++i) bench.drive();  // without a pause: the ring is lapped all the time
  bench.tick(1'100'000'000);
  const wirebond::ReceiveAccount account = bench.link.receive_account();
  CHECK(account.laps_unknown == 0);
  CHECK(account.received == bench.uart.counts().written);
  CHECK(account.lapped > 10'000);
  CHECK(bench.link.counters().late < 15);  // what came before the older of the two stamps that are kept
  CHECK(bench.rover.commands > 5);         // what is left in the ring came within the last 22 ms
  CHECK(bench.rover.stops == 1);           // nobody acted for a second
  CHECK_FALSE(bench.link.struck(diffdrive::Action::stop));
  bench.check_sums();
}
