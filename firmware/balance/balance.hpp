// A balance bot's firmware without its board: two control loops, and messages that tune them while it balances.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>

#include "pid_tuner_link.hpp"  // generated: wirebond gen protocols/pid_tuner.yaml

namespace balance {

constexpr std::uint32_t step_us = 5000;          ///< period of the control loop
constexpr float most_lean_rad = 0.15F;           ///< maximum that the outer loop may request
constexpr float fallen_rad = 0.6F;               ///< beyond, it cannot recover
constexpr float upright_rad = 0.05F;             ///< somebody has put it up again
constexpr float largest_gain = 1000.0F;          ///< of each kind; larger ones are refused
constexpr float velocity_p_for_each_i = 200.0F;  ///< the outer loop's i follows from its p

/// A receive ring for 44 ms of the line, and send memory for the reports of two loops: place it where the UART's DMA
/// can reach it.
using Buffers = pid_tuner::McuBuffers<512, 256>;

/// Functions that the firmware needs from a board. Called only from `Balance`'s own functions.
///
///   float pitch_rad();                        // positive: it leans forwards
///   float pitch_rate_rad_s();
///   float speed_m_s();                        // of the wheels
///   void set_motors(float left, float right); // -1 to 1 of full voltage, positive: forwards
///
/// `poll` runs everything here in its own context. Times are microseconds and may wrap.
template <class Board, class Port>
class Balance {
 public:
  using Link = pid_tuner::McuLink<Balance, Port, Buffers>;

  Balance(Board& board, Port& port, Buffers& buffers) : board_(board), link_(*this, port, buffers) {
    rest();  // all gains are 0 until the first message
  }

  /// For the UART's interrupt, which calls the link's `on_...` functions.
  Link& link() { return link_; }

  /// Handle messages, and control every `step_us`. Call it every millisecond.
  void poll(std::uint32_t now_us) {
    link_.poll(now_us);
    if (now_us - stepped_us_ < step_us) return;
    // Keep the rhythm, unless a step was missed: a loop that makes up for lost steps would use the same angle several
    // times.
    stepped_us_ = now_us - stepped_us_ < 2 * step_us ? stepped_us_ + step_us : now_us;
    step();
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
    static_cast<void>(link_.send(pid_tuner::Gains{request.idx, gains.p, gains.i, gains.d}));
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
  static constexpr float most_travelled_m = 5.0F;  // sums are limited, so that they unwind in time
  static constexpr float most_error_sum_rad_s = 1.0F;

  static bool in_range(float gain) { return gain >= -largest_gain && gain <= largest_gain; }

  static float limited(float value, float limit) { return value > limit ? limit : value < -limit ? -limit : value; }

  /// Change gains. The motors stop, the sums of the old gains are forgotten, and the next step starts afresh.
  void change(const pid_tuner::Pid& pid) {
    if (pid.idx == balance_index) {
      balance_ = {pid.p, pid.i, pid.d};
    } else {
      velocity_ = {pid.p, pid.p / velocity_p_for_each_i, 0.0F};
    }
    rest();
  }

  void step() {
    constexpr float step_s = static_cast<float>(step_us) * 1e-6F;
    pitch_ = board_.pitch_rad();
    pitch_rate_ = board_.pitch_rate_rad_s();
    if (!stands()) {
      rest();
      return;
    }
    // The outer loop leans against the wheels' direction; the inner one drives the wheels under the body.
    const float speed = board_.speed_m_s();
    travelled_ = limited(travelled_ + speed * step_s, most_travelled_m);
    setpoint_ = limited(-(velocity_.p * speed + velocity_.i * travelled_), most_lean_rad);
    const float error = pitch_ - setpoint_;
    error_sum_ = limited(error_sum_ + error * step_s, most_error_sum_rad_s);
    drive(limited(balance_.p * error + balance_.i * error_sum_ + balance_.d * pitch_rate_, 1.0F));
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
    static_cast<void>(link_.send(pid_tuner::Acknowledge{static_cast<std::uint8_t>(of), result}));
  }

  Board& board_;
  Link link_;
  Gains balance_;
  Gains velocity_;
  float pitch_ = 0.0F;
  float pitch_rate_ = 0.0F;
  float setpoint_ = 0.0F;
  float error_sum_ = 0.0F;
  float travelled_ = 0.0F;
  float output_ = 0.0F;
  std::uint32_t stepped_us_ = 0;
  bool fallen_ = true;  // until it was seen upright
};

}  // namespace balance
