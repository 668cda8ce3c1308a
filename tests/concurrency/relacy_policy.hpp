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

/// Where relacy may let another thread go on.
struct Preemption {
  /// False: not before a store, nor before a thread loads what itself stored last. Nothing is left out by that: who
  /// would have come in between still may, behind the store, and a load may see the old value there. This holds as long
  /// as no two stores to one word, nor such a load and another thread's store, are concurrent. That is watched: relacy
  /// calls it a race.
  static inline bool before_stores = true;
};

/// An atomic that relacy watches, with the interface of std::atomic.
template <class T>
class WatchedAtomic {
 public:
  WatchedAtomic() : WatchedAtomic(T{}) {}
  WatchedAtomic(T value) { atomic_.store(value, rl::mo_relaxed, $); }  // NOLINT: implicit as in std::atomic

  T load(std::memory_order order) const {
    if (Preemption::before_stores || stored_by_ != rl::ctx().current_thread()) return atomic_.load(order_of(order), $);
    const rl::preemption_disabler none(rl::ctx());
    static_cast<void>(static_cast<int>(stored_($)));
    return atomic_.load(order_of(order), $);
  }
  void store(T value, std::memory_order order) {
    if (Preemption::before_stores) return atomic_.store(value, order_of(order), $);
    const rl::preemption_disabler none(rl::ctx());
    stored_($) = 1;
    stored_by_ = rl::ctx().current_thread();
    atomic_.store(value, order_of(order), $);
  }
  bool swap(T& seen, T value, std::memory_order order) {
    stored_by_ = nobody;  // what is swapped is everybody's
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

  static constexpr rl::thread_id_t nobody = static_cast<rl::thread_id_t>(-2);  // -1 is relacy's own
  rl::atomic<T> atomic_;
  rl::var<int> stored_;  // written with each store, so that relacy sees two that are concurrent
  rl::thread_id_t stored_by_ = nobody;
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
