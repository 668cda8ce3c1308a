// How old received bytes are, and whether the ring was read often enough to have counted them. Times and positions
// only.
#pragma once

#include <array>
#include <atomic>
#include <cstddef>
#include <cstdint>
#include <type_traits>
#include <utility>

#include "wirebond/mcu/atomics.hpp"

namespace wirebond {

namespace detail {

template <class Port, class = void>
struct HasClock : std::false_type {};
template <class Port>
struct HasClock<Port, std::void_t<decltype(std::declval<Port&>().now_us())>> : std::true_type {};

/// Whether this port's clock runs: a port of C may lack that function.
template <class Port>
auto clock_runs(const Port& port, int) -> decltype(port.clock_runs()) {
  return port.clock_runs();
}
template <class Port>
bool clock_runs(const Port&, long) {
  return true;
}

/// Whether the port moves each byte itself, and calls `on_received` at least once per turn of the ring. It declares
/// that with a member of this name, constant or not.
template <class Port>
auto tells_every_lap(const Port& port, int) -> decltype(static_cast<bool>(port.tells_every_lap)) {
  return port.tells_every_lap;
}
template <class Port>
bool tells_every_lap(const Port&, long) {
  return false;
}

}  // namespace detail

/// Some bytes: they came at `came_us` or later, and at `until_us` or earlier.
struct Aged {
  std::size_t size;
  std::uint32_t came_us;
  std::uint32_t until_us;
  bool ends_at_event = false;  ///< a receive event came at `until_us`, when DMA was just after the last of them
};

/// For a port without a clock: bytes are as old as the poll before the one that found them.
template <bool has_clock>
class ReceiveAge {
 public:
  static constexpr bool is_stamped = false;

  /// Note that reception begins.
  void start(std::uint32_t) {}

  /// Note that `poll` begins, at `now_us`; the one before began at `before_us`. Returns true if the ring was not read
  /// for `limit_us`.
  bool is_late(std::uint32_t before_us, std::uint32_t now_us, std::uint32_t limit_us) {
    return now_us - before_us >= limit_us;
  }

  /// Return the first of the `size` bytes from `position` on that came at one time.
  Aged first(std::uint32_t, std::size_t size, std::uint32_t before_us, std::uint32_t now_us) const {
    return {size, before_us, now_us};
  }

  /// Note when the last byte being delivered came, as exactly as it is known.
  void note_came(std::uint32_t) {}
  std::uint32_t came_us(std::uint32_t now_us) const { return now_us; }
};

/// For a port with a clock, which is that of `poll`: each receive event of the UART's interrupt stamps the position and
/// the time, and bytes are as old as the stamp before them. The newest four stamps are kept; bytes before them are as
/// old as the poll before. Written by the interrupt, read by `poll`, which never runs inside the interrupt's events.
template <>
class ReceiveAge<true> {
 public:
  static constexpr bool is_stamped = true;

  void start(std::uint32_t now_us) {
    looked_us_.store(now_us, std::memory_order_relaxed);
    noted_ = noted_before_ = version_.load(std::memory_order_relaxed);
  }

  /// Note in the UART's interrupt: DMA was at `position` at `now_us`.
  void stamp(std::uint32_t position, std::uint32_t now_us, std::uint32_t limit_us) {
    if (has_passed(now_us, limit_us)) is_late_.store(true, std::memory_order_relaxed);
    looked_us_.store(now_us, std::memory_order_relaxed);
    const std::uint32_t version = version_.load(std::memory_order_relaxed);
    version_.store(version + 1, std::memory_order_relaxed);
    std::atomic_thread_fence(std::memory_order_release);  // before the stamps; pairs with `first`
    stamps_[version / 2 % stamps_.size()].set(position, now_us);
    version_.store(version + 2, std::memory_order_release);  // after them; pairs with `first`
  }

  bool is_late(std::uint32_t, std::uint32_t now_us, std::uint32_t limit_us) {
    const bool passed = has_passed(now_us, limit_us);
    looked_us_.store(now_us, std::memory_order_relaxed);
    noted_before_ = noted_;
    noted_ = version_.load(std::memory_order_relaxed);
    if (!is_late_.load(std::memory_order_relaxed)) return passed;
    is_late_.store(false, std::memory_order_relaxed);
    return true;
  }

  Aged first(std::uint32_t position, std::size_t size, std::uint32_t before_us, std::uint32_t now_us) const {
    for (;;) {
      const std::uint32_t version = version_.load(std::memory_order_acquire);  // pairs with `stamp`
      Aged bytes{size, before_us, now_us};
      // Stamps older than the poll before mean nothing, and their times may have wrapped.
      const std::uint32_t newest = version / 2;
      const std::uint32_t fresh = (version - noted_before_) / 2;
      const std::uint32_t kept = fresh < stamps_.size() ? fresh : static_cast<std::uint32_t>(stamps_.size());
      for (std::uint32_t i = newest - kept; i != newest; ++i) {  // the oldest first
        const Stamp& stamp = stamps_[i % stamps_.size()];
        if (!is_later(stamp.time_us(), bytes.came_us)) continue;
        const std::uint32_t ahead = stamp.position() - position;
        if (static_cast<std::int32_t>(ahead) <= 0) {
          bytes.came_us = stamp.time_us();
          continue;
        }
        bytes.ends_at_event = ahead <= bytes.size;
        if (bytes.ends_at_event) bytes.size = ahead;
        if (is_later(now_us, stamp.time_us())) bytes.until_us = stamp.time_us();
        break;  // the next ones are farther
      }
      std::atomic_thread_fence(std::memory_order_acquire);  // after the stamps; pairs with `stamp`
      if ((version & 1u) == 0 && version_.load(std::memory_order_relaxed) == version) return bytes;
    }
  }

  void note_came(std::uint32_t at_us) { came_us_ = at_us; }
  std::uint32_t came_us(std::uint32_t) const { return came_us_; }

 private:
  class Stamp {
   public:
    std::uint32_t position() const { return position_.load(std::memory_order_relaxed); }
    std::uint32_t time_us() const { return time_us_.load(std::memory_order_relaxed); }
    void set(std::uint32_t position, std::uint32_t time_us) {
      position_.store(position, std::memory_order_relaxed);
      time_us_.store(time_us, std::memory_order_relaxed);
    }

   private:
    LoadStore<std::uint32_t> position_{0};
    LoadStore<std::uint32_t> time_us_{0};
  };

  static bool is_later(std::uint32_t a, std::uint32_t b) { return static_cast<std::int32_t>(a - b) > 0; }

  /// Check whether the ring was not read for `limit_us`. An event in between may have been later than `now_us`.
  bool has_passed(std::uint32_t now_us, std::uint32_t limit_us) const {
    const std::uint32_t looked_us = looked_us_.load(std::memory_order_relaxed);
    return is_later(now_us, looked_us) && now_us - looked_us >= limit_us;
  }

  LoadStore<std::uint32_t> looked_us_{0};
  LoadStore<bool> is_late_{false};
  LoadStore<std::uint32_t> version_{0};  // odd: the stamps are being written
  std::array<Stamp, 4> stamps_;          // number n at place n modulo 4; a power of two, so that numbers may wrap
  std::uint32_t came_us_ = 0;            // poll's own, as the two below
  std::uint32_t noted_ = 0;              // version_ when `poll` last began
  std::uint32_t noted_before_ = 0;       // and the time before
};

}  // namespace wirebond
