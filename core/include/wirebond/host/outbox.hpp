// All that a host wants to send, and the order in which it leaves: queue, repeated values, safe values, the stop.
#pragma once

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <cstring>

#include "wirebond/host/frame_numbers.hpp"
#include "wirebond/host/frame_queue.hpp"
#include "wirebond/host/lease.hpp"
#include "wirebond/host/pacing.hpp"

namespace wirebond {

/// What became of a call that wants to send.
enum class [[nodiscard]] SendResult : std::uint8_t{
    accepted,
    down,     ///< the port is away, or the link is closed
    full,     ///< no room in the queue
    stopped,  ///< an emergency stop holds this message
};

/// Frames since the start. Exact after every call:
///     offered  = accepted + refused_down + refused_full + refused_stopped
///     accepted = sent + queued + replaced + expired + overruled + aborted
struct HostSendAccount {
  std::uint64_t offered = 0;
  std::uint64_t accepted = 0;
  std::uint64_t refused_down = 0;
  std::uint64_t refused_full = 0;
  std::uint64_t refused_stopped = 0;
  std::uint64_t sent = 0;
  std::uint64_t sent_bytes = 0;
  std::uint64_t queued = 0;     ///< now: waiting, or under way
  std::uint64_t replaced = 0;   ///< a repeated value, a stop, or one that `keeps_latest`: by the next of its message
  std::uint64_t expired = 0;    ///< the port went away, or it waited longer than `max_age`
  std::uint64_t overruled = 0;  ///< waited when a stop, a safe value or the end of repeating took its message over
  std::uint64_t aborted = 0;    ///< the port went away in its middle

  constexpr bool balances() const {
    return offered == accepted + refused_down + refused_full + refused_stopped &&
           accepted == sent + queued + replaced + expired + overruled + aborted;
  }
};

/// The bytes to hand over next: of one frame, or of several that ask for no reply. `size` 0: none now.
struct Outgoing {
  const std::uint8_t* bytes = nullptr;
  std::size_t size = 0;
  std::int16_t reply = -1;    ///< where a frame begins with these bytes: index of the message that answers it
  std::uint64_t address = 0;  ///< for whom that frame is, where frames say that
};

/// Order: the frame under way to its end; then safe values, in the file's order; then the queue, in which each
/// repeated value has one place. A safe value that has left goes behind the others: where stops fall due faster than
/// the line carries them, each message still gets its turn.
///
/// A stop drops all that waits of its messages, and the end of a lease with a safe value all that waits of its message
/// for its address. Neither is ever refused. Two values of one message that go to different addresses are two leases.
///
/// Where frames have a sequence number they get it here, as they are handed over: so the numbers rise in the order of
/// the wire, and what was refused, replaced, overruled or has expired leaves no gap. A frame whose sender gave the
/// number itself keeps it, and the count goes on as if it had not been. Time is in microseconds and does not wrap. One
/// thread at a time.
class HostOutbox {
 public:
  /// The caller's, and outlives this object. `leases` has one entry for each message of the protocol, by index, and
  /// behind these any number for further addresses. `safe_values` has room for `safe_capacity`; the first `safe_count`
  /// are those of the file. `leaving` holds the largest frame, and `together` what `to_write` gives at once.
  struct Memory {
    std::uint8_t* bytes = nullptr;
    std::size_t byte_capacity = 0;
    QueuedFrame* frames = nullptr;
    std::size_t frame_capacity = 0;
    Lease* leases = nullptr;
    std::size_t lease_count = 0;
    std::size_t message_count = 0;
    SafeValue* safe_values = nullptr;
    std::size_t safe_count = 0;
    std::size_t safe_capacity = 0;
    std::uint8_t* leaving = nullptr;
    std::size_t leaving_capacity = 0;
    std::uint8_t* together = nullptr;  ///< null: frames leave one by one
    std::size_t together_capacity = 0;
    FrameNumbers* numbers = nullptr;  ///< null: frames have no sequence number
    /// Counts what left, one for each of `message_count`; null: not counted.
    std::uint64_t* sent_by_message = nullptr;
  };

  /// `max_age_us`: a frame that waited longer expires; 0: never.
  HostOutbox(const Memory& memory, const Pacing& pacing, std::uint64_t max_age_us)
      : queue_(memory.bytes, memory.byte_capacity, memory.frames, memory.frame_capacity),
        memory_(memory),
        pacing_(pacing),
        max_age_us_(max_age_us),
        safe_count_(memory.safe_count) {}
  HostOutbox(const HostOutbox&) = delete;
  HostOutbox& operator=(const HostOutbox&) = delete;

  // ---- what programs want

  /// One frame of `message`, whole, for `address` where frames have one. `takes_number`: it gets a sequence number as
  /// it leaves, where its format has one. O(size). Where its lease `keeps_latest` and repeats nothing, it takes the
  /// place of one that waits, and that one is replaced.
  SendResult send(std::int16_t message, const std::uint8_t* frame, std::size_t size, std::int16_t reply,
                  bool takes_number, std::uint64_t now_us, std::uint64_t address = 0) {
    account_.offered += 1;
    if (is_stopped(message)) return refuse(account_.refused_stopped, SendResult::stopped);
    if (!is_up_ || is_closed_) return refuse(account_.refused_down, SendResult::down);
    expire(now_us);
    if (keeps_latest(message)) {
      Lease* const found = lease_for(message, address);
      if (found != nullptr && found->can_hold(size) && !found->is_alive()) {
        found->hold(frame, size, reply, takes_number, now_us);
        return accept_value(*found, now_us) ? SendResult::accepted : SendResult::full;
      }
    }
    // One place is kept for the repeated value of each message: these are never refused.
    if (size == 0 || size > memory_.leaving_capacity || !queue_.has_room(size, memory_.lease_count) ||
        !queue_.push({static_cast<std::uint32_t>(size), message, reply, now_us, takes_number, address, 0}, frame)) {
      return refuse(account_.refused_full, SendResult::full);
    }
    account_.accepted += 1;
    return SendResult::accepted;
  }

  /// Repeat this value at the message's rhythm until `hold_us` from now. `full`: the message has no rhythm, the frame
  /// is larger than its memory, or there is no lease left for one more address.
  SendResult repeat(std::int16_t message, const std::uint8_t* frame, std::size_t size, std::int16_t reply,
                    bool takes_number, std::uint64_t hold_us, std::uint64_t now_us, std::uint64_t address = 0) {
    if (is_stopped(message)) return SendResult::stopped;
    if (is_closed_) return SendResult::down;
    Lease* const found = lease_for(message, address);
    if (found == nullptr || !found->can_repeat(size)) return SendResult::full;
    Lease& lease = *found;
    lease.renew(frame, size, reply, takes_number, now_us + hold_us, now_us);
    poll(now_us);
    return SendResult::accepted;
  }

  /// No more of it to any address, without a last value; what waits is dropped.
  void stop_repeating(std::int16_t message) {
    each_lease(message, [this](Lease& lease) { end_silently(lease); });
  }
  /// The same for one address.
  void stop_repeating(std::int16_t message, std::uint64_t address) {
    each_lease(message, [&](Lease& lease) {
      if (lease.address() == address) end_silently(lease);
    });
  }

  /// Has the message a safe value for this address?
  bool has_safe(std::int16_t message, std::uint64_t address) const { return safe_of(message, address) != nullptr; }
  /// One more message for the stop, or to end leases: see SafeValue. False: there is no room, or one of the file has
  /// this address already.
  bool add_safe(const SafeValue& safe) {
    if (safe_count_ == memory_.safe_capacity || has_safe(safe.message(), safe.address())) return false;
    memory_.safe_values[safe_count_++] = safe;
    return true;
  }

  /// End the message's lease for this address, drop all that waits of it for that address, and send its safe value
  /// before all else. Also while the port is down: then it is the first to leave. False: it has none, or the link is
  /// closed.
  bool end_safely(std::int16_t message, std::uint64_t address) {
    SafeValue* const safe = is_closed_ ? nullptr : safe_of(message, address);
    if (safe == nullptr) return false;
    each_lease(message, [&](Lease& lease) {
      if (lease.address() == address) lease.end();
    });
    send_safe(*safe);
    return true;
  }

  /// Drop all that waits of the stop's messages, end their leases, send the stop before all else, and again until
  /// `release_stop`. Also while the port is down: then it is the first to leave.
  void stop(std::uint64_t now_us) {
    is_latched_ = true;
    if (waiting_safe() == nullptr) first_safe_ = 0;
    for (std::size_t i = 0; i < safe_count_; ++i) {
      SafeValue& safe = memory_.safe_values[i];
      drop([&](const QueuedFrame& frame) { return frame.message == safe.message(); });
      each_lease(safe.message(), [](Lease& lease) { lease.end(); });
      if (!safe.is_in_stop()) continue;
      offer_safe(safe);
      safe.begin_repeating(now_us);
    }
  }

  /// The messages may be sent again. Sends nothing; a stop that has not left yet still leaves.
  void release_stop() { is_latched_ = false; }

  bool is_stopped() const { return is_latched_; }
  bool is_stopped(std::int16_t message) const {
    for (std::size_t i = 0; is_latched_ && i < safe_count_; ++i) {
      if (memory_.safe_values[i].message() == message) return true;
    }
    return false;
  }

  /// Nothing more is taken. Every lease ends, with its safe value where it has one.
  void close() {
    is_closed_ = true;
    for (std::size_t i = 0; i < memory_.lease_count; ++i) {
      if (memory_.leases[i].is_alive()) end_lease(memory_.leases[i]);
    }
  }

  /// What still waits will never leave: it expires.
  void end() {
    port_down();
    for (std::size_t i = 0; i < safe_count_; ++i) {
      account_.expired += memory_.safe_values[i].waits ? 1 : 0;
      memory_.safe_values[i].waits = false;
    }
  }

  // ---- time and port

  /// Leases end, values fall due, old frames expire.
  void poll(std::uint64_t now_us) {
    expire(now_us);
    for (std::size_t i = 0; i < memory_.lease_count; ++i) {
      Lease& lease = memory_.leases[i];
      if (lease.is_over(now_us)) {
        end_lease(lease);
      } else if (lease.is_due(now_us)) {
        offer_value(i, now_us);
      }
    }
    if (!is_latched_ || !is_up_ || is_closed_) return;
    for (std::size_t i = 0; i < safe_count_; ++i) {
      SafeValue& safe = memory_.safe_values[i];
      if (safe.is_in_stop() && safe.is_due(now_us)) offer_safe(safe);
    }
  }

  /// When to call `poll`, or `to_write`, next; `never` if nothing is to be done. While the port takes nothing
  /// (`is_blocked`) it is the port that says when to write.
  std::uint64_t next_due(std::uint64_t now_us) const {
    std::uint64_t due = never;
    const auto by = [&](std::uint64_t when) { due = std::min(due, std::max(when, now_us)); };
    for (std::size_t i = 0; i < memory_.lease_count; ++i) {
      if (memory_.leases[i].is_alive()) by(memory_.leases[i].next_us());
    }
    if (!is_up_) return due;
    for (std::size_t i = 0; is_latched_ && !is_closed_ && i < safe_count_; ++i) {
      if (memory_.safe_values[i].is_in_stop()) by(memory_.safe_values[i].next_us());
    }
    if (max_age_us_ != 0 && !queue_.is_empty() && front_since_us() != never) by(front_since_us() + max_age_us_ + 1);
    if (is_blocked_) return due;
    if (written_ != 0) {
      by(now_us);
    } else if (const std::size_t size = next_size(); size != 0) {
      by(pacing_.begins_at_us(size, now_us));
    }
    return due;
  }

  static constexpr std::uint64_t never = ~std::uint64_t{0};

  void port_up(std::uint64_t now_us) {
    is_up_ = true;
    is_blocked_ = false;
    pacing_.forget();
    if (!is_latched_) return;
    for (std::size_t i = 0; i < safe_count_; ++i) {
      SafeValue& safe = memory_.safe_values[i];
      if (!safe.is_in_stop()) continue;
      if (!safe.waits) offer_safe(safe);
      safe.begin_repeating(now_us);
    }
  }

  /// What waits expires, but for safe values: those are the first to leave when the port is back.
  void port_down() {
    is_up_ = false;
    is_blocked_ = false;
    if (written_ != 0) {
      account_.aborted += 1;
      if (safe_under_way_ != nullptr && !safe_under_way_->waits) offer_safe(*safe_under_way_);
      end_of_frame();
    }
    account_.expired += queue_.drop([](const QueuedFrame&) { return true; });
    for (std::size_t i = 0; i < memory_.lease_count; ++i) memory_.leases[i].waits = false;
  }

  // ---- writing

  /// What to hand to the port now. Call `written` before anything else. `together`: frames that may leave now, and that
  /// nothing else is to be known of, are given at once; else one by one.
  Outgoing to_write(std::uint64_t now_us, bool together = false) {
    if (!is_up_) return {};
    if (written_ != 0) return {leaving_ + written_, leaving_size_ - written_, -1, 0};
    expire(now_us);
    leaving_size_ = next_size();
    if (leaving_size_ == 0 || !pacing_.may_begin(leaving_size_, now_us)) return {};
    if (const std::size_t size = together ? several(now_us) : 0; size > leaving_size_) {
      queue_.copy_front(memory_.together, size);
      leaving_ = memory_.together;
      leaving_message_ = queue_.front().message;
      takes_number_ = false;
      return {leaving_, size, -1, 0};
    }
    leaving_ = memory_.leaving;
    return copy_next();
  }

  /// The port took `size` bytes of what `to_write` gave. 0: it takes nothing until it says so.
  void written(std::size_t size, std::uint64_t now_us) {
    is_blocked_ = size == 0;
    if (size == 0) return;
    pacing_.written(size, now_us);
    account_.sent_bytes += size;
    for (;;) {
      if (written_ == 0) take_next();
      const std::size_t of_frame = std::min(size, leaving_size_ - written_);
      written_ += of_frame;
      size -= of_frame;
      if (written_ < leaving_size_) return;
      account_.sent += 1;
      if (memory_.sent_by_message != nullptr && leaving_message_ >= 0) memory_.sent_by_message[leaving_message_] += 1;
      leaving_ += leaving_size_;
      end_of_frame();
      if (size == 0) return;
      leaving_size_ = queue_.front().size;  // it was given with the frame before it
      leaving_message_ = queue_.front().message;
    }
  }

  /// The port took nothing, and says when it will.
  bool is_blocked() const { return is_blocked_; }

  /// Bytes that the driver holds, where it can tell.
  void driver_holds(std::size_t size, std::uint64_t now_us) { pacing_.driver_holds(size, now_us); }

  /// Nothing waits and nothing is under way.
  bool is_empty() const { return written_ == 0 && next_size() == 0; }

  HostSendAccount account() const {
    HostSendAccount account = account_;
    account.queued = queue_.size() + (written_ != 0 ? 1 : 0);
    for (std::size_t i = 0; i < safe_count_; ++i) account.queued += memory_.safe_values[i].waits ? 1 : 0;
    return account;
  }

 private:
  static SendResult refuse(std::uint64_t& counter, SendResult why) {
    counter += 1;
    return why;
  }

  bool keeps_latest(std::int16_t message) const {
    const auto index = static_cast<std::size_t>(message);  // of no message: beyond all
    return index < memory_.message_count && memory_.leases[index].keeps_latest();
  }

  /// The lease of this value, or an idle one; null: none is left.
  Lease* lease_for(std::int16_t message, std::uint64_t address) {
    Lease* idle = nullptr;
    for (std::size_t i = 0; i < memory_.lease_count; ++i) {
      Lease& lease = memory_.leases[i];
      if (lease.is_of(message, address)) return &lease;
      // Those of the messages are kept for them.
      const bool is_free = lease.is_idle() && (i >= memory_.message_count || i == static_cast<std::size_t>(message));
      if (is_free && idle == nullptr) idle = &lease;
    }
    if (idle != nullptr) {
      idle->assign(message, address, memory_.leases[static_cast<std::size_t>(message)].every_us());
    }
    return idle;
  }

  template <class Fn>
  void each_lease(std::int16_t message, Fn&& fn) {
    for (std::size_t i = 0; i < memory_.lease_count; ++i) {
      Lease& lease = memory_.leases[i];
      if (!lease.is_idle() && lease.message() == message) fn(lease);
    }
  }

  SafeValue* safe_of(std::int16_t message, std::uint64_t address) const {
    for (std::size_t i = 0; i < safe_count_; ++i) {
      SafeValue& safe = memory_.safe_values[i];
      if (safe.message() == message && safe.address() == address) return &safe;
    }
    return nullptr;
  }

  SafeValue* waiting_safe() const {
    for (std::size_t i = 0; i < safe_count_; ++i) {
      SafeValue& safe = memory_.safe_values[(first_safe_ + i) % safe_count_];
      if (safe.waits) return &safe;
    }
    return nullptr;
  }

  /// What waits and matches is overruled.
  template <class Matches>
  void drop(Matches&& matches) {
    account_.overruled += queue_.drop([&](const QueuedFrame& frame) {
      if (!matches(frame)) return false;
      if (frame.is_value()) memory_.leases[frame.lease].waits = false;
      return true;
    });
  }

  void end_silently(Lease& lease) {
    lease.end();
    if (!lease.waits) return;
    drop([&](const QueuedFrame& frame) { return frame.is_value() && &memory_.leases[frame.lease] == &lease; });
  }

  void offer_safe(SafeValue& safe) {
    account_.offered += 1;
    account_.accepted += 1;
    if (safe.waits) account_.replaced += 1;
    safe.waits = true;
  }

  void end_lease(Lease& lease) {
    SafeValue* const safe = safe_of(lease.message(), lease.address());
    if (safe == nullptr) return end_silently(lease);
    lease.end();
    send_safe(*safe);
  }

  /// In the place of all that waits of its message for its address.
  void send_safe(SafeValue& safe) {
    drop([&](const QueuedFrame& frame) { return frame.message == safe.message() && frame.address == safe.address(); });
    offer_safe(safe);
  }

  void offer_value(std::size_t index, std::uint64_t now_us) {
    account_.offered += 1;
    if (!is_up_) {
      account_.refused_down += 1;
      return;
    }
    static_cast<void>(accept_value(memory_.leases[index], now_us));
  }

  /// False: there is no place for it, which is counted.
  bool accept_value(Lease& lease, std::uint64_t now_us) {
    if (lease.waits) {  // it leaves with the newest bytes, in the place that it has
      account_.accepted += 1;
      account_.replaced += 1;
      return true;
    }
    const auto place = static_cast<std::uint32_t>(&lease - memory_.leases);
    lease.waits = queue_.push({0, lease.message(), -1, now_us, false, lease.address(), place}, nullptr);
    (lease.waits ? account_.accepted : account_.refused_full) += 1;  // more places may be taken than `send` leaves
    return lease.waits;
  }

  /// When the first in the queue was accepted; `never`: it is repeated, and does not grow old.
  std::uint64_t front_since_us() const {
    const QueuedFrame& front = queue_.front();
    if (!front.is_value()) return front.accepted_us;
    const Lease& lease = memory_.leases[front.lease];
    return lease.is_alive() ? never : lease.held_since_us();
  }

  void expire(std::uint64_t now_us) {
    if (max_age_us_ == 0) return;
    while (!queue_.is_empty()) {
      const std::uint64_t since_us = front_since_us();
      if (since_us == never || now_us - since_us <= max_age_us_) return;
      if (queue_.front().is_value()) memory_.leases[queue_.front().lease].waits = false;
      queue_.pop();
      account_.expired += 1;
    }
  }

  std::size_t next_size() const {
    if (const SafeValue* const safe = waiting_safe()) return safe->size();
    if (queue_.is_empty()) return 0;
    const QueuedFrame& frame = queue_.front();
    return frame.is_value() ? memory_.leases[frame.lease].size() : frame.size;
  }

  /// How many bytes the first frames of the queue have that may leave at once; 0: the next one leaves alone.
  std::size_t several(std::uint64_t now_us) const {
    if (memory_.numbers != nullptr || waiting_safe() != nullptr) return 0;
    std::size_t size = 0;
    for (std::size_t i = 0; i < queue_.size(); ++i) {
      const QueuedFrame& frame = queue_.at(i);
      if (frame.is_value() || frame.reply >= 0 || frame.size > memory_.together_capacity - size) break;
      if (i != 0 && !pacing_.may_follow(size, frame.size, now_us)) break;
      size += frame.size;
    }
    return size;
  }

  void end_of_frame() {
    written_ = leaving_size_ = 0;
    safe_under_way_ = nullptr;
  }

  Outgoing copy_next() {
    if (const SafeValue* const safe = waiting_safe()) {
      std::memcpy(memory_.leaving, safe->frame(), safe->size());
      return numbered(safe->message(), true, safe->reply(), safe->address());
    }
    const QueuedFrame& frame = queue_.front();
    if (!frame.is_value()) {
      queue_.copy_front(memory_.leaving);
      return numbered(frame.message, frame.takes_number, frame.reply, frame.address);
    }
    const Lease& lease = memory_.leases[frame.lease];
    std::memcpy(memory_.leaving, lease.frame(), lease.size());
    return numbered(frame.message, lease.takes_number(), lease.reply(), lease.address());
  }

  Outgoing numbered(std::int16_t message, bool takes_number, std::int16_t reply, std::uint64_t address) {
    takes_number_ = takes_number && memory_.numbers != nullptr;
    leaving_message_ = message;
    if (takes_number_) leaving_size_ = memory_.numbers->give(memory_.leaving, leaving_size_, message);
    return {memory_.leaving, leaving_size_, reply, address};
  }

  /// What `copy_next` gave is under way.
  void take_next() {
    if (takes_number_) memory_.numbers->keep(leaving_message_);
    safe_under_way_ = waiting_safe();
    if (safe_under_way_ != nullptr) {
      safe_under_way_->waits = false;
      first_safe_ = static_cast<std::size_t>(safe_under_way_ - memory_.safe_values) + 1;
      return;
    }
    if (queue_.front().is_value()) memory_.leases[queue_.front().lease].waits = false;
    queue_.pop();
  }

  FrameQueue queue_;
  Memory memory_;
  Pacing pacing_;
  std::uint64_t max_age_us_;
  std::size_t safe_count_;
  HostSendAccount account_;
  const std::uint8_t* leaving_ = nullptr;  ///< the frame that `to_write` gave last, or the first of several
  std::size_t written_ = 0;                ///< of the frame under way; 0: none has begun
  std::size_t leaving_size_ = 0;
  std::int16_t leaving_message_ = -1;
  bool takes_number_ = false;  ///< what `to_write` gave last
  SafeValue* safe_under_way_ = nullptr;
  std::size_t first_safe_ = 0;  ///< the look for one that waits begins here
  bool is_up_ = false;
  bool is_blocked_ = false;
  bool is_latched_ = false;
  bool is_closed_ = false;
};

}  // namespace wirebond
