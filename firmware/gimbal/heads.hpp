// Heads that are always at their commanded pose, for boards that cannot measure it. Poses only: no message, no output.
#pragma once

#include <atomic>

#include "gimbal.hpp"

namespace gimbal {

/// One context aims, any may read. Each angle is whole at any moment; the two of a pose may be of two commands.
class Heads {
 public:
  Pose small_head() const { return {small_yaw_, small_pitch_}; }
  Pose big_head() const { return {big_yaw_, big_pitch_}; }

  /// The left head's pose counts as the small head's: the protocol's message holds only one.
  void aim(const Pose& left, const Pose& main) {
    small_yaw_ = left.yaw_rad;
    small_pitch_ = left.pitch_rad;
    big_yaw_ = main.yaw_rad;
    big_pitch_ = main.pitch_rad;
  }

 private:
  std::atomic<float> small_yaw_{0.0F}, small_pitch_{0.0F}, big_yaw_{0.0F}, big_pitch_{0.0F};
};

}  // namespace gimbal
