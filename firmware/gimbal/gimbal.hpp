// A sentry's double gimbal without its board: four tasks each send its pose a thousand times a second; commands aim it.
#pragma once

#include <array>
#include <atomic>
#include <cmath>
#include <cstddef>
#include <cstdint>

#include "enterprize_link.hpp"  // generated: wirebond gen protocols/enterprize.yaml

namespace gimbal {

/// Senders with their own priorities, each once per `period_us`. Together they use 99 % of a line of 2 Mbaud with two
/// stop bits: the overload test of the specification that defines this protocol.
constexpr std::size_t senders = 4;
constexpr std::uint32_t period_us = 1000;

/// A receive ring for 2.8 ms of the line, and send memory for 22 messages: place it where the UART's DMA can reach it.
using Buffers = enterprize::McuBuffers<512, 1024>;

struct Pose {
  float yaw_rad;
  float pitch_rad;
};

/// Functions that the firmware needs from a board.
///
///   Pose small_head(); Pose big_head();       // measured; from any of the senders' tasks
///   float bullet_speed_m_s();                 // the same
///   void aim(const Pose& left, const Pose& right, const Pose& main);    // in `poll`, as the next one
///   void shoot(std::uint8_t left_mode, std::uint8_t right_mode);        // 0: not
///
/// `poll` handles messages in its own context. Times are microseconds and may wrap.
template <class Board, class Port>
class Gimbal {
 public:
  using Link = enterprize::McuLink<Gimbal, Port, Buffers>;

  Gimbal(Board& board, Port& port, Buffers& buffers) : board_(board), link_(*this, port, buffers) {
    board_.shoot(0, 0);  // until the first valid command; the heads stay in place until then
  }

  /// For the UART's interrupt, which calls the link's `on_...` functions.
  Link& link() { return link_; }

  /// Call it every millisecond or two.
  void poll(std::uint32_t now_us) { link_.poll(now_us); }

  /// Do the work of sender 0 to 3, every `period_us`. Each has its own task; they may interrupt each other anywhere.
  /// The message's `cur_cv_mode` is the sender, and its `target_color` counts, so that the host sees losses.
  wirebond::Status report(std::size_t sender) {
    enterprize::SentryGimbalMsg message;
    message.cur_cv_mode = static_cast<std::uint8_t>(sender);
    message.target_color = counts_[sender]++;
    message.bullet_speed = board_.bullet_speed_m_s();
    message.small_q = attitude(board_.small_head());
    message.big_q = attitude(board_.big_head());
    return link_.send(message);
  }

  // ---- messages and the link's state, in `poll`

  void on(const enterprize::SentryGimbalCmd& command) {
    board_.aim({command.l_target_yaw, command.l_target_pitch}, {command.r_target_yaw, command.r_target_pitch},
               {command.main_target_yaw, command.main_target_pitch});
    board_.shoot(command.l_shoot_mode, command.r_shoot_mode);
  }

  void link_state(wirebond::LinkState state) {
    if (state != wirebond::LinkState::up) board_.shoot(0, 0);
  }

 private:
  /// Return the unit quaternion (w, x, y, z) of a turn by yaw, then by pitch.
  static std::array<float, 4> attitude(const Pose& pose) {
    const float cos_yaw = std::cos(pose.yaw_rad / 2.0F), sin_yaw = std::sin(pose.yaw_rad / 2.0F);
    const float cos_pitch = std::cos(pose.pitch_rad / 2.0F), sin_pitch = std::sin(pose.pitch_rad / 2.0F);
    return {cos_yaw * cos_pitch, -sin_yaw * sin_pitch, cos_yaw * sin_pitch, sin_yaw * cos_pitch};
  }

  Board& board_;
  Link link_;
  std::array<std::uint8_t, senders> counts_{};  // each used by one sender alone
};

}  // namespace gimbal
