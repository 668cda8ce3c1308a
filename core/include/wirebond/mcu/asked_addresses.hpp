// Decides whose replies a host's link accepts: those from addresses that its requests went to. No queue, no time.
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

/// For a `Receiver` of frames that name their MCU. Once a request has gone to an address, its reply is accepted from
/// addresses that were asked for it, and from no other. After a request to the broadcast address every reply is
/// accepted. Without a request nothing is compared.
///
/// Remembers pairs of a reply and an address: at least the last `remembered / 2`. `asks` may be called in any context,
/// several at once; the other functions in the context that feeds the receiver. Each call reads every pair. No lock.
template <class Source, class Atomics>
class AskedAddresses {
 public:
  using Address = typename Source::Address;
  static constexpr std::size_t remembered = 32;

  /// Note that a request to `address` is about to leave; message `reply` answers it.
  void asks(std::int16_t reply, Address address) {
    const std::uint32_t next = next_.load(std::memory_order_relaxed);
    for (std::uint32_t age = 1; age <= remembered / 2; ++age) {  // an older pair may soon be forgotten: renew it
      if (pairs_[(next - age) % remembered].has(reply, address)) return;
    }
    std::uint32_t ticket = 0;
    Atomics::update(next_, std::memory_order_relaxed, [&](std::uint32_t& value) {
      ticket = value++;
      return true;
    });
    pairs_[ticket % remembered].set(reply, address);
  }

  /// Accept every reply from now on, for a gateway or a monitor.
  void listen_to_all() { hears_all_ = true; }

 protected:
  /// Returns false for a reply from an address that was not asked, and counts it.
  bool is_from_asked(const Frame& frame) {
    bool is_from_another = false;  // a form without the address concerns everyone
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
  /// Readers see either a complete pair or none: `reply` is removed before the address changes, and read before and
  /// after it.
  class Pair {
   public:
    bool has(std::int16_t reply, Address address) const { return of(reply) && holds(address) && is_still(reply); }
    bool of(std::int16_t reply) const { return reply_.load(std::memory_order_acquire) == reply; }  // pairs with `set`

    void set(std::int16_t reply, Address address) {
      reply_.store(-1, std::memory_order_relaxed);
      std::atomic_thread_fence(std::memory_order_release);  // pairs with `is_still`
      for (std::size_t i = 0; i < words; ++i) address_[i].store(word(address, i), std::memory_order_relaxed);
      reply_.store(reply, std::memory_order_release);  // pairs with `of`
    }

   private:
    // Several words, because a small processor cannot change 64 bits at once.
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
      std::atomic_thread_fence(std::memory_order_acquire);  // pairs with the fence in `set`
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
      // A pair that was stored again during this search has a new place, and its old one may be gone.
      if (next_.load(std::memory_order_acquire) == next) return !was_asked;
    }
  }

  std::array<Pair, remembered> pairs_{};
  typename Atomics::template Atomic<std::uint32_t> next_{};
  std::uint32_t from_others_ = 0;
  bool hears_all_ = false;
};

}  // namespace wirebond
