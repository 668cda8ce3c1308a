// The plain answer to many senders: a byte ring behind a mutex. What the send queue is compared with.
#pragma once

#include <algorithm>
#include <array>
#include <cstddef>
#include <cstdint>
#include <mutex>

/// Frames of up to 255 bytes whose first byte is their size. A sender waits for the lock; the copy is made under it.
template <std::size_t Capacity>
class MutexRing {
 public:
  /// False: no room.
  bool push(const std::uint8_t* frame, std::size_t size) {
    const std::lock_guard lock(mutex_);
    if (size > Capacity - used_) return false;
    const std::size_t at = (begin_ + used_) % Capacity;
    const std::size_t before_end = std::min(size, Capacity - at);
    std::copy_n(frame, before_end, ring_.begin() + static_cast<std::ptrdiff_t>(at));
    std::copy_n(frame + before_end, size - before_end, ring_.begin());
    used_ += size;
    return true;
  }

  /// Whole frames to out[0 .. max_bytes); returns their bytes.
  std::size_t pop(std::uint8_t* out, std::size_t max_bytes) {
    const std::lock_guard lock(mutex_);
    std::size_t taken = 0;
    while (used_ != 0) {
      const std::size_t size = ring_[begin_];
      if (taken + size > max_bytes) break;
      for (std::size_t i = 0; i < size; ++i) out[taken + i] = ring_[(begin_ + i) % Capacity];
      begin_ = (begin_ + size) % Capacity;
      used_ -= size;
      taken += size;
    }
    return taken;
  }

 private:
  std::mutex mutex_;
  std::array<std::uint8_t, Capacity> ring_{};
  std::size_t begin_ = 0;
  std::size_t used_ = 0;
};
