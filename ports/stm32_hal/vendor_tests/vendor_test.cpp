// The port on the vendor's own HAL: its UART and DMA drivers, on registers that a simulated UART lives behind.
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
  std::string log;
  bool restarts = true;

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
    events.restarts = true;
    for (std::size_t i = 0; i < events.run.size(); ++i) events.run[i] = static_cast<std::uint8_t>(i + 1);
  }

  bool start() { return port.start_receive(events.ring.data(), events.ring.size()); }
  bool send(std::size_t size) { return port.start_transmit(events.run.data(), size); }
};

constexpr fake::Time us = 1000;

}  // namespace

void usart3_pended() { events.log += 'p'; }

extern "C" {
void HAL_UARTEx_RxEventCallback(UART_HandleTypeDef* handle, uint16_t) {
  if (handle == &huart3) events.log += 'r';
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

TEST_CASE("received bytes are in the ring up to the position, in circles, and each pause is told") {
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

TEST_CASE("a line error ends reception, the event comes, and a start within it brings bytes again") {
  Bench bench;
  REQUIRE(bench.start());
  for (fake::Time now = 0; now < 3000 * us; now += 300 * us) {
    events.log.clear();
    bench.in.put(Bytes{1, 2}, now);
    bench.in.put(3, now, fake::Fault::framing);
    bench.board.run(now + 100 * us);
    CHECK(events.log.find('e') != std::string::npos);
    CHECK(bench.port.receiving());
    CHECK(bench.port.receive_position() == 0);
    bench.in.put(7, now + 200 * us);
    bench.board.run(now + 300 * us);
    CHECK(events.ring[0] == 7);
  }
}

TEST_CASE("after an error without a start the port says that it receives nothing, and can be started later") {
  Bench bench;
  events.restarts = false;
  REQUIRE(bench.start());
  bench.in.put(1, 0, fake::Fault::noise);
  bench.board.run(100 * us);
  CHECK(events.log.find('e') != std::string::npos);
  CHECK_FALSE(bench.port.receiving());
  REQUIRE(bench.start());
  bench.in.put(8, 200 * us);
  bench.board.run(300 * us);
  CHECK(events.ring[0] == 8);
}

TEST_CASE("an error of the DMA is told, and a start within it brings bytes again") {
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

TEST_CASE("a start while reception runs begins the ring anew") {
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
  CHECK(events.log.find('e') != std::string::npos);
  CHECK(events.log.find('t') != std::string::npos);
  CHECK(bench.out.read(1000 * us).size() == 64);
}

TEST_CASE("what is pended is served behind the HAL's handler") {
  Bench bench;
  bench.port.pend();
  bench.board.run(10 * us);
  CHECK(events.log == "p");
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
