// A linear axis's firmware without its board: a slide that moves as commanded, between the two ends of its rail. It
// uses all services of its protocol file: the link answers hello, ping, clock and parameters, and sends its counters.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <string_view>

#include "linear_axis_link.hpp"  // generated: wirebond gen protocols/linear_axis.yaml

namespace axis {

/// A receive ring for 11 ms of the line, and send memory for as long: place it where the UART's DMA can reach it.
using Buffers = linear_axis::McuBuffers<512, 512>;

/// Parameters, by their names in the file.
enum class Parameter : std::size_t { max_speed, acceleration, travel };

/// Functions that the firmware needs from a board. Called in `poll`.
///
///   float position_m();                           // from the lower end
///   void set_speed(float speed_m_s);              // of the slide, from now on
///   void store(std::size_t index, float value);   // of a parameter that was set; it may be forgotten
///
/// `poll` handles messages in its own context. Times are microseconds and may wrap.
template <class Board, class Port>
class Axis {
 public:
  using Link = linear_axis::McuLink<Axis, Port, Buffers>;
  using Stops = linear_axis::State::Stops;

  Axis(Board& board, Port& port, Buffers& buffers) : board_(board), link_(*this, port, buffers) {
    board_.set_speed(0.0F);  // until the first valid command
  }

  /// For the UART's interrupt, which calls the link's `on_...` functions.
  Link& link() { return link_; }

  /// Call it every millisecond.
  void poll(std::uint32_t now_us) {
    const float seconds = is_timed_ ? static_cast<float>(now_us - now_us_) * 1e-6F : 0.0F;
    is_timed_ = true;
    now_us_ = now_us;
    link_.poll(now_us);
    steer(seconds);
  }

  bool is_stopped_by_silence() const { return link_.struck(linear_axis::Action::stop); }

  // ---- messages, deadlines and parameters, in `poll`

  void on(const linear_axis::Move& move) { wanted_m_s_ = move.speed; }

  bool fill(linear_axis::State& state) {
    state.measured = now_us_;  // the clock of `poll`, which is the one of the clock service
    state.position = board_.position_m();
    state.speed = speed_m_s_;
    state.stops = stops_;
    if (is_stopped_by_silence()) state.stops |= Stops::silence;
    return true;
  }

  void stop() {
    wanted_m_s_ = 0.0F;
    say(wirebond::Level::warning, "stopped: no move for 200 ms");
  }

  auto& parameters() { return parameters_; }
  void parameter_set(std::size_t index, float value) { board_.store(index, value); }

 private:
  static constexpr std::array<wirebond::ParameterRule, 3> rules = {{
      {0.0F, 1.0F, 0.5F},   // max_speed, m/s
      {0.1F, 20.0F, 5.0F},  // acceleration, m/s^2
      {0.0F, 2.0F, 1.0F},   // travel, m: from the lower end to the upper one
  }};

  float parameter(Parameter name) const { return parameters_[static_cast<std::size_t>(name)]; }

  /// Move the speed towards the wanted one as fast as the acceleration allows. At an end of the rail it is zero at
  /// once.
  void steer(float seconds) {
    const float limit = parameter(Parameter::max_speed);
    const float wanted = bounded(wanted_m_s_, limit);
    speed_m_s_ += bounded(wanted - speed_m_s_, parameter(Parameter::acceleration) * seconds);
    const float position_m = board_.position_m();
    std::uint8_t stops = 0;
    if (position_m <= 0.0F && wanted < 0.0F) stops |= Stops::lower_end;
    if (position_m >= parameter(Parameter::travel) && wanted > 0.0F) stops |= Stops::upper_end;
    if (stops != 0) {
      speed_m_s_ = 0.0F;
      if (stops_ == 0) say(wirebond::Level::info, "end of the rail");
    }
    stops_ = stops;
    board_.set_speed(speed_m_s_);
  }

  /// Send a log line. If the send queue is full the line is lost, and counted.
  void say(wirebond::Level level, std::string_view text) { static_cast<void>(link_.log(level, text)); }

  static float bounded(float value, float limit) { return value > limit ? limit : value < -limit ? -limit : value; }

  Board& board_;
  Link link_;
  wirebond::Parameters<3> parameters_{rules};
  std::uint8_t stops_ = 0;
  float wanted_m_s_ = 0.0F;
  float speed_m_s_ = 0.0F;
  std::uint32_t now_us_ = 0;
  bool is_timed_ = false;
};

}  // namespace axis
