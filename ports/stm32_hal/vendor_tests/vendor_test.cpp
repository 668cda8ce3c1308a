// The port on the vendor's own HAL: its UART and DMA drivers, on registers that control a simulated UART.
#include <doctest/doctest.h>

#include <array>
#include <cstdint>
#include <cstring>
#include <string>
#include <vector>

#include "registers.hpp"
#include "wirebond/stm32_hal/uart.hpp"

namespace fake = wirebond::fake;
using Bytes = std::vector<std::uint8_t>;

namespace {

/// In the place of a Link: writes down its events, and restarts reception as a Link does.
struct Events {
  wirebond::stm32_hal::Uart uart{huart3, USART3_IRQn};
  std::array<std::uint8_t, 16> ring{};
  std::array<std::uint8_t, 64> run{};
  std::string log;        ///< without the pends
  std::size_t pends = 0;  ///< the UART's interrupts
  std::size_t framing = 0, noise = 0, overruns = 0;
  bool restarts = true;

  void look() {
    const wirebond::LineErrors errors = uart.take_line_errors();
    framing += errors.framing ? 1 : 0;
    noise += errors.noise ? 1 : 0;
    overruns += errors.overrun ? 1 : 0;
  }
  void on_received() {
    log += 'r';
    if (uart.receiving()) look();
  }
  void on_pended() {
    pends += 1;
    if (uart.receiving()) look();
  }

  void on_error() {
    log += 'e';
    if (restarts && !uart.receiving()) static_cast<void>(uart.start_receive(ring.data(), ring.size()));
  }
};

Events events;  // static: the HAL keeps 32 bits of its addresses

struct Bench {
  fake::Line in{2'000'000, 11};
  fake::Line out{2'000'000, 11};
  fake::Uart uart{in, out};
  Board board{uart};
  wirebond::stm32_hal::Uart& port = events.uart;

  Bench() {
    events.ring = {};
    events.log.clear();
    events.pends = events.framing = events.noise = events.overruns = 0;
    events.restarts = true;
    for (std::size_t i = 0; i < events.run.size(); ++i) events.run[i] = static_cast<std::uint8_t>(i + 1);
  }

  bool start() { return port.start_receive(events.ring.data(), events.ring.size()); }
  bool send(std::size_t size) { return port.start_transmit(events.run.data(), size); }
};

constexpr fake::Time us = 1000;

}  // namespace

void usart3_pended() { events.on_pended(); }

extern "C" {
void HAL_UARTEx_RxEventCallback(UART_HandleTypeDef* handle, uint16_t) {
  if (handle == &huart3) events.on_received();
}
void HAL_UART_TxCpltCallback(UART_HandleTypeDef* handle) {
  if (handle == &huart3) events.log += 't';
}
void HAL_UART_ErrorCallback(UART_HandleTypeDef* handle) {
  if (handle == &huart3) events.on_error();
}
}

TEST_CASE("the HAL divides 42 MHz into 2 Mbaud without a remainder") {
  Bench bench;
  CHECK(bench.board.baud_divider() == 21);
}

TEST_CASE("received bytes are in the ring up to the position, in circles, and each pause is reported") {
  Bench bench;
  CHECK(bench.port.receive_position() == 0);
  REQUIRE(bench.start());
  CHECK(bench.port.receiving());
  bench.in.put(Bytes{1, 2, 3}, 0);
  bench.board.run(100 * us);
  CHECK(bench.port.receive_position() == 3);
  CHECK(events.ring[2] == 3);
  CHECK(events.log == "r");
  bench.in.put(Bytes(14, 9), 100 * us);  // half, full and a pause
  bench.board.run(300 * us);
  CHECK(bench.port.receive_position() == 1);
  CHECK(events.ring[0] == 9);
  CHECK(events.log.size() > 3);
  CHECK(events.log.find_first_not_of('r') == std::string::npos);
}

TEST_CASE("line errors of all kinds never end reception: every byte that DMA moved is in the ring, in order") {
  Bench bench;
  bench.in.faults = {4'000, 3'000, 3'000, 0};
  bench.uart.behaviour.spurious = 20'000;
  REQUIRE(bench.start());
  Bytes got;
  std::size_t read = 0;
  for (fake::Time now = 0; now < 500'000 * us; now += 40 * us) {  // 7 bytes of time, of a ring of 16
    for (int i = 0; i < 6; ++i) bench.in.put(static_cast<std::uint8_t>(i), now);
    bench.board.run(now + 40 * us);
    for (; read != bench.port.receive_position(); read = (read + 1) % 16) got.push_back(events.ring[read]);
  }
  Bytes moved;
  for (const fake::LineByte& byte : bench.in.bytes()) {
    if (byte.fate == fake::Fate::received || byte.fate == fake::Fate::damaged) moved.push_back(byte.seen);
  }
  CHECK(got == moved);
  CHECK(bench.in.count(fake::Fate::unheard) == 0);
  CHECK(bench.in.count(fake::Fate::damaged) > 400);
  CHECK(bench.in.count(fake::Fate::overrun) > 150);
  CHECK(bench.uart.counts().receive_starts == 1);
  CHECK(events.log.find('e') == std::string::npos);
  // A look finds each kind once, however many there were; most looks here are after six bytes.
  CHECK(events.framing > 200);
  CHECK(events.noise > 150);
  CHECK(events.overruns > 150);
  CHECK(events.framing + events.noise <= bench.in.count(fake::Fate::damaged));
  CHECK(events.overruns <= bench.in.count(fake::Fate::overrun));
}

TEST_CASE("an error of the DMA is reported, and a start within it brings bytes again") {
  Bench bench;
  REQUIRE(bench.start());
  bench.in.put(Bytes{1, 2}, 0);
  bench.board.run(100 * us);
  events.log.clear();
  bench.board.fail_receive_dma();
  CHECK(events.log == "e");
  CHECK(bench.port.receiving());
  bench.in.put(6, 200 * us);
  bench.board.run(300 * us);
  CHECK(bench.port.receive_position() == 1);
  CHECK(events.ring[0] == 6);
}

TEST_CASE("a start while reception runs starts the ring again") {
  Bench bench;
  REQUIRE(bench.start());
  bench.in.put(Bytes{1, 2, 3, 4}, 0);
  bench.board.run(100 * us);
  REQUIRE(bench.start());
  CHECK(bench.port.receive_position() == 0);
  bench.in.put(5, 200 * us);
  bench.board.run(300 * us);
  CHECK(bench.port.receive_position() == 1);
  CHECK(events.ring[0] == 5);
}

TEST_CASE("a run leaves whole and completes once; meanwhile the port takes no other") {
  Bench bench;
  for (fake::Time now = 0; now < 1000 * us; now += 100 * us) {
    events.log.clear();
    REQUIRE(bench.send(3));
    CHECK_FALSE(bench.send(3));
    bench.board.run(now + 100 * us);
    CHECK(events.log == "t");
    CHECK(bench.out.read(now + 100 * us) == Bytes{1, 2, 3});
  }
}

TEST_CASE("a run that is broken off completes never, and the next one leaves") {
  Bench bench;
  REQUIRE(bench.send(64));
  bench.board.run(50 * us);
  bench.port.stop_transmit();
  bench.board.run(1000 * us);
  CHECK(events.log.empty());
  CHECK(bench.out.read(1000 * us).size() < 20);
  REQUIRE(bench.send(2));
  bench.board.run(1100 * us);
  CHECK(events.log == "t");
  CHECK(bench.out.read(1100 * us) == Bytes{1, 2});
}

TEST_CASE("an error in the middle of a run does not touch the run") {
  Bench bench;
  REQUIRE(bench.start());
  REQUIRE(bench.send(64));
  bench.in.put(1, 20 * us, fake::Fault::framing);
  bench.board.run(1000 * us);
  CHECK(events.log.find('t') != std::string::npos);
  CHECK(bench.out.read(1000 * us).size() == 64);
}

TEST_CASE("what is pended is served") {
  Bench bench;
  bench.port.pend();
  bench.board.run(10 * us);
  CHECK(events.pends == 1);
}

TEST_CASE("on a bad line, both ways busy, the port never gets stuck") {
  Bench bench;
  bench.in.faults.framing = 20'000;
  bench.uart.behaviour.interrupt_delay = 20 * us;
  bench.uart.behaviour.spurious = 20'000;
  REQUIRE(bench.start());
  std::size_t runs = 0;
  for (fake::Time now = 0; now < 300'000 * us; now += 500 * us) {
    runs += bench.send(1 + runs % 64);
    for (int i = 0; i < 20; ++i) bench.in.put(static_cast<std::uint8_t>(i), now);
    bench.board.run(now + 500 * us);
    CHECK(bench.port.receiving());
  }
  CHECK(runs == 600);
  bench.in.faults.framing = 0;
  bench.in.put(Bytes{1, 2, 3, 4, 5}, 300'000 * us);
  const std::size_t before = bench.port.receive_position();
  bench.board.run(301'000 * us);
  CHECK((bench.port.receive_position() - before + 16) % 16 == 5);
}
