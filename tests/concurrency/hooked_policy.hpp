// An atomics policy that calls a hook before each atomic operation, so that a test decides what happens in between.
#pragma once

#include <atomic>
#include <cstdint>

/// One thread; operations are as plain as they look. Words as on the MCU.
struct HookedAtomics {
  using Position = std::uint16_t;
  using Word = std::uint32_t;

  /// Called before each operation; null: nothing is. The hook may run other users of the same queue.
  static inline void (*hook)() = nullptr;
  static void step() {
    if (hook != nullptr) hook();
  }

  template <class T>
  class Atomic {
   public:
    Atomic() = default;
    Atomic(T value) : value_(value) {}  // NOLINT: implicit as in std::atomic
    T load(std::memory_order) const {
      step();
      return value_;
    }
    void store(T value, std::memory_order) {
      step();
      value_ = value;
    }

   private:
    friend struct HookedAtomics;
    T value_{};
  };

  template <class T, class Change>
  static bool update(Atomic<T>& atomic, std::memory_order, Change&& change) {
    for (;;) {
      step();
      const T seen = atomic.value_;
      T value = seen;
      if (!change(value)) return false;
      step();
      if (atomic.value_ != seen) continue;
      atomic.value_ = value;
      return true;
    }
  }

  template <class T>
  static void add(Atomic<T>& atomic) {
    step();
    ++atomic.value_;
  }
};
