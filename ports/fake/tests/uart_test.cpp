// The simulated UART does what a real one does: its events, its DMA, its errors, its refusals.
#include "wirebond/fake/uart.hpp"

#include <doctest/doctest.h>

#include <array>
#include <cstdint>
#include <string>
#include <vector>

using wirebond::fake::Behaviour;
using wirebond::fake::Draw;
using wirebond::fake::Event;
using wirebond::fake::Fate;
using wirebond::fake::Fault;
using wirebond::fake::Line;
using wirebond::fake::never;
using wirebond::fake::OnLineError;
using wirebond::fake::run_both;
using wirebond::fake::Time;
using wirebond::fake::Uart;
using Bytes = std::vector<std::uint8_t>;

namespace {

/// Two lines of 1 Mbaud 8N1, a UART on them, and a handler that logs its calls.
struct Bench {
  Line in{1'000'000, 10};
  Line out{1'000'000, 10};
  Uart uart{in, out};
  std::array<std::uint8_t, 8> ring{};
  std::string log;  ///< r, t, e, p: a letter for each event
  std::vector<std::size_t> places;
  bool restarts = false;

  void on_received() {
    log += 'r';
    places.push_back(uart.receive_position());
  }
  void on_transmitted() { log += 't'; }
  void on_error() {
    log += 'e';
    if (restarts) uart.start_receive(ring.data(), ring.size());
  }
  void on_pended() { log += 'p'; }

  bool start() { return uart.start_receive(ring.data(), ring.size()); }
  void run(Time until) { uart.run(until, *this); }
};

Bytes counting(std::size_t size) {
  Bytes bytes(size);
  for (std::size_t i = 0; i < size; ++i) bytes[i] = static_cast<std::uint8_t>(i + 1);
  return bytes;
}

}  // namespace

TEST_CASE("DMA fills the ring in circles; half, full and idle tell how far") {
  Bench bench;
  REQUIRE(bench.start());
  bench.in.put(counting(11), 0);
  bench.run(200'000);
  CHECK(bench.log == "rrr");
  CHECK(bench.places == std::vector<std::size_t>{4, 0, 3});
  CHECK(bench.uart.receive_position() == 3);
  CHECK(bench.ring == std::array<std::uint8_t, 8>{9, 10, 11, 4, 5, 6, 7, 8});  // the reader was lapped, as in hardware
  CHECK(bench.uart.counts().written == 11);
  CHECK(bench.in.count(Fate::received) == 11);
}

TEST_CASE("an idle event comes one byte after the last, once, and not in a pause that is shorter") {
  Bench bench;
  REQUIRE(bench.start());
  bench.in.put(1, 0);
  bench.in.put(2, 19'000);  // 9 microseconds of pause
  bench.run(38'999);
  CHECK(bench.log.empty());
  bench.run(39'000);
  CHECK(bench.log == "r");
  bench.run(1'000'000);
  CHECK(bench.log == "r");
}

TEST_CASE("bytes that come while reception is stopped are unheard") {
  Bench bench;
  bench.in.put(counting(2), 0);
  bench.run(20'000);
  REQUIRE(bench.start());
  bench.in.put(3, 20'000);
  bench.run(60'000);
  CHECK(bench.ring[0] == 3);
  CHECK(bench.in.count(Fate::unheard) == 2);
  CHECK(bench.in.closes());
}

TEST_CASE("a line error stops reception before its event, and the place stays until reception is started again") {
  for (const Fault fault : {Fault::framing, Fault::noise, Fault::overrun}) {
    Bench bench;
    REQUIRE(bench.start());
    bench.in.put(counting(2), 0);
    bench.in.put(3, 0, fault);
    bench.in.put(counting(2), 0);
    bench.run(50'000);
    CHECK(bench.log == "e");
    CHECK_FALSE(bench.uart.receiving());
    CHECK(bench.uart.receive_position() == (fault == Fault::overrun ? 2u : 3u));
    CHECK(bench.in.count(Fate::unheard) == 2);
    REQUIRE(bench.start());
    CHECK(bench.uart.receive_position() == 0);
    bench.in.put(7, 50'000);
    bench.run(60'000);
    CHECK(bench.ring[0] == 7);
    CHECK(bench.in.closes());
  }
}

TEST_CASE("a damaged byte is in the ring or not, as the family has it") {
  for (const bool keeps : {true, false}) {
    Bench bench;
    bench.restarts = true;
    bench.uart.behaviour.keeps_damaged = keeps;
    REQUIRE(bench.start());
    bench.in.put(1, 0, Fault::framing);
    bench.in.put(2, 0);
    bench.run(20'000);
    CHECK(bench.uart.counts().written == (keeps ? 2u : 1u));
    CHECK(bench.in.count(Fate::damaged) == (keeps ? 1u : 0u));
    CHECK(bench.in.count(Fate::dropped) == (keeps ? 0u : 1u));
    CHECK(bench.ring[0] == 2);
  }
}

TEST_CASE("where errors only leave a flag there is no event, and each kind is taken once") {
  Bench bench;
  bench.uart.behaviour.on_line_error = OnLineError::flag;
  REQUIRE(bench.start());
  bench.in.put(1, 0, Fault::framing);
  bench.in.put(2, 0, Fault::overrun);
  bench.in.put(3, 0);
  bench.run(30'000);
  CHECK(bench.log.empty());
  CHECK(bench.uart.receive_position() == 2);
  const wirebond::LineErrors errors = bench.uart.take_line_errors();
  CHECK(errors.framing);
  CHECK(errors.overrun);
  CHECK_FALSE(errors.noise);
  CHECK_FALSE(bench.uart.take_line_errors().any());
}

TEST_CASE("where errors do not stop reception they are told, and bytes go on into the ring") {
  Bench bench;
  bench.uart.behaviour.on_line_error = OnLineError::tell;
  REQUIRE(bench.start());
  bench.in.put(1, 0, Fault::framing);
  bench.in.put(Bytes{2, 3}, 0);
  bench.run(30'000);
  CHECK(bench.log == "e");
  CHECK(bench.uart.receiving());
  CHECK(bench.uart.receive_position() == 3);
}

TEST_CASE("until the error's interrupt runs DMA goes on; while it is being stopped a start is refused") {
  Bench bench;
  bench.uart.behaviour.abort_time = 50'000;
  REQUIRE(bench.start());
  bench.in.put(1, 0, Fault::framing);
  bench.in.put(counting(4), 0);
  bench.uart.mask(30'000);
  bench.run(30'000);
  CHECK(bench.uart.counts().written == 3);
  CHECK_FALSE(bench.uart.receiving());
  CHECK(bench.log.find('e') == std::string::npos);
  CHECK_FALSE(bench.start());
  bench.run(80'000);
  CHECK(bench.log.find('e') != std::string::npos);
  CHECK(bench.start());
  CHECK(bench.uart.counts().receive_refused == 1);
}

TEST_CASE("a run costs its restart gap, goes at the byte clock, and completes with its last stop bit") {
  Bench bench;
  bench.uart.behaviour.restart_gap = 3'000;
  const Bytes bytes = counting(3);
  REQUIRE(bench.uart.start_transmit(bytes.data(), bytes.size()));
  CHECK_FALSE(bench.uart.start_transmit(bytes.data(), 1));  // busy
  bench.run(32'999);
  CHECK(bench.log.empty());
  bench.run(33'000);
  CHECK(bench.log == "t");
  CHECK(bench.out.read(33'000) == bytes);
  CHECK(bench.uart.start_transmit(bytes.data(), 1));
  CHECK(bench.uart.counts().transmit_refused == 1);
}

TEST_CASE("DMA reads a byte when its turn comes, not before") {
  Bench bench;
  Bytes bytes = counting(3);
  REQUIRE(bench.uart.start_transmit(bytes.data(), bytes.size()));
  bench.run(10'000);  // the second has begun
  bytes = {11, 12, 13};
  bench.run(30'000);
  CHECK(bench.out.read(30'000) == Bytes{1, 2, 13});
}

TEST_CASE("a run that is stopped keeps its byte on the line, and completes never") {
  Bench bench;
  const Bytes bytes = counting(5);
  REQUIRE(bench.uart.start_transmit(bytes.data(), bytes.size()));
  bench.run(15'000);
  bench.uart.stop_transmit();
  bench.run(200'000);
  CHECK(bench.log.empty());
  CHECK(bench.out.read(200'000) == Bytes{1, 2});
  CHECK(bench.uart.counts().broken_off == 3);
  CHECK(bench.uart.counts().taken == bench.out.put_count() + bench.uart.counts().broken_off);
}

TEST_CASE("a run that is complete and stopped before its event completes never") {
  Bench bench;
  const Bytes bytes = counting(2);
  REQUIRE(bench.uart.start_transmit(bytes.data(), bytes.size()));
  bench.uart.hold(Event::transmitted);
  bench.run(50'000);
  CHECK(bench.uart.transmitting());
  bench.uart.stop_transmit();
  bench.uart.release(Event::transmitted);
  bench.run(100'000);
  CHECK(bench.log.empty());
  CHECK_FALSE(bench.uart.transmitting());
}

TEST_CASE("a run that dies tells of an error, never of its completion") {
  Bench bench;
  const Bytes bytes = counting(5);
  REQUIRE(bench.uart.start_transmit(bytes.data(), bytes.size()));
  bench.run(25'000);
  bench.uart.kill_transmit();
  bench.run(200'000);
  CHECK(bench.log == "e");
  CHECK(bench.uart.counts().broken_off == 2);
  CHECK(bench.uart.start_transmit(bytes.data(), 1));
}

TEST_CASE("a reset leaves nothing behind: no reception, no run, no event") {
  Bench bench;
  bench.uart.behaviour.abort_time = 50'000;
  REQUIRE(bench.start());
  const Bytes bytes = counting(5);
  REQUIRE(bench.uart.start_transmit(bytes.data(), bytes.size()));
  bench.uart.pend();
  bench.in.put(counting(4), 0);
  bench.in.put(5, 0, Fault::framing);
  bench.uart.mask(55'000);
  bench.run(55'000);  // the error was served, and DMA is being stopped
  bench.log.clear();
  bench.uart.reset();
  bench.run(1'000'000);
  CHECK(bench.log.empty());
  CHECK(bench.uart.receive_position() == 0);
  CHECK_FALSE(bench.uart.receiving());
  CHECK_FALSE(bench.uart.transmitting());
  CHECK(bench.start());
}

TEST_CASE("starts are refused as often as the script says") {
  Bench bench;
  bench.uart.refuse_receives(2);
  CHECK_FALSE(bench.start());
  CHECK_FALSE(bench.start());
  CHECK(bench.start());
  bench.uart.refuse_transmits(1);
  const Bytes bytes = counting(1);
  CHECK_FALSE(bench.uart.start_transmit(bytes.data(), 1));
  CHECK(bench.uart.start_transmit(bytes.data(), 1));
}

TEST_CASE("a script can put events into any order, and two of a kind merge") {
  Bench bench;
  REQUIRE(bench.start());
  bench.uart.hold(Event::half);
  bench.uart.hold(Event::full);
  bench.uart.hold(Event::idle);
  bench.in.put(counting(23), 0);  // two and seven eighths of the ring
  bench.run(300'000);
  CHECK(bench.log.empty());
  bench.uart.release(Event::idle);
  bench.run(300'000);
  bench.uart.release(Event::full);
  bench.run(300'000);
  bench.uart.release(Event::half);
  bench.run(300'000);
  CHECK(bench.places == std::vector<std::size_t>{7, 7, 7});
  bench.uart.raise_now(Event::half);
  bench.uart.raise_now(Event::full);
  bench.run(300'000);
  CHECK(bench.log == "rrrrr");
}

TEST_CASE("a pended interrupt is served once, also when it is pended twice, and not while interrupts are masked") {
  Bench bench;
  bench.uart.mask(5'000);
  bench.uart.pend();
  bench.uart.pend();
  bench.run(4'999);
  CHECK(bench.log.empty());
  bench.run(10'000);
  CHECK(bench.log == "p");
}

TEST_CASE("memory out of the DMA's reach is reported") {
  Bench bench;
  std::array<std::uint8_t, 8> bytes{};
  CHECK(bench.uart.reaches(bytes.data(), 8));
  bench.uart.set_unreachable(bytes.data() + 4, 2);
  CHECK(bench.uart.reaches(bytes.data(), 4));
  CHECK_FALSE(bench.uart.reaches(bytes.data(), 5));
  CHECK_FALSE(bench.uart.reaches(bytes.data() + 5, 1));
  CHECK(bench.uart.reaches(bytes.data() + 6, 2));
}

namespace {

/// Sends received bytes back, as soon as possible.
struct Echo {
  Uart& uart;
  std::array<std::uint8_t, 64> ring{};
  Bytes waiting{};
  Bytes run{};
  std::size_t read = 0;

  void look() {
    for (; read != uart.receive_position(); read = (read + 1) % ring.size()) waiting.push_back(ring[read]);
    uart.pend();
  }
  void on_received() { look(); }
  void on_error() {
    look();
    read = 0;
    uart.start_receive(ring.data(), ring.size());
  }
  void on_transmitted() {
    run.clear();
    on_pended();
  }
  void on_pended() {
    if (!run.empty() || waiting.empty()) return;
    run.swap(waiting);
    if (!uart.start_transmit(run.data(), run.size())) run.swap(waiting);
  }
};

}  // namespace

TEST_CASE("under every kind of mischief at once the sums close, and runs repeat") {
  const auto run = [](std::uint64_t seed) {
    Line there(1'000'000, 10, seed);
    Line back(1'000'000, 10, seed + 1);
    there.faults = {10'000, 5'000, 2'000, 1'000};
    Behaviour behaviour;
    behaviour.restart_gap = 4'000;
    behaviour.interrupt_delay = 30'000;
    behaviour.abort_time = 20'000;
    behaviour.keeps_damaged = seed % 2 == 0;
    behaviour.spurious = 20'000;
    behaviour.swallowed = 50'000;
    behaviour.receive_refused = 0;
    behaviour.transmit_refused = 100'000;
    behaviour.transmit_dies = 500;
    Uart uart(there, back, behaviour, seed);
    Echo echo{uart};
    REQUIRE(uart.start_receive(echo.ring.data(), echo.ring.size()));
    Draw draw(seed);
    Bytes got;
    Time now = 0;
    for (int i = 0; i < 5'000; ++i) {
      there.put(counting(draw.below(20)), now);
      if (draw.chance(10'000)) {
        there.unplug(now);
      } else {
        there.plug();
      }
      now += draw.below(300'000);
      uart.run(now, echo);
      if (!uart.receiving()) echo.on_error();      // its restart was refused
      if (!uart.transmitting()) echo.run.clear();  // it died
      const Bytes more = back.read(now);
      got.insert(got.end(), more.begin(), more.end());
      REQUIRE(there.closes());
      REQUIRE(back.closes());
      REQUIRE(uart.counts().written == there.count(Fate::received) + there.count(Fate::damaged));
      REQUIRE(uart.counts().taken == back.put_count() + uart.counts().broken_off + uart.waiting());
    }
    CHECK(uart.counts().errors > 100);
    CHECK(uart.counts().runs > 1'000);
    CHECK(uart.counts().broken_off > 0);
    CHECK(got.size() > 20'000);
    return got;
  };
  CHECK(run(1) == run(1));
  CHECK(run(1) != run(2));
}

TEST_CASE("two UARTs share one time line") {
  Line there(1'000'000, 10);
  Line back(1'000'000, 10);
  Uart mcu(there, back);
  Uart host(back, there);
  Echo echo{mcu};
  Bench bench;  // for its handler
  std::array<std::uint8_t, 64> ring{};
  REQUIRE(mcu.start_receive(echo.ring.data(), echo.ring.size()));
  REQUIRE(host.start_receive(ring.data(), ring.size()));
  const Bytes bytes = counting(12);
  REQUIRE(host.start_transmit(bytes.data(), bytes.size()));
  run_both(1'000'000, mcu, echo, host, bench);
  CHECK(Bytes(ring.begin(), ring.begin() + 12) == bytes);
  CHECK(host.now() == mcu.now());
}
