// A servo on a bus: it turns as it is told, says where it is when it is asked, and lets go when nobody commands it.
#pragma once

#include <cstdint>

#include "servo_bus_link.hpp"  // generated: wirebond gen protocols/servo_bus.yaml

namespace servo {

/// Room for 2.5 ms of the line coming in, where others' answers go by, too, and for four frames: put it where the
/// UART's DMA reaches it.
using Buffers = servo_bus::McuBuffers<256, 64, 4>;

/// What the firmware asks of a board. Called in `poll`.
///
///   void turn(float angle_rad, float time_s);   // from here on: to this angle, and be there in this time
///   void release();                             // no force from here on, until it turns again
///   float angle_rad();
///   bool moves();
///
/// `poll` runs messages in its own context. Times are microseconds and may wrap.
template <class Board, class Port>
class Servo {
 public:
  using Link = servo_bus::McuLink<Servo, Port, Buffers>;
  using State = servo_bus::Header::State;

  /// `address`: its number on the bus, which is none of the broadcast's.
  Servo(Board& board, Port& port, Buffers& buffers, std::uint8_t address) : board_(board), link_(*this, port, buffers) {
    link_.set_address(address);
    board_.release();  // until the first valid command
  }

  /// For the UART's interrupt, which calls the link's `on_...` functions.
  Link& link() { return link_; }

  /// Call it every millisecond.
  void poll(std::uint32_t now_us) { link_.poll(now_us); }

  bool is_released() const { return is_released_; }

  // ---- messages and deadlines, in `poll`: what is for other servos never comes here

  void on(const servo_bus::Move& move) {
    is_released_ = false;
    board_.turn(move.angle, move.time);
  }

  void on(const servo_bus::Read&) {
    if (link_.addressee() != wirebond::Addressee::own) return;  // all were asked: who answers would disturb others
    servo_bus::Header header = link_.header();                  // with its number
    if (board_.moves()) header.state |= State::moving;
    if (is_released_) header.state |= State::released;
    // Where the send queue has no room the answer is refused and counted; the host asks again.
    static_cast<void>(link_.send(servo_bus::Pose{board_.angle_rad()}, header));
  }

  void release() {
    is_released_ = true;
    board_.release();
  }

 private:
  Board& board_;
  Link link_;
  bool is_released_ = true;
};

}  // namespace servo
