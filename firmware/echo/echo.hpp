// The smallest firmware: every chassis command goes back as the chassis message of the same values.
#pragma once

#include "enterprize.hpp"  // generated: wirebond gen protocols/enterprize.yaml

namespace echo {

/// A handler of a link. `Board` has `wirebond::Status send(const Message&)`, which is the link's.
template <class Board>
class Echo {
 public:
  explicit Echo(Board& board) : board_(board) {}

  void on(const enterprize::ChassisCmd& command) {
    // What the send queue has no room for is refused and counted there; an echo has nobody to tell.
    static_cast<void>(board_.send(enterprize::ChassisMsg{command.x_vel, command.y_vel, command.w_vel}));
  }

 private:
  Board& board_;
};

}  // namespace echo
