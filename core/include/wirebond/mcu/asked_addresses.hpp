// Whose replies a host's link takes: the addresses that its requests went to. No queue, no time.
#pragma once

#include <array>
#include <atomic>
#include <cstddef>
#include <cstdint>
#include <type_traits>

#include "wirebond/address.hpp"
#include "wirebond/examine.hpp"
#include "wirebond/header.hpp"
#include "wirebond/placed_number.hpp"

namespace wirebond {

/// For a `Receiver` of the MCUs' frames, where these say whose they are. Once a request has gone to an address, its
/// reply is taken from addresses that were asked for it, and from no other. After a request to the broadcast address
/// each reply is taken. Without a request nothing is compared.
///
/// It remembers pairs of a reply and an address: the last `remembered / 2` at least. `asks` may be called in any
/// context, several at once; the other functions in the one that feeds the receiver. A call looks at each pair. No
/// lock.
template <class Source, class Atomics>
class AskedAddresses {
 public:
  using Address = typename Source::Address;
  static constexpr std::size_t remembered = 32;

  /// A request to `address` is about to leave; message `reply` answers it.
  void asks(std::int16_t reply, Address address) {
    const std::uint32_t next = next_.load(std::memory_order_relaxed);
    for (std::uint32_t age = 1; age <= remembered / 2; ++age) {  // an older one may soon be forgotten: it comes again
      if (pairs_[(next - age) % remembered].has(reply, address)) return;
    }
    std::uint32_t ticket = 0;
    Atomics::update(next_, std::memory_order_relaxed, [&](std::uint32_t& value) {
      ticket = value++;
      return true;
    });
    pairs_[ticket % remembered].set(reply, address);
  }

  /// From here on each reply is taken, for a gateway or a monitor.
  void listen_to_all() { hears_all_ = true; }

 protected:
  /// False for the reply of one that was not asked, which is counted.
  bool is_from_asked(const Frame& frame) {
    bool is_from_another = false;  // a form without the address concerns everybody
    detail::each_header_field<Source>(frame, [&](const HeaderField& field) WIREBOND_INLINE_LAMBDA {
      if (field.place != Source::sender_place) return;
      const std::uint64_t from = detail::read_wide(field.number, frame.bytes, frame.size);
      is_from_another = !was_asked(frame.message, static_cast<Address>(from));
    });
    if (is_from_another) from_others_ += 1;
    return !is_from_another;
  }
  std::uint32_t from_others() const { return from_others_; }

 private:
  /// Readers see a pair that was set, or none: `reply` is taken away before the address changes, and read on both sides
  /// of it.
  class Pair {
   public:
    bool has(std::int16_t reply, Address address) const { return of(reply) && holds(address) && is_still(reply); }
    bool of(std::int16_t reply) const { return reply_.load(std::memory_order_acquire) == reply; }  // with `set`'s end

    void set(std::int16_t reply, Address address) {
      reply_.store(-1, std::memory_order_relaxed);
      std::atomic_thread_fence(std::memory_order_release);  // with `is_still`
      for (std::size_t i = 0; i < words; ++i) address_[i].store(word(address, i), std::memory_order_relaxed);
      reply_.store(reply, std::memory_order_release);  // with `of`
    }

   private:
    // Of more than one word, because a small processor changes no 64 bits at once.
    static constexpr std::size_t words = (sizeof(Address) + 3) / 4;
    static constexpr std::uint32_t word(Address address, std::size_t i) {
      return static_cast<std::uint32_t>(std::uint64_t{address} >> (32 * i));
    }

    bool holds(Address address) const {
      for (std::size_t i = 0; i < words; ++i) {
        if (address_[i].load(std::memory_order_relaxed) != word(address, i)) return false;
      }
      return true;
    }
    bool is_still(std::int16_t reply) const {
      std::atomic_thread_fence(std::memory_order_acquire);  // with `set`'s fence
      return reply_.load(std::memory_order_relaxed) == reply;
    }

    std::atomic<std::int16_t> reply_{-1};  ///< a message's index; -1: no pair
    std::array<std::atomic<std::uint32_t>, words> address_{};
  };

  bool was_asked(std::int16_t reply, Address address) const {
    if (reply < 0 || hears_all_) return true;
    for (;;) {
      const std::uint32_t next = next_.load(std::memory_order_acquire);
      bool was_asked = false;
      for (const Pair& pair : pairs_) {
        if (!pair.of(reply)) continue;
        if (pair.has(reply, address)) return true;
        for (const Address everybody : Source::asked_broadcasts) {
          if (pair.has(reply, everybody)) return true;
        }
        was_asked = true;
      }
      // A pair that came again while this looked has a new place, and its old one may be gone.
      if (next_.load(std::memory_order_acquire) == next) return !was_asked;
    }
  }

  std::array<Pair, remembered> pairs_{};
  typename Atomics::template Atomic<std::uint32_t> next_{};
  std::uint32_t from_others_ = 0;
  bool hears_all_ = false;
};

}  // namespace wirebond
