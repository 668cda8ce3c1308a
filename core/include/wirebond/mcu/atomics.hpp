// How many contexts change one word of memory, for each kind of processor. No queue, no counter.
#pragma once

#include <atomic>
#include <cstdint>
#include <type_traits>

#include "wirebond/bytes.hpp"
#include "wirebond/load_store.hpp"

namespace wirebond {

// An atomics policy is a type with
//   Position         an unsigned integer; the type of the queues' free-running positions and numbers
//   Word             an unsigned integer of twice that size: a position and a number that change together
//   Atomic<T>        load(order) and store(value, order) as in std::atomic, for T of at most Word's size
//   update(atomic, order, change)
//                    `change(value)` gets the word's value and may alter it. If it returns true, the altered value is
//                    stored with `order`, provided that no other context has stored to the word since it was read;
//                    otherwise `change` is called again with the new value. Returns false if `change` returned false:
//                    nothing was stored then.
//   add(atomic)      increment by one
// Loads and stores are single instructions everywhere; only `update` and `add` differ between processors. Any context:
// an interrupted change is repeated, and each repetition means that another context made progress.

/// Compare-and-swap of std::atomic: for hosts, and processors without one of the policies below.
///
/// Danger: a context that is interrupted between its load and its swap until the word has the same value again swaps
/// although the word has changed (ABA). With 32-bit positions that takes 2^32 frames in between; with 16-bit ones 65536
/// frames whose bytes are a multiple of 65536. Use 16 bits only if no context waits that long.
template <class PositionType>
struct CompareAndSwap {
  using Position = PositionType;
  using Word = std::conditional_t<sizeof(Position) == 2, std::uint32_t, std::uint64_t>;
  template <class T>
  using Atomic = std::atomic<T>;
  static_assert(std::is_unsigned_v<Position> && sizeof(Word) == 2 * sizeof(Position), "16-bit or 32-bit positions");
  static_assert(Atomic<Word>::is_always_lock_free, "an interrupt must never wait for a lock; take smaller positions");

  template <class T, class Change>
  static bool update(Atomic<T>& atomic, std::memory_order order, Change&& change) {
    T seen = atomic.load(std::memory_order_relaxed);
    for (;;) {
      T value = seen;
      if (!change(value)) return false;
      if (atomic.compare_exchange_weak(seen, value, order, std::memory_order_relaxed)) return true;
    }
  }

  template <class T>
  static void add(Atomic<T>& atomic) {
    atomic.fetch_add(1, std::memory_order_relaxed);
  }
};

/// Interrupts masked for the few instructions of each change: for Cortex-M0, M0+ and others without exclusive access.
/// The port provides `Mask`: `static Old lock()` masks interrupts and returns the previous mask,
/// `static void unlock(Old)` restores it. One processor core only.
template <class Mask>
struct MaskedAtomics {
  using Position = std::uint16_t;
  using Word = std::uint32_t;
  template <class T>
  using Atomic = LoadStore<T>;

  template <class T, class Change>
  static bool update(Atomic<T>& atomic, std::memory_order, Change&& change) {
    const Section section;
    T value = atomic.load(std::memory_order_relaxed);
    if (!change(value)) return false;
    atomic.store(value, std::memory_order_relaxed);  // masked code is in order for the only core
    return true;
  }

  template <class T>
  static void add(Atomic<T>& atomic) {
    const Section section;
    atomic.store(atomic.load(std::memory_order_relaxed) + 1, std::memory_order_relaxed);
  }

 private:
  class Section {
   public:
    Section() : old_(Mask::lock()) { std::atomic_signal_fence(std::memory_order_seq_cst); }
    ~Section() {
      std::atomic_signal_fence(std::memory_order_seq_cst);
      Mask::unlock(old_);
    }
    Section(const Section&) = delete;
    Section& operator=(const Section&) = delete;

   private:
    decltype(Mask::lock()) old_;
  };
};

#if defined(__ARM_FEATURE_LDREX) && defined(__ARM_ARCH_PROFILE) && __ARM_ARCH_PROFILE == 'M'
#define WIREBOND_HAS_EXCLUSIVE_ACCESS 1

/// Exclusive loads and stores: Cortex-M3 and later. Entering or leaving an interrupt ends exclusive access, so an
/// interrupted change is always repeated, whatever the word's value is then: no ABA, even with 16-bit positions.
/// `change` may read other words: on these cores loads do not affect the monitor.
struct ExclusiveAccess {
  using Position = std::uint16_t;
  using Word = std::uint32_t;
  template <class T>
  using Atomic = LoadStore<T>;

  template <class T, class Change>
  static bool update(Atomic<T>& atomic, std::memory_order order, Change&& change) {
    static_assert(sizeof(T) == 4 && sizeof(Atomic<T>) == 4, "LDREX and STREX are those of a word");
    T* const address = reinterpret_cast<T*>(&atomic);
    if (order == std::memory_order_release || order == std::memory_order_acq_rel) {
      std::atomic_thread_fence(std::memory_order_release);
    }
    std::uint32_t failed;
    do {
      T value;
      __asm__ volatile("ldrex %0, [%1]" : "=r"(value) : "r"(address) : "memory");
      if (!change(value)) {
        __asm__ volatile("clrex" : : : "memory");
        return false;
      }
      __asm__ volatile("strex %0, %2, [%1]" : "=&r"(failed) : "r"(address), "r"(value) : "memory");
    } while (failed != 0);
    if (order == std::memory_order_acquire || order == std::memory_order_acq_rel) {
      std::atomic_thread_fence(std::memory_order_acquire);
    }
    return true;
  }

  template <class T>
  static void add(Atomic<T>& atomic) {
    update(atomic, std::memory_order_relaxed, [](T& value) {
      ++value;
      return true;
    });
  }
};
#endif

#if defined(__ARM_ARCH_6M__)
#define WIREBOND_HAS_PRIMASK 1

/// The mask of Cortex-M0 and M0+: all interrupts but NMI and faults.
struct Primask {
  static std::uint32_t lock() {
    std::uint32_t old;
    __asm__ volatile("mrs %0, primask\n\tcpsid i" : "=r"(old) : : "memory");
    return old;
  }
  static void unlock(std::uint32_t old) { __asm__ volatile("msr primask, %0" : : "r"(old) : "memory"); }
};
#endif

/// The policy for the processor that is compiled for.
#if defined(WIREBOND_HAS_EXCLUSIVE_ACCESS)
using DefaultAtomics = ExclusiveAccess;
#elif defined(WIREBOND_HAS_PRIMASK)
using DefaultAtomics = MaskedAtomics<Primask>;
#else
using DefaultAtomics =
    CompareAndSwap<std::conditional_t<std::atomic<std::uint64_t>::is_always_lock_free, std::uint32_t, std::uint16_t> >;
#endif

}  // namespace wirebond
