// What Link does with what a UART makes of a bad line: errors, restarts, laps. Each frame that came whole is delivered.
#include <doctest/doctest.h>

#include <cstdint>

#include "board.hpp"
#include "wires.hpp"

using wirebond::fake::Event;
using wirebond::fake::OnLineError;

TEST_CASE_TEMPLATE("with 1 % of bytes in error every frame that came whole is delivered once, in order", Wire,
                   Enterprize, Native) {
  for (const OnLineError on_line_error : {OnLineError::stop, OnLineError::tell, OnLineError::flag}) {
    for (const bool keeps_damaged : {true, false}) {
      CAPTURE(static_cast<int>(on_line_error));
      CAPTURE(keeps_damaged);
      Board<Wire> board(on_line_error == OnLineError::stop ? 1 : 2);
      board.to_mcu.faults.framing = 4'000;
      board.to_mcu.faults.noise = 3'000;
      board.to_mcu.faults.overrun = 3'000;
      board.uart.behaviour.on_line_error = on_line_error;
      board.uart.behaviour.keeps_damaged = keeps_damaged;
      board.uart.behaviour.interrupt_delay = 20'000;
      board.uart.behaviour.abort_time = 10'000;
      board.uart.behaviour.spurious = 10'000;
      board.uart.behaviour.receive_refused = 100'000;
      for (std::uint32_t step = rounds(3'000, 300'000); step != 0; --step) {
        for (std::uint64_t frames = board.draw.below(4); frames != 0; --frames) {
          board.peer.send(board.now + board.draw.below(300'000));
        }
        board.pass(board.draw.below(1'000'000));
        board.check();
      }
      for (int i = 0; i < 200; ++i) board.pass(1'000'000);
      board.check(true);
      const wirebond::LinkCounters counters = board.link->counters();
      CHECK(counters.line_errors > 100);
      if (on_line_error == OnLineError::flag) {
        CHECK(counters.framing_errors > 50);
        CHECK(counters.noise_errors > 50);
        CHECK(counters.overruns > 50);
        CHECK(board.uart.counts().receive_starts == 1);  // reception never stopped
        CHECK(board.link->why() == wirebond::Why::many_line_errors);
      }
      CHECK(board.handler.commands.size() > board.peer.sent() / 2);
      CHECK(board.handler.commands.size() < board.peer.sent());
      CHECK(board.peer.completed() * 20 < board.peer.came());
    }
  }
}

namespace {

/// Polls that stall for up to 20 ms, which is some rings' time, while interrupts are served.
template <class Wire, class Port>
void lap(Board<Wire, 256, 512, Port>& board) {
  board.uart.behaviour.interrupt_delay = 50'000;
  for (std::uint32_t step = rounds(2'000, 200'000); step != 0; --step) {
    for (std::uint64_t frames = board.draw.below(40); frames != 0; --frames) board.peer.send(board.now);
    board.pass(board.draw.chance(200'000) ? board.draw.below(20'000'000) : 500'000);
    board.check();
  }
  CHECK(board.handler.commands.size() > 1'000);
  // Once it is read in time again, nothing is lost.
  while (board.to_mcu.next_arrival() != wirebond::fake::never) board.pass(500'000);
  for (int i = 0; i < 100; ++i) board.pass(1'000'000);
  const std::size_t before = board.handler.commands.size();
  for (int i = 0; i < 100; ++i) {
    board.peer.send(board.now);
    board.pass(500'000);
  }
  board.pass(1'000'000);
  CHECK(board.handler.commands.size() == before + 100);
}

}  // namespace

TEST_CASE_TEMPLATE("a reader that is lapped and has a clock loses what was overwritten, counts it, and nothing else",
                   Wire, Enterprize, Native) {
  Board<Wire, 256, 512, wirebond::fake::ClockedUart> board(3);
  lap(board);
  CHECK(board.link->receive_account().laps > 100);
}

TEST_CASE_TEMPLATE("without a clock a reader that was away for a ring's time drops what is there, and counts it", Wire,
                   Enterprize, Native) {
  Board<Wire, 256> board(3);
  lap(board);
  CHECK(board.link->receive_account().laps_unknown > 100);
  CHECK(board.link->receive_account().dropped > 1'000);
}

TEST_CASE_TEMPLATE("half, full and idle events in any order, held back for long or never, lose nothing", Wire,
                   Enterprize, Native) {
  for (const Event missing : {Event::half, Event::full, Event::idle}) {
    Board<Wire> board(4);
    board.uart.behaviour.interrupt_delay = 400'000;
    board.uart.behaviour.spurious = 50'000;
    board.uart.hold(missing);
    for (std::uint32_t step = rounds(1'000, 100'000); step != 0; --step) {
      for (std::uint64_t frames = board.draw.below(5); frames != 0; --frames) {
        board.peer.send(board.now + board.draw.below(500'000));
      }
      if (board.draw.chance(20'000)) board.uart.mask(board.now + board.draw.below(1'000'000));
      board.pass(board.draw.below(800'000));
      board.check();
      if (board.draw.chance(5'000)) board.uart.release(missing);
      if (board.draw.chance(5'000)) board.uart.hold(missing);
    }
    for (int i = 0; i < 200; ++i) board.pass(1'000'000);
    board.check(true);
    CHECK(board.handler.commands.size() == board.peer.sent());
  }
}
