// A servo on a bus: turns as commanded, reports its angle on request, and releases its motor when commands stop.
#pragma once

#include <cstdint>

#include "servo_bus_link.hpp"  // generated: wirebond gen protocols/servo_bus.yaml

namespace servo {

/// A receive ring for 2.5 ms of the line, which also carries others' answers, and send memory for four frames: place it
/// where the UART's DMA can reach it.
using Buffers = servo_bus::McuBuffers<256, 64, 4>;

/// Functions that the firmware needs from a board. Called in `poll`.
///
///   void turn(float angle_rad, float time_s);   // from now on: to this angle, arriving after this time
///   void release();                             // no force from now on, until it turns again
///   float angle_rad();
///   bool moves();
///
/// `poll` handles messages in its own context. Times are microseconds and may wrap.
template <class Board, class Port>
class Servo {
 public:
  using Link = servo_bus::McuLink<Servo, Port, Buffers>;
  using State = servo_bus::Header::State;

  /// `address`: its number on the bus, not the broadcast's.
  Servo(Board& board, Port& port, Buffers& buffers, std::uint8_t address) : board_(board), link_(*this, port, buffers) {
    link_.set_address(address);
    board_.release();  // until the first valid command
  }

  /// For the UART's interrupt, which calls the link's `on_...` functions.
  Link& link() { return link_; }

  /// Call it every millisecond.
  void poll(std::uint32_t now_us) { link_.poll(now_us); }

  bool is_released() const { return is_released_; }

  // ---- messages and deadlines, in `poll`: messages for other servos never come here

  void on(const servo_bus::Move& move) {
    is_released_ = false;
    board_.turn(move.angle, move.time);
  }

  void on(const servo_bus::Read&) {
    if (link_.addressee() != wirebond::Addressee::own) return;  // all were asked: an answer would disturb others
    servo_bus::Header header = link_.header();                  // with its number
    if (board_.moves()) header.state |= State::moving;
    if (is_released_) header.state |= State::released;
    // If the send queue is full the answer is refused and counted; the host asks again.
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
