// What Link sends over a UART that refuses, dies and is slow: every frame has one fate, and what arrives is in order.
#include <doctest/doctest.h>

#include <cstdint>

#include "board.hpp"
#include "wires.hpp"

using wirebond::Status;

namespace {

template <class Wire>
Status send(Board<Wire>& board, std::uint32_t number) {
  typename Wire::Report report{};
  Wire::set(report, number);
  return board.link->send(report);
}

}  // namespace

TEST_CASE_TEMPLATE("what is accepted arrives once, in order, while starts are refused and interrupts are late", Wire,
                   Enterprize, Native) {
  Board<Wire> board(5);
  board.uart.behaviour.restart_gap = 5'000;
  board.uart.behaviour.interrupt_delay = 50'000;
  board.uart.behaviour.transmit_refused = 200'000;
  board.pass(1'000);  // the first poll starts the link
  std::vector<std::uint32_t> accepted;
  std::uint32_t number = 0;
  for (std::uint32_t step = rounds(3'000, 300'000); step != 0; --step) {
    for (std::uint64_t frames = board.draw.below(8); frames != 0; --frames, ++number) {
      if (send(board, number) == Status::ok) accepted.push_back(number);
    }
    board.pass(board.draw.below(1'000'000));
    board.check();
    board.peer.receive(board.now);
    board.from_mcu.forget();
  }
  for (int i = 0; i < 200; ++i) board.pass(1'000'000);
  board.peer.receive(board.now);
  board.peer.receive(board.now + 1'000'000'000);
  CHECK(board.peer.reports == accepted);
  CHECK(accepted.size() > number / 4);
  CHECK(accepted.size() < number);  // the queue was full now and then
  CHECK(board.link->counters().transmit_retries > 100);
  CHECK(board.link->counters().transmit_timeouts == 0);
  const wirebond::SendAccount account = board.link->send_account();
  CHECK(account.queued == 0);
  CHECK(account.aborted == 0);
}

TEST_CASE_TEMPLATE("a run that dies is broken off and counted; what follows it arrives", Wire, Enterprize, Native) {
  Board<Wire> board(6);
  board.uart.behaviour.interrupt_delay = 20'000;
  board.uart.behaviour.transmit_dies = 2'000;
  board.pass(1'000);
  std::uint32_t number = 0;
  std::uint32_t accepted = 0;
  for (std::uint32_t step = rounds(3'000, 300'000); step != 0; --step) {
    for (std::uint64_t frames = board.draw.below(3); frames != 0; --frames, ++number) {
      accepted += send(board, number) == Status::ok ? 1 : 0;
    }
    board.pass(board.draw.below(1'000'000));
    board.check();
    board.peer.receive(board.now);
    board.from_mcu.forget();
  }
  board.uart.behaviour.transmit_dies = 0;
  for (int i = 0; i < 200; ++i) board.pass(1'000'000);
  board.peer.receive(board.now);
  board.peer.receive(board.now + 1'000'000'000);
  const wirebond::SendAccount account = board.link->send_account();
  CHECK(account.queued == 0);
  CHECK(account.aborted > 10);
  CHECK(board.link->counters().transmit_timeouts > 10);
  CHECK(board.peer.reports.size() >= account.sent);
  CHECK(board.peer.reports.size() <= account.sent + account.aborted);
  for (std::size_t i = 1; i < board.peer.reports.size(); ++i) {
    REQUIRE(board.peer.reports[i - 1] < board.peer.reports[i]);
  }
}

TEST_CASE("buffers out of the DMA's reach leave the link down, and nothing is queued") {
  Board<Enterprize> board(7);
  board.uart.set_unreachable(board.memory.send.data(), 1);
  for (int i = 0; i < 10; ++i) board.pass(1'000'000);
  CHECK(board.link->state() == wirebond::LinkState::down);
  CHECK(send(board, 1) == Status::link_down);
  CHECK(board.link->send_account().refused() == 1);
  CHECK(board.link->send_account().balances());
  CHECK_FALSE(board.uart.receiving());
}
