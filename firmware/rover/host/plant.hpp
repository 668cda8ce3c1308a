// The rover's body in simulation: motors with inertia, wheels, encoders, a battery. No message, no port, no clock.
#pragma once

#include <cmath>
#include <cstdint>

namespace rover {

/// One wheel with its motor and its encoder.
class Wheel {
 public:
  void set_speed(double m_s) { wanted_m_s_ = m_s; }

  void step(double seconds) {
    constexpr double time_constant_s = 0.08;  // first-order answer of a small geared motor
    speed_m_s_ += (wanted_m_s_ - speed_m_s_) * (1.0 - std::exp(-seconds / time_constant_s));
    if (wanted_m_s_ == 0.0 && std::fabs(speed_m_s_) < 1e-3) speed_m_s_ = 0.0;  // static friction
    position_m_ += speed_m_s_ * seconds;
  }

  /// Return the encoder ticks since the last call.
  std::int16_t take_ticks() {
    constexpr double ticks_per_m = 1024.0 / (3.14159265358979 * 0.065);  // 1024 a turn, wheels of 65 mm
    const auto now = static_cast<std::int64_t>(std::floor(position_m_ * ticks_per_m));
    const std::int64_t ticks = now - taken_ticks_;
    taken_ticks_ = now;
    return static_cast<std::int16_t>(ticks);  // 50 ms at 2 m/s give 501
  }

  double speed_m_s() const { return speed_m_s_; }

 private:
  double wanted_m_s_ = 0;
  double speed_m_s_ = 0;
  double position_m_ = 0;
  std::int64_t taken_ticks_ = 0;
};

/// Wheels, pose and battery. `step` advances by this many seconds, at most some milliseconds at a time.
class Plant {
 public:
  Wheel left;
  Wheel right;
  bool estop_pressed = false;
  bool charging = false;

  void step(double seconds, double track_m) {
    left.step(seconds);
    right.step(seconds);
    const double forward = (left.speed_m_s() + right.speed_m_s()) / 2;
    heading_rad_ += (right.speed_m_s() - left.speed_m_s()) / track_m * seconds;
    x_m_ += forward * std::cos(heading_rad_) * seconds;
    y_m_ += forward * std::sin(heading_rad_) * seconds;
    const double load_a = 0.3 + 1.5 * (std::fabs(left.speed_m_s()) + std::fabs(right.speed_m_s()));
    charge_c_ += (charging ? 3.0 - load_a : -load_a) * seconds;
    if (charge_c_ > capacity_c) charge_c_ = capacity_c;
    if (charge_c_ < 0) charge_c_ = 0;
    sag_v_ = 0.12 * load_a;  // internal resistance times current
  }

  /// Return the voltage of three lithium cells: 12.6 V full, 9.6 V empty, minus the drop under load.
  float battery_v() const { return static_cast<float>(9.6 + 3.0 * charge_c_ / capacity_c - (charging ? 0.0 : sag_v_)); }

  double x_m() const { return x_m_; }
  double y_m() const { return y_m_; }
  double heading_rad() const { return heading_rad_; }

 private:
  static constexpr double capacity_c = 2.2 * 3600;  // 2.2 Ah
  double charge_c_ = 0.9 * capacity_c;
  double sag_v_ = 0;
  double x_m_ = 0;
  double y_m_ = 0;
  double heading_rad_ = 0;
};

}  // namespace rover
