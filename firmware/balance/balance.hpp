// A balance bot's firmware without its board: two control loops, and messages that tune them while it stands.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>

#include "pid_tuner.hpp"  // generated: wirebond gen protocols/pid_tuner.yaml

namespace balance {

constexpr std::uint32_t step_us = 5000;          ///< of control
constexpr float most_lean_rad = 0.15F;           ///< that the outer loop may ask for
constexpr float fallen_rad = 0.6F;               ///< nothing brings it back from here
constexpr float upright_rad = 0.05F;             ///< somebody has put it up again
constexpr float largest_gain = 1000.0F;          ///< of each kind; larger ones are refused
constexpr float velocity_p_for_each_i = 200.0F;  ///< the outer loop's i follows from its p

/// What the firmware asks of a board. Called from `Balance`'s own functions only.
///
///   float pitch_rad();                        // positive: it leans forwards
///   float pitch_rate_rad_s();
///   float speed_m_s();                        // of the wheels
///   void set_motors(float left, float right); // -1 to 1 of full voltage, positive: forwards
///   wirebond::Status send(const Message&);    // the link's
///
/// A handler of a link. One task or one main loop calls `step` and the link's `poll`.
template <class Board>
class Balance {
 public:
  explicit Balance(Board& board) : board_(board) { rest(); }  // all gains are 0 until the first message

  /// Control, every `step_us`.
  void step() {
    constexpr float step_s = static_cast<float>(step_us) * 1e-6F;
    pitch_ = board_.pitch_rad();
    pitch_rate_ = board_.pitch_rate_rad_s();
    if (!stands()) {
      rest();
      return;
    }
    // The outer loop leans against the way that the wheels go; the inner one drives the wheels under the body.
    const float speed = board_.speed_m_s();
    travelled_ = limited(travelled_ + speed * step_s, most_travelled_m);
    setpoint_ = limited(-(velocity_.p * speed + velocity_.i * travelled_), most_lean_rad);
    const float error = pitch_ - setpoint_;
    error_sum_ = limited(error_sum_ + error * step_s, most_error_sum_rad_s);
    drive(limited(balance_.p * error + balance_.i * error_sum_ + balance_.d * pitch_rate_, 1.0F));
  }

  // ---- messages

  void on(const pid_tuner::Pid& pid) {
    using Result = pid_tuner::Acknowledge::Result;
    Result result = Result::accepted;
    if (pid.idx > velocity_index) {
      result = Result::unknown_index;
    } else if (!in_range(pid.p) || !in_range(pid.i) || !in_range(pid.d)) {
      result = Result::out_of_range;
    } else {
      change(pid);
    }
    acknowledge(pid_tuner::Pid::Info::id, result);
  }

  void on(const pid_tuner::ReadGains& request) {
    if (request.idx > velocity_index) {
      acknowledge(pid_tuner::ReadGains::Info::id, pid_tuner::Acknowledge::Result::unknown_index);
      return;
    }
    const Gains& gains = request.idx == balance_index ? balance_ : velocity_;
    static_cast<void>(board_.send(pid_tuner::Gains{request.idx, gains.p, gains.i, gains.d}));
  }

  bool fill(pid_tuner::Attitude& attitude) {
    attitude = {pitch_, pitch_rate_, setpoint_};
    return true;
  }

  bool fill(pid_tuner::Motors& motors) {
    motors = {output_, output_};
    return true;
  }

 private:
  struct Gains {
    float p = 0.0F;
    float i = 0.0F;
    float d = 0.0F;
  };

  static constexpr std::uint8_t balance_index = 0;
  static constexpr std::uint8_t velocity_index = 1;
  static constexpr float most_travelled_m = 5.0F;  // sums are bounded, so that they unwind in time
  static constexpr float most_error_sum_rad_s = 1.0F;

  static bool in_range(float gain) { return gain >= -largest_gain && gain <= largest_gain; }

  static float limited(float value, float limit) { return value > limit ? limit : value < -limit ? -limit : value; }

  /// The motors stop when gains change, and what the old gains summed up is forgotten; the next step begins anew.
  void change(const pid_tuner::Pid& pid) {
    if (pid.idx == balance_index) {
      balance_ = {pid.p, pid.i, pid.d};
    } else {
      velocity_ = {pid.p, pid.p / velocity_p_for_each_i, 0.0F};
    }
    rest();
  }

  bool stands() {
    const float lean = pitch_ < 0.0F ? -pitch_ : pitch_;
    if (lean > fallen_rad) fallen_ = true;
    if (lean < upright_rad) fallen_ = false;
    return !fallen_;
  }

  void rest() {
    error_sum_ = 0.0F;
    travelled_ = 0.0F;
    drive(0.0F);
  }

  void drive(float output) {
    output_ = output;
    board_.set_motors(output, output);
  }

  void acknowledge(std::uint32_t of, pid_tuner::Acknowledge::Result result) {
    static_cast<void>(board_.send(pid_tuner::Acknowledge{static_cast<std::uint8_t>(of), result}));
  }

  Board& board_;
  Gains balance_;
  Gains velocity_;
  float pitch_ = 0.0F;
  float pitch_rate_ = 0.0F;
  float setpoint_ = 0.0F;
  float error_sum_ = 0.0F;
  float travelled_ = 0.0F;
  float output_ = 0.0F;
  bool fallen_ = true;  // until it was seen upright
};

}  // namespace balance
