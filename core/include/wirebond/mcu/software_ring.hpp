// The receive ring of a port without DMA, which can make its sender wait: counts free bytes, and copies. No link, no
// register.
#pragma once

#include <atomic>
#include <cstddef>
#include <cstdint>

#include "wirebond/mcu/atomics.hpp"

namespace wirebond {

/// `put` and `start` in one context, the UART's interrupt or its replacement; `read_to` by `poll`; the rest anywhere.
/// Bytes that `poll` has not read are never overwritten.
class SoftwareRing {
 public:
  /// Start with an empty ring. `size` is a power of two.
  void start(std::uint8_t* bytes, std::size_t size) {
    place_.store(0, std::memory_order_relaxed);
    read_.store(0, std::memory_order_relaxed);
    bytes_ = bytes;
    size_ = size;
  }
  void stop() { size_ = 0; }

  bool runs() const { return size_ != 0; }
  std::size_t place() const { return place_.load(std::memory_order_acquire); }  // pairs with `put`

  /// Return how many bytes may be put; one of the ring stays free.
  std::size_t room() const {
    if (size_ == 0) return 0;
    const std::size_t read = read_.load(std::memory_order_acquire);  // pairs with `read_to`
    return (read - place_.load(std::memory_order_relaxed) - 1) & (size_ - 1);
  }

  /// Copy as many of the `size` bytes as fit, and return how many.
  std::size_t put(const std::uint8_t* bytes, std::size_t size) {
    const std::size_t count = size < room() ? size : room();
    std::size_t place = place_.load(std::memory_order_relaxed);  // only this context writes it
    for (std::size_t i = 0; i < count; ++i) {
      bytes_[place] = bytes[i];
      place = (place + 1) & (size_ - 1);
    }
    place_.store(place, std::memory_order_release);  // pairs with `place`
    return count;
  }

  /// Note that all bytes before this place are read.
  void read_to(std::size_t place) { read_.store(place, std::memory_order_release); }  // pairs with `room`

 private:
  std::uint8_t* bytes_ = nullptr;
  std::size_t size_ = 0;
  LoadStore<std::size_t> place_{0};
  LoadStore<std::size_t> read_{0};
};

}  // namespace wirebond
