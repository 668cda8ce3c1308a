// Counts the outcome of every frame offered for sending, and the sums that must hold.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>

#include "wirebond/mcu/atomics.hpp"
#include "wirebond/mcu/grant.hpp"

namespace wirebond {

/// Frames since start-up, modulo 2^32; `unfinished` and `queued` are current. Exact while no sender is inside a call:
///     offered  = accepted + unfinished + all refused
///     accepted = sent + queued + replaced + expired + aborted
struct SendAccount {
  std::uint32_t offered = 0;
  std::uint32_t accepted = 0;
  std::array<std::uint32_t, refusal_count> refused_by{};  ///< by Refusal; the one for `none` stays 0
  std::uint32_t sent = 0;
  std::uint32_t replaced = 0;    ///< by a newer frame of a `latest` message
  std::uint32_t expired = 0;     ///< the link was down, or older than `max_age`
  std::uint32_t aborted = 0;     ///< in a run that was stopped; some of its frames may have arrived
  std::uint32_t queued = 0;      ///< finished and not gone, including a run that is being sent; counted in the queues
  std::uint32_t unfinished = 0;  ///< between reserve and commit; counted in the queues

  constexpr std::uint32_t refused(Refusal cause) const { return refused_by[static_cast<std::size_t>(cause)]; }
  constexpr std::uint32_t refused() const {
    std::uint32_t sum = 0;
    for (const std::uint32_t count : refused_by) sum += count;
    return sum;
  }
  /// Check whether both sums hold.
  constexpr bool balances() const {
    return offered == accepted + unfinished + refused() && accepted == sent + queued + replaced + expired + aborted;
  }
};

/// Counters of one account. Senders count from any context, the consumer from its own.
template <class Atomics>
class SendLedger {
 public:
  void offer() { Atomics::add(offered_); }
  void refuse(Refusal cause) { Atomics::add(refused_[static_cast<std::size_t>(cause) - 1]); }
  void accept() { Atomics::add(accepted_); }
  void replace() { Atomics::add(replaced_); }
  // The consumer's own counters: no other context writes them, so no write can come in between.
  void send() { add_alone(sent_); }
  void expire() { add_alone(expired_); }
  void abort() { add_alone(aborted_); }

  /// Return the counts; `queued` and `unfinished` are not known here. Any context.
  SendAccount read() const {
    SendAccount account;
    // The end of a frame's life before its beginning, so that no frame is seen to leave before it came.
    account.sent = load(sent_);
    account.expired = load(expired_);
    account.aborted = load(aborted_);
    account.replaced = load(replaced_);
    account.accepted = load(accepted_);
    for (std::size_t i = 0; i < refused_.size(); ++i) account.refused_by[i + 1] = load(refused_[i]);
    account.offered = load(offered_);
    return account;
  }

 private:
  using Counter = typename Atomics::template Atomic<std::uint32_t>;

  static std::uint32_t load(const Counter& counter) { return counter.load(std::memory_order_relaxed); }
  static void add_alone(Counter& counter) { counter.store(load(counter) + 1, std::memory_order_relaxed); }

  Counter offered_{};
  Counter accepted_{};
  std::array<Counter, refusal_count - 1> refused_{};
  Counter sent_{};
  Counter replaced_{};
  Counter expired_{};
  Counter aborted_{};
};

}  // namespace wirebond
