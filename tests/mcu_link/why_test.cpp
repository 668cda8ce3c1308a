// What a link says is wrong with it, reason by reason, on a port that does what the test says.
#include "wirebond/mcu/why.hpp"

#include <doctest/doctest.h>

#include <cstdint>
#include <string>

#include "diffdrive_link.hpp"
#include "scripted_port.hpp"
#include "wirebond/mcu/link.hpp"

using wirebond::Why;

namespace {

/// A port that can tell how it is set up.
struct AnsweringPort : ScriptedPort {
  Why check(std::uint32_t baud) const { return baud == diffdrive::baud ? setup : Why::baud_differs; }

  Why setup = Why::nothing;
};

struct Rover {
  void stop() {}
  void safe_mode() {}
};

template <class Port>
struct Board {
  void poll(int times = 1, bool is_served = true) {
    for (; times != 0; --times) {
      link.poll(now_us += ms);
      if (port.pended && is_served) link.on_pended();
      port.pended = false;
    }
  }
  void come(const Bytes& bytes) {
    port.arrive(bytes);
    link.on_received();
    poll();
  }
  void come() {
    Bytes frame(diffdrive::StatusQuery::Info::max_frame_bytes);
    std::size_t size = 0;
    REQUIRE(diffdrive::encode(diffdrive::StatusQuery{}, frame.data(), frame.size(), size) == wirebond::Status::ok);
    come(frame);
  }

  std::uint32_t now_us = 0;
  Port port;
  Rover rover;
  diffdrive::McuBuffers<64, 64, 4> buffers;
  diffdrive::McuLink<Rover, Port, decltype(buffers)> link{rover, port, buffers};
};

}  // namespace

TEST_CASE("a link that works has nothing to say, and each reason has a sentence of its own") {
  Board<ScriptedPort> board;
  board.poll();
  board.come();
  CHECK(board.link.why() == Why::nothing);
  for (int i = 0; i < WIREBOND_WHY_COUNT; ++i) {
    const std::string text = text_of(static_cast<Why>(i));
    CHECK(text.size() > 20);
    for (int j = 0; j < i; ++j) CHECK(text != text_of(static_cast<Why>(j)));
  }
}

TEST_CASE("what keeps a link down is reported: no poll, buffers out of reach, a port that refuses") {
  Board<ScriptedPort> board;
  CHECK(board.link.why() == Why::not_polled);
  board.port.is_reachable = false;
  board.poll();
  CHECK(board.link.why() == Why::buffers_unreachable);
  board.port.is_reachable = true;
  board.port.refuses_receive = true;
  board.poll();
  CHECK(board.link.why() == Why::port_refuses);
}

TEST_CASE("what the port says of its settings comes first, but for the tick, which works most of the time") {
  Board<AnsweringPort> board;
  board.poll();
  board.port.setup = Why::no_receive_dma;
  CHECK(board.link.why() == Why::no_receive_dma);
  board.port.setup = Why::tick_below_uart;
  CHECK(board.link.why() == Why::nothing_heard);
  board.come();
  CHECK(board.link.why() == Why::tick_below_uart);
}

TEST_CASE("a pend that nobody served is pended again by each poll, counted and reported") {
  Board<ScriptedPort> board;
  board.poll();
  board.come();
  REQUIRE(board.link.send(diffdrive::Status{}) == wirebond::Status::ok);
  board.port.pended = false;  // and nobody calls on_pended
  board.poll(1, false);
  CHECK(board.link.counters().unserved_pends == 0);
  board.link.poll(board.now_us += ms);
  CHECK(board.port.pended);
  board.poll(1, false);
  CHECK(board.link.counters().unserved_pends == 2);
  CHECK(board.link.why() == Why::pends_unserved);
  board.poll();
  board.poll();
  CHECK(board.link.why() == Why::nothing);
  CHECK(board.link.counters().unserved_pends == 3);
  CHECK(board.port.transmit_starts == 1);
}

TEST_CASE("an interrupt that is pended and finds the port busy has been served") {
  Board<ScriptedPort> board;
  board.poll();
  board.come();
  board.port.refuses_transmit = true;
  REQUIRE(board.link.send(diffdrive::Status{}) == wirebond::Status::ok);
  board.poll(10);
  CHECK(board.link.counters().transmit_retries >= 10);
  board.port.refuses_receive = true;  // and reception, which is begun again for silence
  board.port.is_receiving = false;
  board.poll(1500);
  CHECK(board.link.counters().unserved_pends == 0);
}

TEST_CASE("without anything to send a forgotten on_pended is reported after a second of silence") {
  Board<ScriptedPort> board;
  board.poll(1010, false);
  CHECK(board.link.why() == Why::pends_unserved);
}

TEST_CASE("reception that ended without an error event begins again at the next poll, is counted and told") {
  Board<ScriptedPort> board;
  board.poll();
  board.come();
  for (std::uint32_t stops = 1; stops <= 3; ++stops) {  // as a DMA in normal mode does at the end of each ring
    board.port.is_receiving = false;
    CHECK(board.link.why() == Why::reception_stops);
    board.poll();
    CHECK(board.port.is_receiving);
    CHECK(board.link.counters().reception_stops == stops);
    CHECK(board.link.counters().receive_restarts == stops);
    board.come();
    CHECK(board.link.receiver().account().frames == stops + 1);
    CHECK(board.link.why() == Why::reception_stops);
  }
  board.poll(1010);  // the line falls silent, and reception was under way
  CHECK(board.link.why() == Why::nothing_heard);
}

TEST_CASE("reception that an error event ended is not a stop without one, whoever finds it first") {
  Board<ScriptedPort> board;
  board.poll();
  board.come();
  board.port.is_receiving = false;
  board.port.refuses_receive = true;
  board.link.on_error();
  board.poll(3);
  board.port.refuses_receive = false;
  board.poll();
  CHECK(board.link.counters().receive_restarts == 1);
  CHECK(board.link.counters().reception_stops == 0);
  board.port.is_receiving = false;
  board.link.on_error();
  CHECK(board.link.counters().receive_restarts == 2);
  CHECK(board.link.counters().reception_stops == 0);
}

TEST_CASE("a ring that overflows between any two polls is told, not the cable") {
  Board<ScriptedPort> board;
  board.poll();
  for (int i = 0; i < 60; ++i) {  // every 20 ms, and the ring holds 5.5 ms
    board.now_us += 19 * ms;
    board.come();
    CHECK(board.link.why() == Why::polled_too_seldom);
  }
  CHECK(board.link.receiver().account().frames == 0);
  for (int i = 0; i < 60; ++i) {  // then the cable is pulled
    board.now_us += 19 * ms;
    board.poll();
  }
  CHECK(board.link.why() == Why::nothing_heard);
}

TEST_CASE("runs that never end are told") {
  Board<ScriptedPort> board;
  board.poll();
  board.come();
  REQUIRE(board.link.send(diffdrive::Status{}) == wirebond::Status::ok);
  board.poll(900);
  board.come();
  CHECK(board.link.counters().transmit_timeouts != 0);
  CHECK(board.link.why() == Why::runs_not_completed);
}

TEST_CASE("a port that takes no run, as without a DMA, is told, and one that is busy at first is not") {
  Board<ScriptedPort> board;
  board.poll();
  board.port.refuses_transmit = true;
  REQUIRE(board.link.send(diffdrive::Status{}) == wirebond::Status::ok);
  board.poll(50);
  board.come();
  CHECK(board.link.why() == Why::nothing);
  board.poll(100);
  CHECK(board.link.why() == Why::runs_not_completed);
}

TEST_CASE("bytes without a frame, silence, and polls that came too late") {
  Board<ScriptedPort> board;
  board.poll();
  CHECK(board.link.why() == Why::nothing_heard);
  board.come({1, 2, 3});
  CHECK(board.link.why() == Why::nothing_understood);
  board.come();
  CHECK(board.link.why() == Why::nothing);
  board.poll(1500);
  CHECK(board.link.why() == Why::nothing_heard);
  board.now_us += 100 * ms;
  board.come();
  board.come();
  CHECK(board.link.why() == Why::polled_too_seldom);
}
