// The commonest mistakes in a project, made on the simulated UART: the link says which it is.
#include <doctest/doctest.h>

#include <cstdint>

#include "board.hpp"
#include "wires.hpp"

using wirebond::Why;
using Time = wirebond::fake::Time;

namespace {

constexpr Time ms = 1'000'000;

/// Both ends send for a second. `handler` is what the board's interrupts call.
template <class Wire, class Handler>
Why run(Board<Wire>& board, Handler& handler) {
  for (int i = 0; i < 1000; ++i) {
    if (i % 10 == 0) {
      board.peer.send(board.now);
      typename Wire::Report report{};
      Wire::set(report, static_cast<std::uint32_t>(i));
      static_cast<void>(board.link->send(report));
    }
    board.uart.run(board.now += ms, handler);
    board.link->poll(board.now_us());
  }
  return board.link->why();
}

/// USARTn_IRQHandler without the line of the guide.
template <class Link>
struct WithoutPended {
  Link& link;
  void on_received() { link.on_received(); }
  void on_transmitted() { link.on_transmitted(); }
  void on_error() { link.on_error(); }
  void on_pended() {}
};

}  // namespace

TEST_CASE_TEMPLATE("on a board without a mistake nothing is wrong", Wire, Enterprize, Native) {
  Board<Wire> board(1);
  CHECK(run(board, *board.link) == Why::nothing);
  CHECK(board.link->counters().unserved_pends == 0);
}

TEST_CASE_TEMPLATE("the UART's interrupt is off", Wire, Enterprize, Native) {
  Board<Wire> board(2);
  board.uart.mask(wirebond::fake::never - 1);
  CHECK(run(board, *board.link) == Why::pends_unserved);
  CHECK(board.link->counters().unserved_pends > 900);
}

TEST_CASE_TEMPLATE("the line that calls on_pended was forgotten", Wire, Enterprize, Native) {
  Board<Wire> board(3);
  WithoutPended<typename Board<Wire>::Link> handler{*board.link};
  CHECK(run(board, handler) == Why::pends_unserved);
  CHECK(board.link->send_account().sent == 0);
}

TEST_CASE_TEMPLATE("the receive DMA is in normal mode", Wire, Enterprize, Native) {
  Board<Wire> board(4);
  board.uart.behaviour.circular = false;
  CHECK(run(board, *board.link) == Why::reception_stops);
}

TEST_CASE_TEMPLATE("the buffers are out of the DMA's reach", Wire, Enterprize, Native) {
  Board<Wire> board(5);
  board.uart.set_unreachable(&board.memory, sizeof board.memory);
  CHECK(run(board, *board.link) == Why::buffers_unreachable);
}

TEST_CASE_TEMPLATE("the other end has another baud rate", Wire, Enterprize, Native) {
  Board<Wire> board(6);
  wirebond::fake::Draw draw(7);
  for (int i = 0; i < 300; ++i) {  // what a receiver makes of bits of another length
    const bool has_stop_bit = draw.chance(300'000);
    board.to_mcu.put(static_cast<std::uint8_t>(draw.next()), board.now,
                     has_stop_bit ? wirebond::fake::Fault::none : wirebond::fake::Fault::framing);
    board.pass(ms);
  }
  CHECK(board.link->why() == Why::nothing_understood);
}
