// The pause between two sent frames, where silence ends a frame. Times only: no queue, no port.
#pragma once

#include <atomic>
#include <cstdint>

#include "wirebond/mcu/atomics.hpp"

namespace wirebond {

/// The problem: the interrupt knows when a run has left, but often not the time; and the time passed to the first poll
/// after the run may be from before its end.
///
/// The answer: without a clock the pause is measured from the second poll after the run. So it is up to two polls
/// longer than `pause_us`, and never shorter. `begin` and `is_over` belong to the UART's interrupt, `poll` to its own
/// context.
template <std::uint32_t pause_us>
class SendPause {
 public:
  /// Begin the pause: a run has just left.
  void begin() { phase_.store(unknown, std::memory_order_release); }  // pairs with `poll`

  /// Begin it at `now_us`, by the clock of `poll`.
  void begin_at(std::uint32_t now_us) {
    begun_us_.store(now_us, std::memory_order_relaxed);
    phase_.store(timed, std::memory_order_release);  // after the time; pairs with `poll`
  }

  bool is_over() const { return phase_.load(std::memory_order_acquire) == over; }  // pairs with `poll`

  /// Advance the pause. No run is sent during a pause, so the interrupt changes nothing between the load and the store.
  void poll(std::uint32_t now_us) {
    const std::uint8_t phase = phase_.load(std::memory_order_acquire);  // pairs with `begin` and `begin_at`
    if (phase == unknown) {
      phase_.store(seen, std::memory_order_release);  // pairs with `is_over`
    } else if (phase == seen) {
      begin_at(now_us);
    } else if (phase == timed) {  // an event may be newer than `now_us`
      const auto silent = static_cast<std::int32_t>(now_us - begun_us_.load(std::memory_order_relaxed));
      if (silent >= static_cast<std::int32_t>(pause_us)) phase_.store(over, std::memory_order_release);
    }
  }

 private:
  enum Phase : std::uint8_t {
    over,     // the line may be used
    unknown,  // a run has left, and no poll came since
    seen,     // one poll came, whose time may be from before
    timed,    // since begun_us_
  };
  LoadStore<std::uint8_t> phase_{over};
  LoadStore<std::uint32_t> begun_us_{0};
};

/// For frames that follow each other: nothing is measured, and no memory is used.
template <>
class SendPause<0> {};

}  // namespace wirebond
