// RS-485: the transceiver's driver is on from before the first byte of a run until its last bit has left.
#include "wirebond/mcu/driver_enable.hpp"

#include <doctest/doctest.h>

#include <cstdint>
#include <string>

#include "bus_link.hpp"
#include "scripted_port.hpp"
#include "wirebond/mcu/link.hpp"

using wirebond::Status;

namespace {

std::string pin_log;  // + on, - off, r a run begins, x it is broken off

void drive(bool on) { pin_log += on ? '+' : '-'; }

struct LoggingPort : ScriptedPort {
  bool start_transmit(const std::uint8_t* bytes, std::size_t bytes_size) {
    if (!ScriptedPort::start_transmit(bytes, bytes_size)) return false;
    pin_log += 'r';
    return true;
  }
  void stop_transmit() { pin_log += 'x'; }
  bool connected() const { return is_connected; }

  bool is_connected = true;
};

struct Handler {};

struct Board {
  Board() {
    poll();
    pin_log.clear();
  }
  void poll(int times = 1) {
    for (; times != 0; --times) {
      link.poll(now_us += ms);
      pended();
    }
  }
  void pended() {
    if (port.pended) link.on_pended();
    port.pended = false;
  }
  void send() { REQUIRE(link.send(bus::Note{1}) == Status::ok); }

  std::uint32_t now_us = 0;
  wirebond::DriverEnable<LoggingPort, drive> port;
  Handler handler;
  bus::McuBuffers<256, 256> buffers;
  bus::McuLink<Handler, decltype(port), decltype(buffers)> link{handler, port, buffers};
};

}  // namespace

TEST_CASE("the driver is on before the run begins, stays on for the run that follows, and is off behind the last") {
  Board board;
  board.send();
  board.pended();
  CHECK(pin_log == "+r");
  board.send();
  board.link.on_transmitted();
  CHECK(pin_log == "+r+r");
  board.link.on_transmitted();
  CHECK(pin_log == "+r+r-");
}

TEST_CASE("a run that the port does not take, or that is broken off, leaves the driver off") {
  Board board;
  board.port.refuses_transmit = true;
  board.send();
  board.pended();
  CHECK(pin_log.back() == '-');
  board.port.refuses_transmit = false;
  board.poll();
  CHECK(pin_log.back() == 'r');
  board.poll(100);  // and it never ends
  CHECK(pin_log.find('x') != std::string::npos);
  CHECK(pin_log.back() == '-');
}

TEST_CASE("a link that goes down leaves the driver off") {
  Board board;
  board.send();
  board.pended();
  board.port.is_connected = false;
  board.poll();
  CHECK(board.link.state() == wirebond::LinkState::down);
  CHECK(pin_log == "+rx-");
}
