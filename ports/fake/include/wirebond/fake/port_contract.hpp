// Contract of every port of a UART with DMA, as tests over its own board. A port's tests name their bench at the end:
//     PORT_KEEPS_ITS_CONTRACT(Bench);
#pragma once

#include <doctest/doctest.h>

#include <array>
#include <cstddef>
#include <cstdint>
#include <string>
#include <utility>
#include <vector>

#include "wirebond/fake/line.hpp"
#include "wirebond/fake/uart.hpp"
#include "wirebond/mcu/line_errors.hpp"

namespace contract {

using Bytes = std::vector<std::uint8_t>;

/// Replaces a Link: logs its events, and restarts reception as a Link does. All buffers are in it.
template <class Port>
struct Events {
  template <class... Arguments>
  explicit Events(Arguments&&... arguments) : uart(std::forward<Arguments>(arguments)...) {}

  Port uart;
  std::array<std::uint8_t, 16> ring{};
  std::array<std::uint8_t, 3> run{1, 2, 3};
  std::string log;  ///< without the pends
  std::size_t pends = 0;
  std::size_t framing = 0, noise = 0, overruns = 0, parity = 0;  ///< queries that found them
  bool is_started = false;                                       ///< result of the last start that an error requested

  void clear() {
    ring = {};
    log.clear();
    pends = 0;
    forget_errors();
    is_started = false;
  }
  void forget_errors() { framing = noise = overruns = parity = 0; }

  void on_received() {
    log += 'r';
    look();
  }
  void on_transmitted() { log += 't'; }
  void on_error() {
    log += 'e';
    if (!uart.receiving()) is_started = uart.start_receive(ring.data(), ring.size());
  }
  void on_pended() {
    ++pends;
    look();
  }

 private:
  void look() {
    const wirebond::LineErrors errors = uart.take_line_errors();
    framing += errors.framing ? 1 : 0;
    noise += errors.noise ? 1 : 0;
    overruns += errors.overrun ? 1 : 0;
    parity += errors.parity ? 1 : 0;
  }
};

/// A fresh UART of 1 Mbaud and fresh events for each test. `Board` shows them to the port as its registers or library.
template <class Board, class Port>
struct Bench {
  wirebond::fake::Line in{1'000'000, 10};
  wirebond::fake::Line out{1'000'000, 10};
  wirebond::fake::Uart uart{in, out};
  Events<Port>& events;
  Port& port = events.uart;
  Board board;

  explicit Bench(Events<Port>& told) : events(told), board(uart) { events.clear(); }

  bool start() { return port.start_receive(events.ring.data(), events.ring.size()); }
  bool send() { return port.start_transmit(events.run.data(), events.run.size()); }
};

TEST_CASE_TEMPLATE_DEFINE("received bytes are in the ring up to the position, in circles; idle, half and full report",
                          Tested, in_circles) {
  Tested bench;
  CHECK(bench.port.receive_position() == 0);
  REQUIRE(bench.start());
  CHECK(bench.port.receiving());
  bench.in.put(Bytes{1, 2, 3}, 0);
  bench.board.run(50'000);
  CHECK(bench.events.log == "r");
  CHECK(bench.port.receive_position() == 3);
  CHECK(bench.events.ring[2] == 3);
  bench.in.put(Bytes(13, 9), 50'000);
  bench.board.run(180'000);
  CHECK(bench.events.log == "rrr");
  CHECK(bench.port.receive_position() == 0);
  bench.in.put(4, 200'000);
  bench.board.run(300'000);
  CHECK(bench.port.receive_position() == 1);
  CHECK(bench.events.ring[0] == 4);
}

TEST_CASE_TEMPLATE_DEFINE(
    "a line error leaves a flag of its kind, which is reported once, and bytes go on into the ring", Tested,
    line_errors) {
  namespace fake = wirebond::fake;
  Tested bench;
  REQUIRE(bench.start());
  bench.in.put(1, 0);
  bench.in.put(2, 0, fake::Fault::framing);
  bench.in.put(3, 0, fake::Fault::overrun);
  bench.board.run(25'000);
  bench.port.pend();
  bench.board.run(50'000);
  CHECK(bench.events.log == "r");  // no `e`: an error is not an event
  CHECK(bench.events.framing == 1);
  CHECK(bench.events.overruns == 1);
  CHECK(bench.events.noise + bench.events.parity == 0);
  bench.events.forget_errors();
  bench.port.pend();
  bench.board.run(60'000);
  CHECK(bench.events.framing + bench.events.overruns == 0);  // the status still has them, because no byte came
  bench.in.put(7, 60'000, fake::Fault::noise);
  bench.board.run(90'000);
  CHECK(bench.port.receiving());
  CHECK(bench.port.receive_position() == 3);
  CHECK(bench.events.ring[2] == bench.in.bytes().back().seen);
  CHECK(bench.events.noise == 1);
  CHECK(bench.events.framing == 0);
}

TEST_CASE_TEMPLATE_DEFINE("a start while reception runs starts the ring again at its front, and a stop ends it", Tested,
                          starts_again) {
  Tested bench;
  REQUIRE(bench.start());
  bench.in.put(Bytes{1, 2}, 0);
  bench.board.run(50'000);
  REQUIRE(bench.start());
  bench.board.run(51'000);
  CHECK(bench.port.receive_position() == 0);
  bench.port.stop_receive();
  bench.board.run(52'000);
  CHECK_FALSE(bench.port.receiving());
  CHECK_FALSE(bench.uart.receiving());
  REQUIRE(bench.start());
  CHECK(bench.port.receiving());
}

TEST_CASE_TEMPLATE_DEFINE("a run leaves whole, completes once, and a second one meanwhile is refused", Tested,
                          leaves_whole) {
  Tested bench;
  REQUIRE(bench.send());
  CHECK_FALSE(bench.send());
  bench.board.run(29'000);  // of 30 us on the line
  CHECK(bench.events.log.empty());
  bench.board.run(100'000);
  CHECK(bench.events.log == "t");
  CHECK(bench.out.read(100'000) == Bytes{1, 2, 3});
  bench.port.pend();
  bench.board.run(110'000);
  CHECK(bench.events.log == "t");  // whatever the status still shows
  CHECK(bench.send());
}

TEST_CASE_TEMPLATE_DEFINE("a stopped run completes never, and another can begin", Tested, stops) {
  Tested bench;
  REQUIRE(bench.send());
  bench.board.run(15'000);
  bench.port.stop_transmit();
  bench.board.run(100'000);
  CHECK(bench.events.log.empty());
  CHECK(bench.out.read(100'000) == Bytes{1, 2});
  CHECK(bench.send());
  bench.board.run(200'000);
  CHECK(bench.events.log == "t");
}

TEST_CASE_TEMPLATE_DEFINE("pend runs the UART's own handler", Tested, pends) {
  Tested bench;
  bench.port.pend();
  CHECK(bench.events.pends == 0);
  bench.board.run(1);
  CHECK(bench.events.pends == 1);
}

TEST_CASE_TEMPLATE_DEFINE("memory that DMA cannot reach is refused, and more than it can count", Tested, memory) {
  Tested bench;
  CHECK(bench.port.reaches(bench.events.ring.data(), 16));
  CHECK_FALSE(bench.port.reaches(bench.events.ring.data(), 0x1'0000));
  CHECK_FALSE(bench.port.reaches(reinterpret_cast<const void*>(0x1000'FFFF), 1));
  CHECK(bench.port.reaches(reinterpret_cast<const void*>(0x1001'0000), 1));
  CHECK_FALSE(bench.port.reaches(reinterpret_cast<const void*>(0x0FFF'FFFF), 2));
}

}  // namespace contract

/// Test that these benches keep the contract; each is a type that is default-constructible.
#define PORT_KEEPS_ITS_CONTRACT(...)                              \
  TEST_CASE_TEMPLATE_INVOKE(contract::in_circles, __VA_ARGS__);   \
  TEST_CASE_TEMPLATE_INVOKE(contract::line_errors, __VA_ARGS__);  \
  TEST_CASE_TEMPLATE_INVOKE(contract::starts_again, __VA_ARGS__); \
  TEST_CASE_TEMPLATE_INVOKE(contract::leaves_whole, __VA_ARGS__); \
  TEST_CASE_TEMPLATE_INVOKE(contract::stops, __VA_ARGS__);        \
  TEST_CASE_TEMPLATE_INVOKE(contract::pends, __VA_ARGS__);        \
  TEST_CASE_TEMPLATE_INVOKE(contract::memory, __VA_ARGS__)
