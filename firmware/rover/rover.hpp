// The rover's firmware without its board: the effect of its messages, and when its motors stop. The same source runs on
// a board and in the simulation; only the Board differs.
#pragma once

#include <cstdint>

#include "diffdrive_link.hpp"  // generated: wirebond gen protocols/diffdrive.yaml --lang cpp

namespace rover {

constexpr float track_m = 0.30F;              ///< distance between the wheels
constexpr float low_battery_v = 10.5F;        ///< three lithium cells at 3.5 V
constexpr float default_max_linear = 2.0F;    ///< m/s
constexpr float default_max_angular = 3.14F;  ///< rad/s

/// A receive ring for 22 ms of the line, and send memory for four frames: place it where the UART's DMA can reach it.
using Buffers = diffdrive::McuBuffers<256, 64, 4>;

/// Functions that the firmware needs from a board. Called only from `Rover`'s own functions.
///
///   void set_wheel_speeds(float left_m_s, float right_m_s);
///   std::int16_t take_left_ticks();           // since the last call; also take_right_ticks
///   float battery_v();
///   bool estop_pressed();
///   bool charging();
///   void report(const char* event);           // for a log; may do nothing
///
/// `poll` runs everything here in its own context. Times are microseconds and may wrap.
template <class Board, class Port>
class Rover {
 public:
  using Link = diffdrive::McuLink<Rover, Port, Buffers>;

  Rover(Board& board, Port& port, Buffers& buffers) : board_(board), link_(*this, port, buffers) {
    board_.set_wheel_speeds(0.0F, 0.0F);  // until the first valid command
  }

  /// For the UART's interrupt, which calls the link's `on_...` functions.
  Link& link() { return link_; }

  /// Call it every few milliseconds.
  void poll(std::uint32_t now_us) {
    link_.poll(now_us);
    if (board_.estop_pressed()) halt();
  }

  // ---- messages

  void on(const diffdrive::Velocity& velocity) {
    if (board_.estop_pressed()) return;  // in safe mode the link holds it back
    const float linear = limited(velocity.linear, max_linear_);
    const float turn = limited(velocity.angular, max_angular_) * (track_m / 2.0F);
    board_.set_wheel_speeds(linear - turn, linear + turn);
  }

  void on(const diffdrive::StatusQuery&) {
    diffdrive::Status status;
    status.battery = board_.battery_v();
    if (status.battery < low_battery_v) status.errors |= diffdrive::Status::Errors::low_battery;
    if (stopped_by_silence()) status.errors |= diffdrive::Status::Errors::comm_timeout;
    if (board_.estop_pressed()) status.state |= diffdrive::Status::State::estop;
    if (board_.charging()) status.state |= diffdrive::Status::State::charging;
    static_cast<void>(link_.send(status));  // if the queue is full, this is counted there
  }

  void on(const diffdrive::Parameter& parameter) {
    using Name = diffdrive::Parameter::Name;
    switch (parameter.name) {
      case Name::clear_safe_mode:
        if (in_safe_mode()) board_.report("safe_mode ends");
        link_.recover(diffdrive::Action::safe_mode);
        break;
      case Name::max_linear: max_linear_ = limited(parameter.value, default_max_linear); break;
      case Name::max_angular: max_angular_ = limited(parameter.value, default_max_angular); break;
    }
  }

  bool fill(diffdrive::Odometry& odometry) {
    odometry.left_ticks = board_.take_left_ticks();
    odometry.right_ticks = board_.take_right_ticks();
    return true;
  }

  // ---- deadlines of the protocol file

  void stop() {
    halt();
    board_.report("stop");
  }

  void safe_mode() {
    halt();
    board_.report("safe_mode");
  }

  bool in_safe_mode() const { return link_.struck(diffdrive::Action::safe_mode); }
  bool stopped_by_silence() const { return link_.struck(diffdrive::Action::stop); }

 private:
  void halt() { board_.set_wheel_speeds(0.0F, 0.0F); }

  static float limited(float value, float limit) {
    const float bound = limit < 0.0F ? -limit : limit;
    return value > bound ? bound : value < -bound ? -bound : value;
  }

  Board& board_;
  Link link_;
  float max_linear_ = default_max_linear;
  float max_angular_ = default_max_angular;
};

}  // namespace rover
