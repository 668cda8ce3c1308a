// All frames that one end wants to send: the queue, the urgent queue, the slots of `latest` messages, and the account
// of every frame. It chooses the run that DMA sends next; it starts nothing and knows no frame format.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <type_traits>

#include "wirebond/bytes.hpp"
#include "wirebond/mcu/atomics.hpp"
#include "wirebond/mcu/grant.hpp"
#include "wirebond/mcu/latest_slots.hpp"
#include "wirebond/mcu/send_account.hpp"
#include "wirebond/mcu/send_queue.hpp"
#include "wirebond/message_list.hpp"

namespace wirebond {

/// Default number of frames that may wait in a queue of this size: one for each 32 bytes, and at least 4. An entry
/// takes 8 bytes on an MCU.
constexpr std::size_t default_frames(std::size_t queue_bytes) { return queue_bytes < 128 ? 4 : queue_bytes / 32; }

/// Sizes of an outbox. Derive from it and override the ones that differ.
struct OutboxConfig {
  using Atomics = DefaultAtomics;
  static constexpr std::size_t ring_bytes = 512;  ///< a power of two, at least twice the largest frame
  static constexpr std::size_t ring_frames = 16;  ///< a power of two
  static constexpr std::size_t urgent_bytes = 0;  ///< as ring_bytes, for the urgent queue; 0: there is none
  static constexpr std::size_t urgent_frames = 0;
  using Latest = MessageList<>;  ///< messages that have a slot
  static constexpr std::size_t latest_cells =
      4;  ///< cells of a slot, 3 to 6: 2, and one for each sender at the same time
  /// 1: one account for all frames; otherwise the number of messages: one for each, and their sum.
  static constexpr std::size_t accounts = 1;
  /// False: frames leave in the order in which they were reserved, across all senders.
  static constexpr bool passes_unfinished = true;
  /// True: `next` passes the message of each frame to `finish`, even with one account for all.
  static constexpr bool tells_message = false;
};

namespace detail {

template <class Atomics, std::size_t Cells, class Messages>
struct SlotsOf;
template <class Atomics, std::size_t Cells, class... Messages>
struct SlotsOf<Atomics, Cells, MessageList<Messages...>> {
  using type = LatestSlots<Atomics, Cells, Messages::Info::max_frame_bytes...>;
  static constexpr std::array<std::uint8_t, sizeof...(Messages)> accounts{Messages::Info::index...};
};

template <class Atomics, std::size_t Frames>
struct QueueTable {
  std::array<typename SendQueue<Atomics>::Entry, Frames> entries;
};

/// A send queue with its table, which comes first because the queue's constructor takes it.
template <class Atomics, std::size_t Bytes, std::size_t Frames>
class QueueWithTable : private QueueTable<Atomics, Frames>, public SendQueue<Atomics> {
  using Base = SendQueue<Atomics>;
  static_assert(Base::is_capacity(Bytes),
                "bytes of a send queue: a power of two, at most half of the range of a position");
  static_assert(Base::is_capacity(Frames), "frames of a send queue: a power of two, 2 or more");

 public:
  explicit QueueWithTable(std::uint8_t* ring) : Base(ring, Bytes, this->entries.data(), Frames) {}
};

/// No queue: nothing is granted, nothing waits. Takes no memory.
template <class Atomics>
class QueueWithTable<Atomics, 0, 0> {
  using Ticket = typename SendQueue<Atomics>::Ticket;

 public:
  explicit QueueWithTable(std::uint8_t*) {}
  Refusal take(std::size_t, std::uint8_t, std::uint16_t, Ticket&) { return Refusal::full; }
  void commit(const Ticket&, std::size_t) {}
  void abandon(const Ticket&, Refusal) {}
  template <class Finish>
  Run next(std::size_t, bool, Finish&&) {
    return {};
  }
  template <class Visit>
  void end_run(Visit&&) {}
  template <class IsOld, class Visit>
  void expire(IsOld&&, Visit&&) {}
  template <class IsCounted>
  std::size_t finished(IsCounted&&) const {
    return 0;
  }
  template <class IsCounted>
  std::size_t unfinished(IsCounted&&) const {
    return 0;
  }
  std::size_t peak_bytes() const { return 0; }
  std::size_t peak_entries() const { return 0; }
};

}  // namespace detail

/// Senders: any task, interrupt or thread. Consumer: one context, the UART's interrupt or, without one, the context
/// that polls. No call blocks or allocates; costs are those of send_queue.hpp and latest_slots.hpp, and one addition
/// per counter.
///
/// A frame is reserved, written in place and committed:
///     auto grant = outbox.reserve(size, Queue::normal, now);
///     if (!grant.ok()) return grant.refusal();
///     grant.commit(write_frame(grant.data()));
/// After a commit, and after a grant was given back, pend the consumer: its memory may be waited for.
template <class Config = OutboxConfig>
class Outbox {
  using Atomics = typename Config::Atomics;
  using Ring = detail::QueueWithTable<Atomics, Config::ring_bytes, Config::ring_frames>;
  using Urgent = detail::QueueWithTable<Atomics, Config::urgent_bytes, Config::urgent_frames>;
  using Slots = detail::SlotsOf<Atomics, Config::latest_cells, typename Config::Latest>;
  using Latest = typename Slots::type;
  using Ledger = SendLedger<Atomics>;
  static constexpr bool has_accounts = Config::accounts != 1;

 public:
  /// Data of a grant about its frame.
  struct Ticket {
    std::uint8_t* data;
    std::size_t size;
    Queue queue;
    std::uint8_t account;
    union {
      typename SendQueue<Atomics>::Ticket in_queue;
      typename Latest::Ticket in_slot;
    };
  };

  /// Memory that DMA must reach: ring, urgent ring, cells of the slots.
  static constexpr std::size_t memory_bytes = Config::ring_bytes + Config::urgent_bytes + Latest::memory_bytes;
  static constexpr std::size_t slot_count = Latest::slot_count;

  /// `memory`: memory_bytes; owned by the caller, and must outlive the outbox.
  explicit Outbox(std::uint8_t* memory)
      : ring_(memory),
        urgent_(memory + Config::ring_bytes),
        latest_(memory + Config::ring_bytes + Config::urgent_bytes) {}
  Outbox(const Outbox&) = delete;  // grants point to it
  Outbox& operator=(const Outbox&) = delete;

  // ---- senders: any context -----------------------------------------------------------------------------------------

  /// Reserve memory for a frame of at most `size` bytes. `now`: the time, modulo 2^16, in any unit, from which its age
  /// counts. `message`: its account, if each message has one. `Queue::urgent` without an urgent queue is refused as
  /// `full`.
  WIREBOND_QUICK Grant<Outbox> reserve(std::size_t size, Queue queue = Queue::normal, std::uint16_t now = 0,
                                       std::uint8_t message = 0) {
    Ticket ticket;
    const std::uint8_t account = account_of(message);
    const std::uint8_t tag = Config::tells_message ? message : account;
    ledgers_[account].offer();
    const Refusal refusal = queue == Queue::urgent ? urgent_.take(size, tag, now, ticket.in_queue)
                                                   : ring_.take(size, tag, now, ticket.in_queue);
    if (refusal != Refusal::none) return refused(refusal, account);
    ticket.data = ticket.in_queue.data;
    ticket.size = ticket.in_queue.size;
    ticket.queue = queue;
    ticket.account = account;
    return {*this, ticket};
  }

  /// Reserve memory for a frame in a slot: `slot` is the message's index in Config::Latest.
  Grant<Outbox> reserve_latest(std::size_t slot, std::size_t size, std::uint16_t now = 0) {
    Ticket ticket;
    const std::uint8_t account = account_of_slot(slot);
    ledgers_[account].offer();
    const Refusal refusal = latest_.take(slot, size, now, ticket.in_slot);
    if (refusal != Refusal::none) return refused(refusal, account);
    if (ticket.in_slot.replaces) ledgers_[account].replace();
    ticket.data = ticket.in_slot.data;
    ticket.size = ticket.in_slot.size;
    ticket.queue = Queue::latest;
    ticket.account = account;
    return {*this, ticket};
  }

  /// Reserve memory for a frame of this message, in the queue that the file gives.
  template <class Message>
  WIREBOND_QUICK Grant<Outbox> reserve_for(std::size_t size, std::uint16_t now = 0) {
    if constexpr (Message::Info::queue == Queue::latest) {
      constexpr std::size_t slot = Config::Latest::template index_of<Message>();
      static_assert(slot < slot_count, "a message of `queue: latest` needs a slot: name it in the config's Latest");
      return reserve_latest(slot, size, now);
    } else {
      static_assert(Message::Info::queue != Queue::urgent || Config::urgent_bytes != 0,
                    "a message of `queue: urgent` needs the urgent queue: set the config's urgent_bytes and _frames");
      static_assert(Message::Info::max_frame_bytes <= Config::ring_bytes / 2, "ring_bytes: twice the largest frame");
      return reserve(size, Message::Info::queue, now, static_cast<std::uint8_t>(Message::Info::index));
    }
  }

  /// Count a frame that was not even tried: the link is down, or a field is out of range.
  void refuse(Refusal cause, std::uint8_t message = 0) {
    ledgers_[account_of(message)].offer();
    ledgers_[account_of(message)].refuse(cause);
  }

  /// Check whether a frame of this size would leave half of the queue to others. Call it before `reserve` for frames
  /// that may come in floods. A frame that finds the queue empty may always be sent.
  bool leaves_half(std::size_t size) const {
    const std::size_t used = ring_.used_bytes();
    return used == 0 || (used + size <= Config::ring_bytes / 2 && ring_.used_entries() < Config::ring_frames / 2);
  }

  // ---- the consumer: one context ------------------------------------------------------------------------------------

  /// Return the run to send next: urgent frames first, then the queue and the slots by turns. Contiguous whole frames,
  /// at most `max_bytes` unless the first alone is longer; size 0 if nothing is ready. Ended by `sent` or `aborted`;
  /// until then every call returns the same run. `finish(data, size, message)` is called once for each frame, in the
  /// order of the wire, before the run is returned: here a frame gets its sequence number. If it returns a size, that
  /// is the frame's new one. `message`: the one passed to `reserve`, if Config::tells_message or an account for each
  /// message requires it; otherwise 0.
  template <class Finish>
  Run next(std::size_t max_bytes, Finish&& finish) {
    if (run_.size != 0) return run_;
    // By reference: with `finish` itself GCC 12 generates 50 bytes more on a Cortex-M4, even if there is nothing to do.
    const auto finish_each = [&](std::uint8_t* data, std::size_t size, std::uint8_t message) {
      return finish(data, size, message);
    };
    source_ = from_urgent;
    run_ = urgent_.next(max_bytes, Config::passes_unfinished, finish_each);
    if (run_.size == 0 && slots_turn_) take_from_slots(finish);
    if (run_.size == 0) {
      source_ = from_ring;
      run_ = ring_.next(max_bytes, Config::passes_unfinished, finish_each);
      slots_turn_ = run_.size != 0;
    }
    if (run_.size == 0) take_from_slots(finish);
    return run_;
  }
  Run next(std::size_t max_bytes) {
    return next(max_bytes, [](std::uint8_t*, std::size_t, std::uint8_t) {});
  }

  /// End the run: it has left.
  void sent() { end_run(true); }

  /// End the run: it was stopped early.
  void aborted() { end_run(false); }

  /// Expire all finished frames, except a run that is being sent: the link is down.
  void expire_all() {
    expire([](std::uint16_t) { return true; });
  }

  /// Expire finished frames that were reserved more than `max_age` before `now`, except a run that is being sent. Units
  /// are those of `reserve`, and must wrap where the clock does. The last `ahead` ages mean stamps that are ahead of
  /// `now`, because a sender's clock is: call it before a frame is that old. SendAge ensures that.
  static constexpr std::uint16_t ahead = 1'024;
  void expire_older(std::uint16_t now, std::uint16_t max_age) {
    expire([=](std::uint16_t stamp) {
      const auto age = static_cast<std::uint16_t>(now - stamp);
      return age > max_age && age < 0x10000 - ahead;
    });
  }

  // ---- the account: any context -------------------------------------------------------------------------------------

  /// Return the account of all frames.
  SendAccount account() const {
    SendAccount sum;
    for (std::size_t i = 0; i < Config::accounts; ++i) add(sum, account_at(static_cast<std::uint8_t>(i)));
    return sum;
  }

  /// Return the account of one message's frames; only with an account for each.
  SendAccount account(std::uint8_t message) const {
    static_assert(has_accounts, "set the config's `accounts` to the number of messages");
    return account_at(message);
  }

  /// Bytes of the ring in use now, and their maximum so far.
  std::size_t used_bytes() const { return ring_.used_bytes(); }
  std::size_t peak_bytes() const { return ring_.peak_bytes(); }
  std::size_t peak_frames() const { return ring_.peak_entries(); }
  std::size_t peak_urgent_bytes() const { return urgent_.peak_bytes(); }
  std::size_t peak_urgent_frames() const { return urgent_.peak_entries(); }

  // ---- for Grant ----------------------------------------------------------------------------------------------------

  WIREBOND_QUICK void commit(const Ticket& ticket, std::size_t used) {
    Ledger& ledger = ledgers_[ticket.account];
    ledger.accept();  // before the consumer can see the frame, so that it is not sent before it was accepted
    if constexpr (slot_count != 0) {
      if (ticket.queue == Queue::latest) {
        if (latest_.commit(ticket.in_slot, used)) ledger.replace();
        return;
      }
    }
    if (ticket.queue == Queue::urgent) {
      urgent_.commit(ticket.in_queue, used);
    } else {
      ring_.commit(ticket.in_queue, used);
    }
  }

  void abandon(const Ticket& ticket, Refusal why) {
    ledgers_[ticket.account].refuse(why);
    if constexpr (slot_count != 0) {
      if (ticket.queue == Queue::latest) return latest_.abandon(ticket.in_slot);
    }
    if (ticket.queue == Queue::urgent) {
      urgent_.abandon(ticket.in_queue, why);
    } else {
      ring_.abandon(ticket.in_queue, why);
    }
  }

 private:
  enum Source : std::uint8_t { from_ring, from_urgent, from_slot };

  static constexpr std::uint8_t account_of(std::uint8_t message) { return has_accounts ? message : std::uint8_t{0}; }
  static constexpr std::uint8_t account_of_slot(std::size_t slot) {
    if constexpr (has_accounts && slot_count != 0) return Slots::accounts[slot];
    return 0;
  }

  static constexpr std::uint8_t message_of_slot(std::size_t slot) {
    if constexpr ((has_accounts || Config::tells_message) && slot_count != 0) return Slots::accounts[slot];
    return 0;
  }

  Grant<Outbox> refused(Refusal refusal, std::uint8_t account) {
    ledgers_[account].refuse(refusal);
    return Grant<Outbox>(refusal);
  }

  /// Take one frame from the next slot that has one; the slots take turns.
  template <class Finish>
  void take_from_slots(Finish&& finish) {
    for (std::size_t tried = 0; tried < slot_count; ++tried) {
      slot_ = static_cast<std::uint8_t>(slot_ + 1u < slot_count ? slot_ + 1u : 0u);
      run_ = latest_.next(slot_);
      if (run_.size == 0) continue;
      if constexpr (std::is_void_v<decltype(finish(run_.data, run_.size, std::uint8_t{0}))>) {
        finish(run_.data, run_.size, message_of_slot(slot_));
      } else {
        run_.size = finish(run_.data, run_.size, message_of_slot(slot_));
      }
      source_ = from_slot;
      slots_turn_ = false;
      return;
    }
  }

  WIREBOND_NOINLINE void end_run(bool has_left) {
    if (run_.size == 0) return;
    run_ = {};
    const auto book_tagged = [&](std::uint8_t tag) {
      Ledger& ledger = ledgers_[account_of(tag)];
      has_left ? ledger.send() : ledger.abort();
    };
    if (slot_count != 0 && source_ == from_slot) {
      latest_.end_run(slot_);
      book_tagged(account_of_slot(slot_));
    } else if (source_ == from_urgent) {
      urgent_.end_run(book_tagged);
    } else {
      ring_.end_run(book_tagged);
    }
  }

  template <class IsOld>
  void expire(IsOld&& is_old) {
    const auto book = [&](std::uint8_t tag) { ledgers_[account_of(tag)].expire(); };
    urgent_.expire(is_old, book);
    ring_.expire(is_old, book);
    for (std::size_t slot = 0; slot < slot_count; ++slot) {
      if (latest_.expire(slot, is_old)) book(account_of_slot(slot));
    }
  }

  SendAccount account_at(std::uint8_t account) const {
    SendAccount read = ledgers_[account].read();
    const auto is_counted = [=](std::uint8_t tag) { return account_of(tag) == account; };
    std::size_t queued = urgent_.finished(is_counted) + ring_.finished(is_counted);
    std::size_t unfinished = urgent_.unfinished(is_counted) + ring_.unfinished(is_counted);
    for (std::size_t slot = 0; slot < slot_count; ++slot) {
      if (account_of_slot(slot) != account) continue;
      queued += latest_.finished(slot);
      unfinished += latest_.unfinished(slot);
    }
    read.queued = static_cast<std::uint32_t>(queued);
    read.unfinished = static_cast<std::uint32_t>(unfinished);
    return read;
  }

  static void add(SendAccount& sum, const SendAccount& account) {
    sum.offered += account.offered;
    sum.accepted += account.accepted;
    for (std::size_t i = 0; i < refusal_count; ++i) sum.refused_by[i] += account.refused_by[i];
    sum.sent += account.sent;
    sum.replaced += account.replaced;
    sum.expired += account.expired;
    sum.aborted += account.aborted;
    sum.queued += account.queued;
    sum.unfinished += account.unfinished;
  }

  Ring ring_;
  Urgent urgent_;
  Latest latest_;
  std::array<Ledger, Config::accounts> ledgers_;
  // The consumer's own:
  Run run_;
  Source source_ = from_ring;
  std::uint8_t slot_ = 0;    // the last one that was asked
  bool slots_turn_ = false;  // the last run came from the queue
};

}  // namespace wirebond
