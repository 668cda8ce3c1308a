// The port on registers in memory: it keeps the contract of a port.
#include "wirebond/stm32_ll/uart.hpp"

#include <doctest/doctest.h>

#include <array>
#include <cstdint>
#include <string>
#include <vector>

#include "board.hpp"

namespace fake = wirebond::fake;
using Bytes = std::vector<std::uint8_t>;

namespace {

/// In the place of a Link: writes down its events, and restarts reception as a Link does. All buffers are in it.
struct Events {
  wirebond::stm32_ll::Uart uart{{USART3, DMA1, DMA1_Stream1, 1, DMA1_Stream3, 3, USART3_IRQn}};
  std::array<std::uint8_t, 16> ring{};
  std::array<std::uint8_t, 3> run{1, 2, 3};
  std::string log;  ///< without the pends
  std::size_t pends = 0;
  std::size_t framing = 0, noise = 0, overruns = 0;

  void look() {
    const wirebond::LineErrors errors = uart.take_line_errors();
    framing += errors.framing ? 1 : 0;
    noise += errors.noise ? 1 : 0;
    overruns += errors.overrun ? 1 : 0;
  }
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
    ++pends;
    look();
  }
};

Events events;

struct Bench {
  fake::Line in{1'000'000, 10};
  fake::Line out{1'000'000, 10};
  fake::Uart uart{in, out};
  Board board{uart, events.ring.data()};
  wirebond::stm32_ll::Uart& port = events.uart;

  Bench() {
    events.uart.stop_transmit();
    events.ring = {};
    events.log.clear();
    events.pends = events.framing = events.noise = events.overruns = 0;
  }

  bool start() { return port.start_receive(events.ring.data(), events.ring.size()); }
  bool send() { return port.start_transmit(events.run.data(), events.run.size()); }
};

}  // namespace

// What a user writes, as docs/firmware.md says.
void USART3_IRQHandler() { events.uart.usart_interrupt(events); }
void DMA1_Stream1_IRQHandler() { events.uart.receive_interrupt(events); }

TEST_CASE("received bytes are in the ring up to the position, in circles; idle, half and full tell of them") {
  Bench bench;
  REQUIRE(bench.start());
  CHECK(bench.port.receiving());
  bench.in.put(Bytes{1, 2, 3}, 0);
  bench.board.run(50'000);
  CHECK(events.log == "r");
  CHECK(bench.port.receive_position() == 3);
  CHECK(events.ring[2] == 3);
  bench.in.put(Bytes(13, 9), 50'000);
  bench.board.run(180'000);
  CHECK(events.log == "rrr");
  CHECK(bench.port.receive_position() == 0);
}

TEST_CASE("line errors of all kinds never end reception: every byte that DMA moved is in the ring, in order") {
  Bench bench;
  bench.in.faults = {4'000, 3'000, 3'000, 0};  // 1 in 100 bytes
  bench.uart.behaviour.spurious = 20'000;
  REQUIRE(bench.start());
  Bytes got;
  std::size_t read = 0;
  for (fake::Time now = 0; now < 200'000'000; now += 80'000) {
    for (int i = 0; i < 6; ++i) bench.in.put(static_cast<std::uint8_t>(i), now);
    bench.board.run(now + 80'000);
    for (; read != bench.port.receive_position(); read = (read + 1) % 16) got.push_back(events.ring[read]);
  }
  Bytes moved;
  for (const fake::LineByte& byte : bench.in.bytes()) {
    if (byte.fate == fake::Fate::received || byte.fate == fake::Fate::damaged) moved.push_back(byte.seen);
  }
  CHECK(got == moved);
  CHECK(bench.in.count(fake::Fate::damaged) > 80);
  CHECK(bench.uart.counts().receive_starts == 1);
  CHECK(events.log.find('e') == std::string::npos);
  CHECK(events.framing > 40);
  CHECK(events.noise > 30);
  CHECK(events.overruns > 30);
  CHECK(events.framing + events.noise <= bench.in.count(fake::Fate::damaged));
  CHECK(bench.board.taken_bytes() == 0);
}

TEST_CASE("an error of the DMA is reported, and a start within it brings bytes again") {
  Bench bench;
  REQUIRE(bench.start());
  bench.in.put(Bytes{1, 2}, 0);
  bench.board.run(50'000);
  bench.board.fail_receive_dma();
  CHECK(events.log == "re");
  CHECK(bench.port.receiving());
  bench.in.put(6, 60'000);
  bench.board.run(90'000);
  CHECK(bench.port.receive_position() == 1);
  CHECK(events.ring[0] == 6);
}

TEST_CASE("a start while reception runs begins the ring again at its front, and a stop ends it") {
  Bench bench;
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
}

TEST_CASE("a run leaves whole, completes once behind its last bit, and a second one meanwhile is refused") {
  Bench bench;
  REQUIRE(bench.send());
  CHECK_FALSE(bench.send());
  bench.board.run(29'000);  // 30 us of line
  CHECK(events.log.empty());
  bench.board.run(100'000);
  CHECK(events.log == "t");
  CHECK(bench.out.read(100'000) == Bytes{1, 2, 3});
  bench.port.pend();
  bench.board.run(110'000);
  CHECK(events.log == "t");  // the flag still stands
  CHECK(bench.send());
}

TEST_CASE("a UART that waits for a late DMA has not completed") {
  Bench bench;
  REQUIRE(bench.send());
  bench.board.run(15'000);
  bench.board.starve_transmitter();
  CHECK(events.log.empty());
  bench.board.run(100'000);
  CHECK(events.log == "t");
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

TEST_CASE("pend runs the UART's own handler") {
  Bench bench;
  bench.port.pend();
  bench.board.run(1);
  CHECK(events.pends == 1);
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
  CHECK(bench.port.check(115'200) == Why::nothing);
  NVIC->ISER[USART3_IRQn / 32] = 0;
  CHECK(bench.port.check(115'200) == Why::interrupt_off);
  DMA1_Stream1->CR = 0;
  CHECK(bench.port.check(115'200) == Why::receive_dma_not_circular);
  USART3->CR1 = 0;
  CHECK(bench.port.check(115'200) == Why::uart_not_set_up);
}
