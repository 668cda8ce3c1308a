// The port on the double of the vendor's library: it keeps the contract of a port.
#include "wirebond/gd32_spl/uart.hpp"

#include <doctest/doctest.h>

#include <array>
#include <cstdint>
#include <string>
#include <vector>

#include "board.hpp"
#include "gd32f30x.h"

namespace fake = wirebond::fake;
using Bytes = std::vector<std::uint8_t>;

namespace {

/// In the place of a Link: writes down its events, and restarts reception as a Link does. All buffers are in it.
struct Events {
  wirebond::gd32_spl::Uart uart{{USART0, DMA0, DMA_CH4, DMA_CH3, USART0_IRQn}};
  std::array<std::uint8_t, 16> ring{};
  std::array<std::uint8_t, 3> run{1, 2, 3};
  std::string log;
  wirebond::LineErrors errors;  ///< of all looks

  void on_received() {
    log += 'r';
    look();
  }
  void on_transmitted() { log += 't'; }
  void on_error() {
    log += 'e';
    if (!uart.receiving()) CHECK(uart.start_receive(ring.data(), ring.size()));
  }
  void on_pended() {
    log += 'p';
    look();
  }
  void look() {
    const wirebond::LineErrors seen = uart.take_line_errors();
    errors.framing |= seen.framing;
    errors.noise |= seen.noise;
    errors.overrun |= seen.overrun;
    errors.parity |= seen.parity;
  }
};

Events events;

struct Bench {
  fake::Line in{1'000'000, 10};
  fake::Line out{1'000'000, 10};
  fake::Uart uart{in, out};
  Board board{uart, events.ring.data()};
  wirebond::gd32_spl::Uart& port = events.uart;

  Bench() {
    events.ring = {};
    events.log.clear();
    events.errors = {};
  }

  bool start() { return port.start_receive(events.ring.data(), events.ring.size()); }
  bool send() { return port.start_transmit(events.run.data(), events.run.size()); }
};

}  // namespace

// What a user writes, as docs/firmware.md says.
void USART0_IRQHandler() { events.uart.usart_interrupt(events); }
void DMA0_Channel3_IRQHandler() { events.uart.transmit_interrupt(events); }
void DMA0_Channel4_IRQHandler() { events.uart.receive_interrupt(events); }

TEST_CASE("received bytes are in the ring up to the position, in circles; idle, half and full tell of them") {
  Bench bench;
  REQUIRE(bench.start());
  bench.in.put(Bytes{1, 2, 3}, 0);
  bench.board.run(50'000);
  CHECK(events.log == "pr");  // every interrupt of the USART also looks whether somebody pended it
  CHECK(bench.port.receive_position() == 3);
  CHECK(events.ring[2] == 3);
  bench.in.put(Bytes(13, 9), 50'000);
  bench.board.run(180'000);
  CHECK(events.log == "prrr");
  CHECK(bench.port.receive_position() == 0);
}

TEST_CASE("a line error leaves a flag of its kind, which is reported once, and no byte is taken away from the DMA") {
  Bench bench;
  CHECK_FALSE(bench.port.receiving());
  REQUIRE(bench.start());
  bench.in.put(1, 0);
  bench.in.put(2, 0, fake::Fault::framing);
  bench.in.put(3, 0, fake::Fault::overrun);
  bench.board.run(25'000);
  bench.port.pend();
  bench.board.run(50'000);
  CHECK(events.log == "ppr");  // no `e`: an error is no event
  CHECK(events.errors.framing);
  CHECK(events.errors.overrun);
  CHECK_FALSE(events.errors.noise);
  CHECK_FALSE(events.errors.parity);
  events.errors = {};
  bench.port.pend();
  bench.board.run(60'000);
  CHECK_FALSE(events.errors.any());
  bench.in.put(7, 60'000, fake::Fault::noise);
  bench.board.run(90'000);
  CHECK(bench.port.receiving());
  CHECK(bench.port.receive_position() == 3);
  CHECK(events.ring[2] == bench.in.bytes().back().seen);
  CHECK(events.errors.noise);
  CHECK_FALSE(events.errors.framing);
  CHECK(bench.board.taken_bytes() == 0);
}

TEST_CASE("a start starts the ring again, also while reception runs") {
  Bench bench;
  REQUIRE(bench.start());
  bench.in.put(Bytes{1, 2}, 0);
  bench.board.run(50'000);
  REQUIRE(bench.start());
  CHECK(bench.port.receive_position() == 0);
}

TEST_CASE("a run leaves whole, completes once, and a second one meanwhile is refused") {
  Bench bench;
  REQUIRE(bench.send());
  CHECK_FALSE(bench.send());
  bench.board.run(100'000);
  CHECK(events.log == "t");
  CHECK(bench.out.read(100'000) == Bytes{1, 2, 3});
  CHECK(bench.send());
}

TEST_CASE("a stopped run completes never, and another can begin") {
  Bench bench;
  REQUIRE(bench.send());
  bench.board.run(15'000);
  bench.port.stop_transmit();
  bench.board.run(100'000);
  CHECK(events.log.empty());
  CHECK(bench.out.read(100'000) == Bytes{1, 2});
  CHECK(bench.send());
  bench.board.run(200'000);
  CHECK(events.log == "t");
}

TEST_CASE("the transmit channel's interrupt without its flag is no completion") {
  Bench bench;
  events.uart.transmit_interrupt(events);
  CHECK(events.log.empty());
}

TEST_CASE("a channel that does not stop is an answer, not a hang") {
  Bench bench;
  REQUIRE(bench.start());
  bench.board.hang(DMA_CH4);
  CHECK_FALSE(bench.start());
}

TEST_CASE("pend runs the USART's own handler") {
  Bench bench;
  bench.port.pend();
  bench.board.run(1);
  CHECK(events.log == "p");
}

TEST_CASE("memory that DMA cannot reach is refused") {
  Bench bench;
  CHECK(bench.port.reaches(events.ring.data(), 16));
  CHECK_FALSE(bench.port.reaches(events.ring.data(), 0x1'0000));
  CHECK_FALSE(bench.port.reaches(reinterpret_cast<const void*>(0x1000'FFFF), 1));
  CHECK(bench.port.reaches(reinterpret_cast<const void*>(0x1001'0000), 1));
  CHECK_FALSE(bench.port.reaches(reinterpret_cast<const void*>(0x0FFF'FFFF), 2));
}

TEST_CASE("each mistake in the settings is reported by its name") {
  using wirebond::Why;
  Bench bench;
  DMA_CHCTL(DMA0, DMA_CH4) |= DMA_CHXCTL_CMEN;
  NVIC->ISER[USART0_IRQn / 32] = 1u << USART0_IRQn % 32;
  CHECK(bench.port.check(115'200) == Why::nothing);
  NVIC->ISER[USART0_IRQn / 32] = 0;
  CHECK(bench.port.check(115'200) == Why::interrupt_off);
  DMA_CHCTL(DMA0, DMA_CH4) &= ~DMA_CHXCTL_CMEN;
  CHECK(bench.port.check(115'200) == Why::receive_dma_not_circular);
}
