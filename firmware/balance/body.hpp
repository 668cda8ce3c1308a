// The balance bot's body in simulation: a pendulum on wheels with a motor. No message, no port, no clock.
#pragma once

#include <cmath>

namespace balance {

/// `step` advances by this many seconds, a millisecond or two at a time.
class Body {
 public:
  void set_motors(float left, float right) { output_ = (left + right) / 2.0F; }
  float pitch_rad() const { return pitch_rad_; }
  float pitch_rate_rad_s() const { return pitch_rate_rad_s_; }
  float speed_m_s() const { return speed_m_s_; }
  float position_m() const { return position_m_; }

  void push(float rad_s) { pitch_rate_rad_s_ += rad_s; }
  /// On its feet, and standing still.
  void put_up() {
    pitch_rad_ = put_up_rad;
    pitch_rate_rad_s_ = 0.0F;
    speed_m_s_ = 0.0F;
  }

  void step(float seconds) {
    constexpr float gravity_m_s2 = 9.81F;
    constexpr float height_m = 0.18F;  // of a point mass that falls as fast as the body does
    constexpr float full_speed_m_s = 1.5F;
    constexpr float motor_time_constant_s = 0.06F;
    constexpr float on_the_ground_rad = 1.4F;
    const float acceleration = (full_speed_m_s * output_ - speed_m_s_) / motor_time_constant_s;
    speed_m_s_ += acceleration * seconds;
    position_m_ += speed_m_s_ * seconds;
    pitch_rate_rad_s_ +=
        (gravity_m_s2 * std::sin(pitch_rad_) - acceleration * std::cos(pitch_rad_)) / height_m * seconds;
    pitch_rad_ += pitch_rate_rad_s_ * seconds;
    if (std::fabs(pitch_rad_) < on_the_ground_rad) return;
    pitch_rad_ = std::copysign(on_the_ground_rad, pitch_rad_);
    pitch_rate_rad_s_ = 0.0F;
  }

 private:
  static constexpr float put_up_rad = 0.02F;  // nobody puts it up exactly

  float output_ = 0.0F;
  float pitch_rad_ = put_up_rad;
  float pitch_rate_rad_s_ = 0.0F;
  float speed_m_s_ = 0.0F;
  float position_m_ = 0.0F;
};

/// A body in a person's hand: it is put up whenever its motors rest.
class HeldBody : public Body {
 public:
  void set_motors(float left, float right) {
    if (left == 0.0F && right == 0.0F) put_up();
    Body::set_motors(left, right);
  }
};

}  // namespace balance
