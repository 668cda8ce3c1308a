// The UART on a simulated wire: runs end when their last bit has left, and a reader that is too late is lapped.
#include "wirebond/sim/dma_uart.hpp"

#include <doctest/doctest.h>

#include <array>
#include <cstdint>
#include <vector>

using wirebond::sim::DmaUart;
using wirebond::sim::never;
using wirebond::sim::Time;
using wirebond::sim::Wire;
using wirebond::sim::WireSettings;

namespace {

struct Recorder {
  DmaUart* uart = nullptr;
  int received = 0;
  int transmitted = 0;
  int pended = 0;
  std::vector<std::uint8_t> next;  ///< what it sends when a run has left

  void on_received() { ++received; }
  void on_transmitted() {
    ++transmitted;
    send();
  }
  void on_pended() {
    ++pended;
    send();
  }
  void send() {
    if (next.empty()) return;
    CHECK(uart->start_transmit(next.data(), next.size()));
    next.clear();
  }
};

const auto nothing = [](const std::uint8_t*, std::size_t, Time) {};

WireSettings settings() {
  WireSettings settings;
  settings.baud = 1'000'000;
  settings.restart_gap = 3'000;
  return settings;
}

}  // namespace

TEST_CASE("a run ends with its last bit, and the next one begins behind its gap") {
  Wire in(settings());
  Wire out(settings());
  DmaUart uart(in, out);
  Recorder link;
  link.uart = &uart;
  link.next = {1, 2};
  uart.pend();
  std::vector<Time> ends;
  const auto left = [&](const std::uint8_t*, std::size_t, Time end) { ends.push_back(end); };
  uart.run(1'000, link, left);
  CHECK(link.pended == 1);
  CHECK(uart.next() == 24'000);
  CHECK_FALSE(uart.start_transmit(nullptr, 1));  // one at a time
  link.next = {3};
  uart.run(23'999, link, left);
  CHECK(link.transmitted == 0);
  uart.run(24'000, link, left);
  CHECK(link.transmitted == 1);
  CHECK(ends == std::vector<Time>{24'000, 37'000});
  uart.run(40'000, link, left);
  CHECK(uart.next() == never);
  CHECK(uart.runs() == 2);
}

TEST_CASE("each half of the ring raises an event, and what is not read in time is written over") {
  Wire in(settings());
  Wire out(settings());
  DmaUart uart(in, out);
  Recorder link;
  std::array<std::uint8_t, 8> ring{};
  uart.run(0, link, nothing);
  CHECK_FALSE(uart.receiving());
  CHECK(uart.start_receive(ring.data(), ring.size()));
  std::vector<std::uint8_t> bytes;
  for (std::uint8_t i = 0; i < 11; ++i) bytes.push_back(i);
  in.put(bytes.data(), bytes.size(), 0);
  uart.run(43'000, link, nothing);
  CHECK(uart.receive_position() == 4);
  CHECK(link.received == 1);
  uart.run(200'000, link, nothing);
  CHECK(uart.receive_position() == 3);
  CHECK(link.received == 2);
  CHECK(ring == std::array<std::uint8_t, 8>{8, 9, 10, 3, 4, 5, 6, 7});
}
