// Cables pulled, ends restarted, peers that stop in mid-frame: the link comes back by itself, within one largest frame.
#include <doctest/doctest.h>

#include <cstdint>

#include "board.hpp"
#include "wires.hpp"

using wirebond::LinkState;

namespace {

/// One mishap, or none.
template <class Wire>
void befall(Board<Wire>& board) {
  switch (board.draw.below(6)) {
    case 0: {  // the cable, for a while, in the middle of something
      board.peer.send(board.now);
      board.pass(board.draw.below(400'000));
      board.to_mcu.unplug(board.now);
      board.from_mcu.unplug(board.now);
      for (std::uint64_t polls = board.draw.below(3'000); polls != 0; --polls) {
        if (board.draw.chance(10'000)) board.peer.send(board.now);
        board.pass(1'000'000);
        board.check();
      }
      board.to_mcu.plug();
      board.from_mcu.plug();
      break;
    }
    case 1:  // the host restarts in mid-frame
      board.peer.send_part(1 + board.draw.below(12), board.now);
      break;
    case 2:  // the MCU restarts in mid-frame
      board.peer.send(board.now);
      board.pass_without_poll(board.draw.below(200'000));
      board.reset();
      break;
    case 3: {  // a glitch
      const auto fault = board.draw.chance(500'000) ? wirebond::fake::Fault::framing : wirebond::fake::Fault::noise;
      board.to_mcu.put(static_cast<std::uint8_t>(board.draw.next()), board.now, fault);
      break;
    }
    case 4:  // noise that looks like bytes
      for (std::uint64_t bytes = board.draw.below(40); bytes != 0; --bytes) {
        board.to_mcu.put(static_cast<std::uint8_t>(board.draw.next()), board.now);
      }
      break;
    case 5:  // another program talks too much
      for (int i = 0; i < 100; ++i) board.peer.send(board.now);
      board.pass(board.draw.below(10'000'000));
      break;
  }
}

}  // namespace

TEST_CASE_TEMPLATE("after each of many mishaps the link is back within one largest frame of good line", Wire,
                   Enterprize, Native) {
  Board<Wire> board(8);
  board.uart.behaviour.interrupt_delay = 20'000;
  board.uart.behaviour.abort_time = 10'000;
  for (std::uint32_t sequence = rounds(500, 10'000); sequence != 0; --sequence) {
    befall(board);
    // Until the line is good: it is silent of old bytes, and reception runs.
    do board.pass(200'000);
    while (board.to_mcu.next_arrival() != wirebond::fake::never || !board.uart.receiving());
    board.check();
    // From here on, everything that begins one largest frame later must be delivered, and at once.
    const std::uint64_t good = board.to_mcu.put_count();
    std::uint64_t must = 0;
    const std::size_t before = board.handler.commands.size();
    while (board.to_mcu.put_count() < good + 4 * Peer<Wire>::largest_frame) {
      must += board.to_mcu.put_count() >= good + Peer<Wire>::largest_frame ? 1 : 0;
      board.peer.send(board.now);
    }
    while (board.to_mcu.next_arrival() != wirebond::fake::never) board.pass(200'000);
    board.pass(200'000);
    board.check();
    REQUIRE(board.handler.commands.size() - before >= must);
    REQUIRE(board.link->state() == LinkState::up);
  }
}

TEST_CASE_TEMPLATE("silence makes a link stale and restarts reception, until a frame comes", Wire, Enterprize, Native) {
  Board<Wire> board(9);
  board.pass(1'000);
  CHECK(board.link->state() == LinkState::stale);
  board.peer.send(board.now);
  board.pass(1'000'000);
  CHECK(board.link->state() == LinkState::up);
  for (int i = 0; i < 998; ++i) board.pass(1'000'000);
  CHECK(board.link->state() == LinkState::up);
  const std::uint64_t starts = board.uart.counts().receive_starts;
  for (int i = 0; i < 3; ++i) board.pass(1'000'000);
  CHECK(board.link->state() == LinkState::stale);
  CHECK(board.uart.counts().receive_starts == starts + 1);
  // A UART that stopped without a word is found out.
  board.uart.stop_receive();
  for (int i = 0; i < 1'010; ++i) board.pass(1'000'000);
  CHECK(board.uart.receiving());
  board.peer.send(board.now);
  board.pass(1'000'000);
  CHECK(board.link->state() == LinkState::up);
  board.check(true);
}
