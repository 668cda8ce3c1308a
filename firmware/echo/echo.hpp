// The smallest firmware: every chassis command goes back as the chassis message of the same values.
#pragma once

#include <cstdint>

#include "enterprize_link.hpp"  // generated: wirebond gen protocols/enterprize.yaml

namespace echo {

/// Room for 2.8 ms of the line coming in, and for 53 echoes: put it where the UART's DMA reaches it.
using Buffers = enterprize::McuBuffers<512, 1024, 64>;

/// What the firmware asks of a board. Called in `poll`.
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
    // What the send queue has no room for is refused and counted there; an echo has nobody to tell.
    static_cast<void>(link_.send(enterprize::ChassisMsg{command.x_vel, command.y_vel, command.w_vel}));
    board_.blink();
  }

 private:
  Board& board_;
  Link link_;
};

}  // namespace echo
