// The queues' atomics policy for relacy, which tries schedules and what each load may see under the C++ memory model.
// Include it after the headers under test: relacy redefines `new`, `memory_order_relaxed` and others.
#pragma once

#include <cstdint>

#include "relacy/relacy.hpp"
#undef memory_order_relaxed
#undef memory_order_consume
#undef memory_order_acquire
#undef memory_order_release
#undef memory_order_acq_rel
#undef memory_order_seq_cst

/// An atomic that relacy watches, with the interface of std::atomic.
template <class T>
class WatchedAtomic {
 public:
  WatchedAtomic() : WatchedAtomic(T{}) {}
  WatchedAtomic(T value) { atomic_.store(value, rl::mo_relaxed, $); }  // NOLINT: implicit as in std::atomic

  T load(std::memory_order order) const { return atomic_.load(order_of(order), $); }
  void store(T value, std::memory_order order) { atomic_.store(value, order_of(order), $); }
  bool swap(T& seen, T value, std::memory_order order) {
    return atomic_.compare_exchange_strong(seen, value, order_of(order), $, rl::mo_relaxed, $);
  }
  void add(T amount) { atomic_.fetch_add(amount, rl::mo_relaxed, $); }

 private:
  static rl::memory_order order_of(std::memory_order order) {
    switch (order) {
      case std::memory_order_relaxed: return rl::mo_relaxed;
      case std::memory_order_acquire: return rl::mo_acquire;
      case std::memory_order_release: return rl::mo_release;
      default: return rl::mo_seq_cst;
    }
  }
  rl::atomic<T> atomic_;
};

/// Words as on the MCU.
struct WatchedAtomics {
  using Position = std::uint16_t;
  using Word = std::uint32_t;
  template <class T>
  using Atomic = WatchedAtomic<T>;

  template <class T, class Change>
  static bool update(Atomic<T>& atomic, std::memory_order order, Change&& change) {
    T seen = atomic.load(std::memory_order_relaxed);
    for (;;) {
      T value = seen;
      if (!change(value)) return false;
      if (atomic.swap(seen, value, order)) return true;
    }
  }
  template <class T>
  static void add(Atomic<T>& atomic) {
    atomic.add(1);
  }
};
