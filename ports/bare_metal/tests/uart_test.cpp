// The port on simulated registers: a receive and a transmit register, and the interrupts that they raise.
#include "wirebond/bare_metal/uart.hpp"

#include <doctest/doctest.h>

#include <array>
#include <cstdint>
#include <string>
#include <vector>

#include "wirebond/fake/line.hpp"

namespace fake = wirebond::fake;
using Bytes = std::vector<std::uint8_t>;

namespace {

/// A UART without DMA: one byte in its data register, one on the line.
struct Registers {
  fake::Line& out;
  fake::Time now = 0;
  bool receive_interrupt = false;
  bool transmit_interrupt = false;
  bool full = false;  ///< the data register holds a byte that waits for the line
  std::uint8_t data = 0;
  int pended = 0;

  void write(std::uint8_t byte) {
    REQUIRE_FALSE(full);  // else a byte would be lost
    data = byte;
    full = true;
    move_on();
  }
  void enable_receive_interrupt() { receive_interrupt = true; }
  void enable_transmit_interrupt(bool on) { transmit_interrupt = on; }
  void pend() { ++pended; }

  void move_on() {
    if (!full || out.free_at() > now) return;
    out.put(data, now);
    full = false;
  }
};

struct Bench {
  fake::Line out{1'000'000, 10};
  Registers registers{out};
  wirebond::bare_metal::Uart<Registers> uart{registers};
  std::array<std::uint8_t, 8> ring{};
  std::string log;
  Bytes next;  ///< a run to begin as soon as one is complete

  void on_received() { log += 'r'; }
  void on_transmitted() {
    log += 't';
    if (next.empty()) return;
    run = next;
    next.clear();
    CHECK(uart.start_transmit(run.data(), run.size()));
  }
  Bytes run;

  /// Let the line run; the transmit interrupt comes as long as it is on and the register is free.
  void go(fake::Time until) {
    for (;;) {
      registers.move_on();
      if (registers.transmit_interrupt && !registers.full) {
        uart.transmit_ready(*this);
      } else if (registers.full && out.free_at() <= until) {
        registers.now = out.free_at();
      } else {
        registers.now = until;
        return registers.move_on();
      }
    }
  }
};

}  // namespace

TEST_CASE("bytes go into the ring in circles, and every half of it is reported") {
  Bench bench;
  bench.uart.received(9, bench);  // before the start: nowhere to put it
  CHECK_FALSE(bench.uart.receiving());
  REQUIRE(bench.uart.start_receive(bench.ring.data(), bench.ring.size()));
  CHECK(bench.registers.receive_interrupt);
  for (std::uint8_t i = 1; i <= 11; ++i) bench.uart.received(i, bench);
  CHECK(bench.uart.receive_position() == 3);
  CHECK(bench.ring == std::array<std::uint8_t, 8>{9, 10, 11, 4, 5, 6, 7, 8});
  CHECK(bench.log == "rr");
  REQUIRE(bench.uart.start_receive(bench.ring.data(), bench.ring.size()));
  CHECK(bench.uart.receive_position() == 0);
}

TEST_CASE("runs follow each other without a gap; the interrupt is off when there is nothing to send") {
  Bench bench;
  const Bytes first{1, 2, 3};
  REQUIRE(bench.uart.start_transmit(first.data(), first.size()));
  CHECK_FALSE(bench.uart.start_transmit(first.data(), first.size()));
  bench.next = {4, 5};
  bench.go(1'000'000);
  CHECK(bench.log == "tt");
  CHECK(bench.out.free_at() == 50'000);  // five bytes of ten microseconds
  CHECK(bench.out.read(50'000) == Bytes{1, 2, 3, 4, 5});
  CHECK_FALSE(bench.registers.transmit_interrupt);
}

TEST_CASE("a stopped run completes never, and another can begin") {
  Bench bench;
  const Bytes bytes{1, 2, 3, 4, 5};
  REQUIRE(bench.uart.start_transmit(bytes.data(), bytes.size()));
  bench.go(15'000);
  bench.uart.stop_transmit();
  bench.uart.transmit_ready(bench);  // an interrupt that was on its way
  bench.go(200'000);
  CHECK(bench.log.empty());
  CHECK(bench.out.read(200'000) == Bytes{1, 2, 3});  // the third was in the register
  REQUIRE(bench.uart.start_transmit(bytes.data(), 1));
  bench.go(300'000);
  CHECK(bench.log == "t");
}

TEST_CASE("pend is the registers' business") {
  Bench bench;
  bench.uart.pend();
  CHECK(bench.registers.pended == 1);
}
