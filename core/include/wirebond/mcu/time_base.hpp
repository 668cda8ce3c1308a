// Checks that the time passed to `poll` is a clock of microseconds that never goes back. Times and counts: no ring, no
// frame.
#pragma once

#include <cstddef>
#include <cstdint>
#include <type_traits>
#include <utility>

#include "wirebond/mcu/atomics.hpp"
#include "wirebond/mcu/receive_age.hpp"

namespace wirebond {

namespace detail {

/// Whether bytes may come faster than the file's `link: baud`, as over USB or a pty. A port declares that with a member
/// of this name, constant or not.
template <class Port>
auto is_unpaced(const Port& port, int) -> decltype(static_cast<bool>(port.is_unpaced)) {
  return port.is_unpaced;
}
template <class Port>
bool is_unpaced(const Port&, long) {
  return false;
}

/// Whether the port has another clock, such as the tick of the vendor's library: `std::uint32_t tick_ms() const`, in
/// milliseconds. It may stop at times, and never runs ahead.
template <class Port, class = void>
struct HasTick : std::false_type {};
template <class Port>
struct HasTick<Port, std::void_t<decltype(std::declval<const Port&>().tick_ms())>> : std::true_type {};

/// Whether this port's tick runs: a port of C may lack that function.
template <class Port>
auto tick_runs(const Port& port, int) -> decltype(port.tick_runs()) {
  return port.tick_runs();
}
template <class Port>
bool tick_runs(const Port&, long) {
  return true;
}

/// Compares the time passed to `poll` with the port's tick, or with its clock if it has no tick.
template <bool has_reference>
class TimeReference {
 public:
  template <class Port>
  void compare(const Port& port, std::uint32_t now_us) {
    if constexpr (HasTick<Port>::value) {
      if (tick_runs(port, 0)) return compare(port.tick_ms() * 1000, now_us, false);
    }
    if constexpr (HasClock<Port>::value) {
      if (clock_runs(port, 0)) compare(port.now_us(), now_us, true);
    }
  }
  bool differs() const { return differs_; }

 private:
  static constexpr std::uint32_t window_us = 500'000;

  /// `is_exact`: both are one clock. Otherwise the reference may stop, and only a time that passes too slowly is wrong.
  void compare(std::uint32_t reference_us, std::uint32_t now_us, bool is_exact) {
    const std::uint32_t reference_passed_us = reference_us - reference_us_;
    const std::uint32_t passed_us = now_us - now_us_;
    if (has_begun_ && reference_passed_us < window_us && !(is_exact && passed_us >= window_us)) return;
    if (has_begun_) {
      differs_ = passed_us < reference_passed_us / 2 || (is_exact && reference_passed_us < passed_us / 2);
    }
    has_begun_ = true;
    reference_us_ = reference_us;
    now_us_ = now_us;
  }

  std::uint32_t reference_us_ = 0;  ///< when the window began, by either clock
  std::uint32_t now_us_ = 0;
  bool has_begun_ = false;
  bool differs_ = false;
};

/// For a port without another clock: takes no byte.
template <>
class TimeReference<false> {
 public:
  template <class Port>
  void compare(const Port&, std::uint32_t) {}
  static constexpr bool differs() { return false; }
};

}  // namespace detail

/// A link's own time. It follows the time passed to `poll`, except for steps back: a program's clock made of a tick and
/// a timer may step back by a millisecond. Without this, such a step would count as 71 minutes of silence.
class TimeBase {
 public:
  /// A larger step back counts as a long time without a poll, and deadlines strike.
  static constexpr std::uint32_t most_step_us = 1'000'000;

  /// Return the link's own time at this poll; `before_us`: at the poll before.
  std::uint32_t follow(std::uint32_t given_us, std::uint32_t before_us) {
    const std::uint32_t now_us = own(given_us);
    const std::uint32_t back_us = before_us - now_us;
    if (back_us == 0 || back_us > most_step_us) return now_us;
    steps_ += 1;
    ahead_us_.store(before_us - given_us, std::memory_order_relaxed);
    return before_us;
  }

  /// Convert a time from the program or the port to the link's own, and back. Any context.
  std::uint32_t own(std::uint32_t given_us) const { return given_us + ahead_us_.load(std::memory_order_relaxed); }
  std::uint32_t given(std::uint32_t own_us) const { return own_us - ahead_us_.load(std::memory_order_relaxed); }

  std::uint32_t steps() const { return steps_; }

  /// Note that so many bytes came in `passed_us`; `half_byte_256`: half of a byte's time on the line, in 1/256 us.
  /// Half, because the clocks of both ends differ, and a rate somewhat above the file's must not count as a fault of
  /// the clock.
  void came(std::size_t bytes, std::uint32_t passed_us, std::uint32_t half_byte_256) {
    if (is_too_slow()) return;
    owed_us_ += static_cast<std::uint32_t>(bytes) * half_byte_256 >> 8;
    owed_us_ = owed_us_ > passed_us ? owed_us_ - passed_us : 0;
  }

  /// Check whether more bytes came than the line could carry in that time. Stays true once it is.
  bool is_too_slow() const { return owed_us_ > most_owed_us; }

 private:
  static constexpr std::uint32_t most_owed_us = 20'000;  ///< more than a tick of an RTOS

  LoadStore<std::uint32_t> ahead_us_{0};  ///< ahead of the given time, by all steps back
  std::uint32_t steps_ = 0;
  std::uint32_t owed_us_ = 0;  ///< line time of received bytes, minus the time that passed
};

}  // namespace wirebond
