// Limits how much of the line's time the port's driver may hold: no frame, no queue.
#pragma once

#include <algorithm>
#include <cstddef>
#include <cstdint>

namespace wirebond {

/// The problem: a driver takes thousands of bytes before the first one has left, and those bytes cannot be called back,
/// not even for a stop.
///
/// The answer: this class computes when those bytes will have left, so that the next frame is given only shortly
/// before:
/// - a frame that leaves within `most_us`, including all that was given before it, may go at once;
/// - a longer frame may go once at most `lead_us` of line time is left before it.
/// So the driver holds at most 5 ms of line time; or one frame, if it takes longer than 4 ms, after the last
/// millisecond of the one before it. The line does not run dry while the caller is in time: it may be late by almost
/// 4 ms for short frames, by 1 ms for long ones.
///
/// Where silence ends a frame, a frame is given only once the one before it has left and the line has been silent for
/// the pause: the driver never holds two frames.
///
/// Time is in microseconds and does not wrap. One thread at a time.
class Pacing {
 public:
  static constexpr std::uint64_t most_us = 5'000;
  static constexpr std::uint64_t lead_us = 1'000;
  static constexpr std::uint64_t refill_us = 4'000;  ///< line time left when more should be given

  /// Not paced: the driver takes as much as it can. For ports whose baud rate means nothing (USB CDC, TCP).
  constexpr Pacing() = default;

  /// `bits_per_byte`: start, data, parity and stop bits together. `baud` 0: not paced. `pause_us`: silence between two
  /// frames, where silence ends a frame; 0: none.
  constexpr Pacing(std::uint32_t baud, unsigned bits_per_byte, std::uint32_t pause_us = 0)
      : baud_(baud), bits_per_byte_(bits_per_byte), pause_us_(pause_us) {}

  constexpr bool is_paced() const { return baud_ != 0; }

  /// Time that `size` bytes take on the line.
  constexpr std::uint64_t line_us(std::size_t size) const { return (line_ns(size) + 999) / 1000; }

  /// Line time of the bytes that were given and have not left.
  constexpr std::uint64_t waiting_us(std::uint64_t now_us) const {
    const std::uint64_t now_ns = now_us * 1000;
    return free_ns_ <= now_ns ? 0 : (free_ns_ - now_ns + 999) / 1000;
  }

  /// Check whether a frame of `size` bytes may be given now.
  constexpr bool may_begin(std::size_t size, std::uint64_t now_us) const {
    if (pause_us_ != 0) return now_us >= pause_ends_us();
    return !is_paced() || waiting_us(now_us) <= room_us(size);
  }
  /// Check it for a frame directly after others, which have `ahead` bytes and are given with it.
  constexpr bool may_follow(std::size_t ahead, std::size_t size, std::uint64_t now_us) const {
    return pause_us_ == 0 && (!is_paced() || waiting_us(now_us) + line_us(ahead) <= room_us(size));
  }

  /// Return when to try again after `may_begin` returned false: early enough that the line does not run dry, but not
  /// for each frame.
  constexpr std::uint64_t begins_at_us(std::size_t size, std::uint64_t now_us) const {
    if (pause_us_ != 0) return std::max(now_us, pause_ends_us());
    const std::uint64_t left = std::min(room_us(size), refill_us);
    const std::uint64_t waiting = waiting_us(now_us);
    return waiting <= left ? now_us : now_us + (waiting - left);
  }

  /// Note that the driver took `size` bytes.
  constexpr void written(std::size_t size, std::uint64_t now_us) {
    free_ns_ = std::max(free_ns_, now_us * 1000) + line_ns(size);
  }

  /// Note the driver's report that `size` bytes have not left yet: the line may be slower than its rate. More bytes may
  /// be in a USB adapter, unknown to the driver, so a small number shortens nothing.
  constexpr void driver_holds(std::size_t size, std::uint64_t now_us) {
    if (is_paced()) free_ns_ = std::max(free_ns_, now_us * 1000 + line_ns(size));
  }

  /// Start again with another port, whose driver holds nothing.
  constexpr void forget() { free_ns_ = 0; }

 private:
  /// Where silence ends a frame: return when the next one may begin. 0: nothing was sent before it.
  constexpr std::uint64_t pause_ends_us() const { return free_ns_ == 0 ? 0 : (free_ns_ + 999) / 1000 + pause_us_; }

  constexpr std::uint64_t line_ns(std::size_t size) const {
    return baud_ == 0 ? 0 : static_cast<std::uint64_t>(size) * bits_per_byte_ * 1'000'000'000 / baud_;
  }

  /// Line time that may be before a frame of this size.
  constexpr std::uint64_t room_us(std::size_t size) const {
    const std::uint64_t own = line_us(size);
    return own + lead_us >= most_us ? lead_us : most_us - own;
  }

  std::uint32_t baud_ = 0;
  unsigned bits_per_byte_ = 10;
  std::uint32_t pause_us_ = 0;
  std::uint64_t free_ns_ = 0;  ///< when the last given byte will have left
};

}  // namespace wirebond
