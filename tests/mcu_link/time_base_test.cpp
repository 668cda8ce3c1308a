// A poll that is given the wrong time: milliseconds for microseconds, a clock that stands still, one that steps back.
#include <doctest/doctest.h>

#include <cstdint>
#include <string>

#include "diffdrive_link.hpp"
#include "scripted_port.hpp"
#include "wirebond/mcu/link.hpp"

using wirebond::Why;

namespace {

/// Knows the tick of a vendor's library beside the time that `poll` is given.
struct TickingPort : ScriptedPort {
  std::uint32_t tick_ms() const { return ticks; }
  std::uint32_t ticks = 0xFFFFFFFFu - 1'000;  // it wraps in the tests
};

struct ClockedPort : ScriptedPort {
  std::uint32_t now_us() const { return clock_us; }
  std::uint32_t clock_us = 0;
};

struct UnpacedPort : ScriptedPort {
  static constexpr bool is_unpaced = true;
};

struct Rover {
  void on(const diffdrive::Velocity&) { ++velocities; }
  void stop() { actions += "stop "; }
  void safe_mode() { actions += "safe_mode "; }

  int velocities = 0;
  std::string actions;
};

template <class Port = ScriptedPort>
struct Bench {
  explicit Bench(std::uint32_t start_us = 0) { link.poll(start_us); }

  void come(const Bytes& bytes) {
    port.arrive(bytes);
    link.on_received();
  }
  void come_velocity() {
    Bytes frame(diffdrive::Velocity::Info::max_frame_bytes);
    std::size_t size = 0;
    REQUIRE(diffdrive::encode(diffdrive::Velocity{0.5F, 0.0F}, frame.data(), frame.size(), size) ==
            wirebond::Status::ok);
    come(frame);
  }
  /// Nothing is to be sent or begun again, which `why` would name first.
  void serve() {
    if (port.pended) link.on_pended();
    port.pended = false;
  }

  Port port;
  Rover rover;
  diffdrive::McuBuffers<1024, 64, 4> buffers;
  diffdrive::McuLink<Rover, Port, decltype(buffers)> link{rover, port, buffers};
};

}  // namespace

TEST_CASE("milliseconds given as microseconds are found by bytes that come faster than the line carries them") {
  Bench bench;
  std::uint32_t ms_passed = 0;
  for (; ms_passed < 5'000; ++ms_passed) {  // a command each 50 ms: 2 % of the line
    if (ms_passed % 50 == 0) bench.come_velocity();
    bench.link.poll(ms_passed);
    bench.serve();
  }
  CHECK(bench.rover.velocities == 100);
  CHECK(bench.link.why() == Why::wrong_time_base);
  for (; ms_passed < 55'000; ++ms_passed) bench.link.poll(ms_passed);  // and then no host
  bench.serve();
  CHECK(bench.rover.actions.empty());  // which is what `why` warns of
  CHECK(bench.link.why() == Why::wrong_time_base);
}

TEST_CASE("a clock that stands still is found in the same way") {
  Bench bench;
  for (int i = 0; i < 100; ++i) {
    bench.come_velocity();
    bench.link.poll(7);
  }
  bench.serve();
  CHECK(bench.link.why() == Why::wrong_time_base);
}

TEST_CASE("a full line is not a fault of the clock, with a tick of ten milliseconds, stalls and a fast sender") {
  Bench bench;
  std::uint32_t at_us = 0;
  double sent = 0;
  for (int i = 0; i < 30'000; ++i) {
    at_us += i % 1000 == 999 ? 60 * ms : ms;  // now and then the poll stalls, for less than the ring takes to fill
    for (; sent < at_us * 1.05 * 11'520 / 1e6; sent += 11) bench.come_velocity();  // 5 % more than the file says
    bench.link.poll(at_us / (10 * ms) * 10 * ms);
    bench.serve();
  }
  CHECK(bench.rover.velocities > 30'000);
  CHECK(bench.link.why() == Why::nothing);
}

TEST_CASE("a port without a pace may bring bytes at any rate") {
  Bench<UnpacedPort> bench;
  for (int i = 0; i < 1'000; ++i) {
    bench.come_velocity();
    bench.link.poll(static_cast<std::uint32_t>(i));
    bench.serve();
  }
  CHECK(bench.link.why() == Why::nothing);
}

TEST_CASE("`poll_ms` takes milliseconds, and its clock may wrap") {
  std::uint32_t now_ms = 0xFFFFFFFFu - 500;
  Bench bench(now_ms * ms);
  bench.come_velocity();
  bench.link.poll_ms(++now_ms);
  for (int i = 0; i < 998; ++i) bench.link.poll_ms(++now_ms);
  CHECK(bench.rover.actions.empty());
  bench.link.poll_ms(++now_ms);
  CHECK(bench.rover.actions == "stop ");
  CHECK(bench.link.counters().clock_steps == 0);
  CHECK(bench.link.counters().slow_polls == 0);
}

TEST_CASE("a port's tick shows milliseconds given as microseconds without a byte received") {
  for (const bool is_right : {true, false}) {
    CAPTURE(is_right);
    Bench<TickingPort> bench((0xFFFFFFFFu - 1'000) * (is_right ? ms : 1));
    for (std::uint32_t i = 0; i < 2'000; ++i) {
      ++bench.port.ticks;
      if (is_right) {
        bench.link.poll_ms(bench.port.ticks);
      } else {
        bench.link.poll(bench.port.ticks);
      }
      bench.serve();
    }
    CHECK(bench.link.why() == (is_right ? Why::nothing_heard : Why::wrong_time_base));
  }
}

TEST_CASE("a tick that stands still, as while flash is erased, is not a fault of the poll's clock") {
  Bench<TickingPort> bench;
  for (std::uint32_t i = 0; i < 5'000; ++i) {
    if (i < 1'000 || i > 4'000) ++bench.port.ticks;
    bench.link.poll(i * ms);
    bench.serve();
  }
  CHECK(bench.link.why() == Why::nothing_heard);
}

TEST_CASE("a port's clock that is not the one that poll is given is found, whichever is the slower one") {
  for (const std::uint32_t unit : {1u, ms, ms * ms}) {
    CAPTURE(unit);
    Bench<ClockedPort> bench;
    for (std::uint32_t i = 0; i < 2'000; ++i) {
      bench.port.clock_us = i * unit;
      bench.link.poll(i * ms);
      bench.serve();
    }
    CHECK(bench.link.why() == (unit == ms ? Why::nothing_heard : Why::wrong_time_base));
  }
}

TEST_CASE("a clock that steps back once strikes nothing, makes nothing stale or late, and is counted") {
  for (const std::uint32_t step_us : {1u, 1'500u, 1'000'000u}) {
    for (const std::uint32_t start_us : {0u, 0xFFFFFFFFu - 1'200 * ms}) {
      CAPTURE(step_us);
      CAPTURE(start_us);
      Bench bench(start_us);
      std::uint32_t now_us = start_us;
      const auto poll = [&](int times) {
        for (; times != 0; --times) {
          bench.link.poll(now_us += ms);
          bench.serve();
        }
      };
      poll(1'200);
      bench.come_velocity();
      poll(10);
      now_us -= step_us;
      bench.come_velocity();
      poll(1);
      CHECK(bench.rover.velocities == 2);
      CHECK(bench.link.state() == wirebond::LinkState::up);
      CHECK(bench.link.counters().clock_steps == (step_us > ms ? 1 : 0));
      CHECK(bench.link.counters().slow_polls == 0);
      CHECK(bench.link.counters().late == 0);
      CHECK(bench.link.receive_account().laps_unknown == 0);
      CHECK(bench.link.why() == (step_us > ms ? Why::clock_steps_back : Why::nothing));
      CHECK(bench.link.next_due_us(now_us) - now_us <= 100 * ms);
      bench.rover.actions.clear();
      poll(950);
      CHECK(bench.rover.actions.empty());
      poll(60);
      CHECK(bench.rover.actions == "stop ");  // a second after the last command, as if there had been no step
      poll(2'100);
      CHECK(bench.rover.actions == "stop safe_mode ");
    }
  }
}

TEST_CASE("a larger step back is as long a time without a poll: deadlines strike") {
  Bench bench(10'000 * ms);
  bench.link.poll(8'999 * ms);
  CHECK(bench.rover.actions == "stop safe_mode ");
  CHECK(bench.link.counters().clock_steps == 0);
}

TEST_CASE("with a clock at the port, which steps back as well, commands go on to act and the clock service is right") {
  Bench<ClockedPort> bench;
  std::uint32_t& clock_us = bench.port.clock_us;
  for (int i = 0; i < 100; ++i) {
    clock_us += i == 50 ? -500u : ms;
    bench.come_velocity();
    bench.link.poll(clock_us += 100);
    bench.serve();
  }
  CHECK(bench.rover.velocities == 100);
  CHECK(bench.link.counters().clock_steps == 1);
  CHECK(bench.link.counters().late == 0);
  CHECK(bench.rover.actions.empty());
}
