// The rover's firmware without its board: what its messages do, when its motors stop. The same source runs on a board
// and in the simulation; only the Board differs.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>

#include "diffdrive.hpp"  // generated: wirebond gen protocols/diffdrive.yaml --lang cpp

namespace rover {

constexpr float track_m = 0.30F;              ///< distance between the wheels
constexpr float low_battery_v = 10.5F;        ///< three lithium cells at 3.5 V
constexpr float default_max_linear = 2.0F;    ///< m/s
constexpr float default_max_angular = 3.14F;  ///< rad/s

/// What the firmware asks of a board. Called from `Rover`'s own functions only.
///
///   void set_wheel_speeds(float left_m_s, float right_m_s);
///   std::int16_t take_left_ticks();           // since the call before; the same for take_right_ticks
///   float battery_v();
///   bool estop_pressed();
///   bool charging();
///   void transmit(const std::uint8_t* bytes, std::size_t size);
///   void report(const char* event);           // for a log; may do nothing
///
/// One task or one main loop calls everything here. Times are microseconds and may wrap.
template <class Board>
class Rover {
 public:
  Rover(Board& board, std::uint32_t now_us)
      : board_(board),
        now_us_(now_us),
        deadlines_(diffdrive::mcu_deadlines, now_us),
        odometry_(diffdrive::Odometry::Info::every_us, now_us) {
    board_.set_wheel_speeds(0.0F, 0.0F);  // until the first valid command
  }

  /// Bytes from the UART. `size` 0 says that a read found nothing.
  void receive(const std::uint8_t* bytes, std::size_t size, std::uint32_t now_us) {
    now_us_ = now_us;
    if (size != 0) {
      receiver_.feed(bytes, size, now_us, *this, deadlines_);
    } else {
      receiver_.idle(now_us, *this, deadlines_);
    }
  }

  /// Call it at least every few milliseconds.
  void poll(std::uint32_t now_us) {
    now_us_ = now_us;
    deadlines_.poll(now_us, [this](std::uint8_t action) { diffdrive::act_at_mcu(action, *this); });
    if (board_.estop_pressed()) halt();
    if (odometry_.due(now_us)) send(diffdrive::Odometry{board_.take_left_ticks(), board_.take_right_ticks()});
  }

  // ---- messages

  void on(const diffdrive::Velocity& velocity) {
    if (in_safe_mode() || board_.estop_pressed()) return;
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
    send(status);
  }

  void on(const diffdrive::Parameter& parameter) {
    using Name = diffdrive::Parameter::Name;
    switch (parameter.name) {
      case Name::clear_safe_mode:
        if (in_safe_mode()) board_.report("safe_mode ends");
        deadlines_.recover(static_cast<std::uint8_t>(diffdrive::Action::safe_mode), now_us_);
        break;
      case Name::max_linear: max_linear_ = limited(parameter.value, default_max_linear); break;
      case Name::max_angular: max_angular_ = limited(parameter.value, default_max_angular); break;
    }
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

  bool in_safe_mode() const { return deadlines_.struck(static_cast<std::uint8_t>(diffdrive::Action::safe_mode)); }
  bool stopped_by_silence() const { return deadlines_.struck(static_cast<std::uint8_t>(diffdrive::Action::stop)); }

 private:
  void halt() { board_.set_wheel_speeds(0.0F, 0.0F); }

  static float limited(float value, float limit) {
    const float bound = limit < 0.0F ? -limit : limit;
    return value > bound ? bound : value < -bound ? -bound : value;
  }

  template <class Message>
  void send(const Message& message) {
    std::array<std::uint8_t, Message::Info::max_frame_bytes> frame;
    std::size_t size = 0;
    if (diffdrive::encode(message, frame.data(), frame.size(), size) == wirebond::Status::ok) {
      board_.transmit(frame.data(), size);
    }
  }

  Board& board_;
  std::uint32_t now_us_;
  diffdrive::Receiver<diffdrive::FromHost> receiver_;
  wirebond::Deadlines<diffdrive::mcu_deadlines.size()> deadlines_;
  wirebond::Periodic<> odometry_;
  float max_linear_ = default_max_linear;
  float max_angular_ = default_max_angular;
};

}  // namespace rover
