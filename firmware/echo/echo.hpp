// The smallest firmware: every chassis command is returned as a chassis message with the same values.
#pragma once

#include <cstdint>

#include "enterprize_link.hpp"  // generated: wirebond gen protocols/enterprize.yaml

namespace echo {

/// A receive ring for 2.8 ms of the line, and send memory for 53 echoes: place it where the UART's DMA can reach it.
using Buffers = enterprize::McuBuffers<512, 1024, 64>;

/// Functions that the firmware needs from a board. Called in `poll`.
///
///   void blink();   // a sign of life, for each echo; may do nothing
///
/// `poll` runs everything here in its own context. Times are microseconds and may wrap.
template <class Board, class Port>
class Echo {
 public:
  using Link = enterprize::McuLink<Echo, Port, Buffers>;

  Echo(Board& board, Port& port, Buffers& buffers) : board_(board), link_(*this, port, buffers) {}

  /// For the UART's interrupt, which calls the link's `on_...` functions.
  Link& link() { return link_; }

  /// Call it every millisecond or two.
  void poll(std::uint32_t now_us) { link_.poll(now_us); }

  // ---- messages

  void on(const enterprize::ChassisCmd& command) {
    // If the send queue is full the echo is refused and counted there; nobody else needs to know.
    static_cast<void>(link_.send(enterprize::ChassisMsg{command.x_vel, command.y_vel, command.w_vel}));
    board_.blink();
  }

 private:
  Board& board_;
  Link link_;
};

}  // namespace echo
