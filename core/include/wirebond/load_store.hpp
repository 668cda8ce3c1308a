// A variable that one context writes and others read. No read-modify-write: that differs between processors.
#pragma once

#include <atomic>

#include "wirebond/bytes.hpp"

namespace wirebond {

/// `load` and `store` of std::atomic, forced inline: without optimisation each call would otherwise be 60 bytes of code
/// at each place.
template <class T>
class LoadStore {
 public:
  constexpr LoadStore() = default;
  constexpr LoadStore(T value) : value_(value) {}  // NOLINT: implicit as in std::atomic
  WIREBOND_INLINE T load(std::memory_order order) const { return value_.load(order); }
  WIREBOND_INLINE void store(T value, std::memory_order order) { value_.store(value, order); }

 private:
  std::atomic<T> value_{};
};

}  // namespace wirebond
