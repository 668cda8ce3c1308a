// How long frames have waited to be sent, if the file has `max_age`. A clock, and when to check; no queue.
#pragma once

#include <cstdint>

#include "wirebond/mcu/atomics.hpp"

namespace wirebond {

/// The problem: a frame has only 16 bits for its stamp, in units of 1024 us, so ages beyond 64 s cannot be
/// distinguished from small ones.
///
/// The answer: two rules keep stamps from growing that old:
/// - A pause between two polls moves the clock by at most `max_age` and one unit. All that was stamped before a longer
///   pause is too old after it, and no pause is long enough to make it new again.
/// - While polls come and the line takes nothing, the interrupt is pended every `sweep_units` to check for old frames.
///   If it does not run for long, all waiting frames are too old by the time it does.
///
/// `max_age_ms` is rounded up, so that no frame expires early. `stamp` in any context, `poll` in its own, `expire` in
/// the UART's interrupt.
template <std::uint16_t max_age_ms>
class SendAge {
 public:
  std::uint16_t stamp() const { return clock_.load(std::memory_order_relaxed); }

  /// Start: frames that were reserved before that, and are finished after it, are too old.
  void start_age(std::uint32_t now_us) {
    moved_us_ = now_us;
    move(max_units + 1);
    swept_.store(stamp(), std::memory_order_relaxed);
    is_overdue_.store(false, std::memory_order_relaxed);
  }

  /// Move the clock. Returns true if the caller must pend the interrupt, so that it checks.
  bool age_to(std::uint32_t now_us) {
    const std::uint32_t passed_us = now_us - moved_us_;
    if (passed_us > ~std::uint32_t{0} - step_back_us) {  // the clock stepped back: unknown how much has passed
      moved_us_ = now_us;
      return false;
    }
    const std::uint32_t units = passed_us >> 10;
    moved_us_ += units << 10;
    move(units > max_units ? max_units + 1 : units);
    const std::uint16_t unswept = static_cast<std::uint16_t>(stamp() - swept_.load(std::memory_order_relaxed));
    if (unswept >= overdue_units) is_overdue_.store(true, std::memory_order_relaxed);
    return unswept >= sweep_units;
  }

  template <class Outbox>
  void expire(Outbox& outbox) {
    const std::uint16_t now = stamp();
    if (is_overdue_.load(std::memory_order_relaxed)) {
      is_overdue_.store(false, std::memory_order_relaxed);
      outbox.expire_all();
    } else {
      outbox.expire_older(now, max_units);
    }
    swept_.store(now, std::memory_order_relaxed);
  }

 private:
  void move(std::uint32_t units) {
    clock_.store(static_cast<std::uint16_t>(stamp() + units), std::memory_order_relaxed);
  }

  static constexpr std::uint32_t step_back_us = 1'000'000;
  static constexpr std::uint16_t max_units =
      static_cast<std::uint16_t>((max_age_ms * std::uint32_t{1000} + 1023) / 1024);
  static constexpr std::uint16_t sweep_units = 8'192;
  static constexpr std::uint16_t overdue_units = 2 * sweep_units;
  static_assert(overdue_units + max_units + 1 < 0x10000 - 1024, "a stamp gives an age until the next sweep");

  LoadStore<std::uint16_t> clock_{0};
  LoadStore<std::uint16_t> swept_{0};  ///< the clock when the interrupt last checked
  LoadStore<bool> is_overdue_{false};
  std::uint32_t moved_us_ = 0;  ///< poll's own: time up to which the clock was moved
};

/// For frames that wait without limit: nothing is measured, and no memory is used.
template <>
class SendAge<0> {
 public:
  static constexpr std::uint16_t stamp() { return 0; }
  static constexpr void start_age(std::uint32_t) {}
  static constexpr bool age_to(std::uint32_t) { return false; }
  template <class Outbox>
  static constexpr void expire(Outbox&) {}
};

}  // namespace wirebond
