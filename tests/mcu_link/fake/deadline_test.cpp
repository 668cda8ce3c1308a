// The deadlines of diffdrive over Link: one tick after their time, whatever the clock says, also while it wraps.
#include <doctest/doctest.h>

#include <cstdint>
#include <vector>

#include "diffdrive_link.hpp"
#include "wirebond/fake/uart.hpp"

namespace fake = wirebond::fake;

namespace {

struct Rover {
  bool moving = false;
  bool commanded = false;
  std::vector<std::uint32_t> stops;
  std::vector<std::uint32_t> safe_modes;
  std::uint32_t now_us = 0;

  void on(const diffdrive::Velocity& velocity) {
    moving = velocity.linear != 0.0F;
    commanded = true;
  }
  void stop() {
    moving = false;
    stops.push_back(now_us);
  }
  void safe_mode() { safe_modes.push_back(now_us); }
};

struct Bench {
  fake::Line in{diffdrive::baud, 10};
  fake::Line out{diffdrive::baud, 10};
  fake::Uart uart{in, out};
  Rover rover;
  diffdrive::McuBuffers<256, 256> buffers;
  diffdrive::McuLink<Rover, fake::Uart, decltype(buffers)> link{rover, uart, buffers};
  fake::Time now = 0;
  std::uint32_t start_us;

  explicit Bench(std::uint32_t start) : start_us(start) {}

  void tick(fake::Time time) {
    now += time;
    uart.run(now, link);
    rover.now_us = start_us + static_cast<std::uint32_t>(now / 1000);
    link.poll(rover.now_us);
  }
  /// The time at which its last byte is there.
  std::uint32_t drive() {
    diffdrive::Velocity velocity;
    velocity.linear = 0.5F;
    std::uint8_t frame[diffdrive::Velocity::Info::max_frame_bytes];
    std::size_t size = 0;
    REQUIRE(diffdrive::encode(velocity, frame, sizeof frame, size) == wirebond::Status::ok);
    return start_us + static_cast<std::uint32_t>(in.put(frame, size, now) / 1000);
  }
};

}  // namespace

TEST_CASE("velocity silence stops at 1 s and is safe at 3 s, within one tick, at any clock time") {
  for (const fake::Time tick : {1'000'000u, 2'000'000u, 5'000'000u}) {
    const auto tick_us = static_cast<std::uint32_t>(tick / 1000);
    // The clock wraps before, between and after the deadlines, at each of their microseconds' neighbours, or not at
    // all.
    for (const std::uint32_t start : {0u, 0x8000'0000u - 1'000'000u, 0u - 1u, 0u - 500'000u, 0u - 1'000'000u,
                                      0u - 1'000'001u, 0u - 1'100'000u, 0u - 3'000'000u, 0u - 3'100'000u}) {
      CAPTURE(tick);
      CAPTURE(start);
      Bench bench(start);
      for (int i = 0; i < 20; ++i) bench.tick(tick);
      CHECK(bench.rover.stops.empty());
      const std::uint32_t heard = bench.drive();
      while (bench.rover.safe_modes.empty()) {
        bench.tick(tick);
        if (bench.rover.commanded && bench.rover.stops.empty()) CHECK(bench.rover.moving);
      }
      REQUIRE(bench.rover.stops.size() == 1);
      REQUIRE(bench.rover.safe_modes.size() == 1);
      CHECK_FALSE(bench.rover.moving);
      // Silence counts from the poll before the one that found the message, which may have come right behind it.
      CHECK(bench.rover.stops[0] - heard + tick_us >= 1'000'000);
      CHECK(bench.rover.stops[0] - heard <= 1'000'000 + tick_us);
      CHECK(bench.rover.safe_modes[0] - heard + tick_us >= 3'000'000);
      CHECK(bench.rover.safe_modes[0] - heard <= 3'000'000 + tick_us);
    }
  }
}

TEST_CASE("silence from the start strikes as well, and each deadline ends and holds back as the file says") {
  Bench bench(0u - 2'000'000u);
  bench.tick(1'000'000);
  const std::uint32_t started = bench.rover.now_us;
  while (bench.rover.safe_modes.empty()) bench.tick(1'000'000);
  CHECK(bench.rover.stops.at(0) - started == 1'000'000);
  CHECK(bench.rover.safe_modes.at(0) - started == 3'000'000);
  bench.drive();
  for (int i = 0; i < 10; ++i) bench.tick(1'000'000);
  CHECK_FALSE(bench.link.struck(diffdrive::Action::stop));
  CHECK_FALSE(bench.link.struck(diffdrive::Action::safe_mode));  // it struck before a message ever came
  CHECK(bench.rover.moving);
  while (bench.rover.safe_modes.size() == 1) bench.tick(1'000'000);
  bench.drive();
  for (int i = 0; i < 10; ++i) bench.tick(1'000'000);
  CHECK_FALSE(bench.rover.moving);  // held back
  CHECK(bench.link.struck(diffdrive::Action::stop));
  CHECK(bench.link.struck(diffdrive::Action::safe_mode));
  bench.link.recover(diffdrive::Action::safe_mode);
  CHECK_FALSE(bench.link.struck(diffdrive::Action::safe_mode));
  bench.drive();
  for (int i = 0; i < 10; ++i) bench.tick(1'000'000);
  CHECK(bench.rover.moving);
}

TEST_CASE("deadlines run while the port does not") {
  Bench bench(0);
  bench.uart.refuse_receives(0xFFFF'FFFF);
  for (int i = 0; i < 1'100; ++i) bench.tick(1'000'000);
  CHECK(bench.link.state() == wirebond::LinkState::down);
  CHECK(bench.rover.stops.size() == 1);
}
