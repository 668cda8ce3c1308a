// All frames that a host wants to send, and their order: queue, repeated values, safe values, the stop.
// One file: every rule is about the same order, in which frames leave.
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

/// Result of a call that wants to send.
enum class [[nodiscard]] SendResult : std::uint8_t{
    accepted,
    down,     ///< the port or the link is closed
    full,     ///< the queue is full
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
  std::uint64_t queued = 0;     ///< now: waiting, or being sent
  std::uint64_t replaced = 0;   ///< a repeated value, a stop or a `keeps_latest` value: by the next of its message
  std::uint64_t expired = 0;    ///< the port was closed, or it waited longer than `max_age`
  std::uint64_t overruled = 0;  ///< dropped because a stop, a safe value or the end of repeating took over its message
  std::uint64_t aborted = 0;    ///< the port was closed while it was being sent

  constexpr bool balances() const {
    return offered == accepted + refused_down + refused_full + refused_stopped &&
           accepted == sent + queued + replaced + expired + overruled + aborted;
  }
};

/// The bytes to give to the port next: of one frame, or of several that ask for no reply. `size` 0: none now.
struct Outgoing {
  const std::uint8_t* bytes = nullptr;
  std::size_t size = 0;
  std::int16_t reply = -1;    ///< if a frame begins with these bytes: index of the message that answers it
  std::uint64_t address = 0;  ///< that frame's receiver, where frames have one
};

/// Order: the frame being sent, to its end; then safe values, in the file's order; then the queue, in which each
/// repeated value has one place. A safe value that was sent moves after the others: if stops fall due faster than the
/// line carries them, each message still gets its turn.
///
/// A stop drops all waiting frames of its messages; the end of a lease with a safe value drops all waiting frames of
/// its message for its address. Neither is ever refused. Two values of one message for different addresses are two
/// leases.
///
/// Where frames have a sequence number they get it here, as they are given to the port: so numbers rise in the order of
/// the wire, and refused, replaced, overruled or expired frames leave no gap. A frame whose sender set the number
/// itself keeps it, and does not change the count. Time is in microseconds and does not wrap. One thread at a time.
class HostOutbox {
 public:
  /// Memory of the caller, which outlives this object. `leases` has one entry for each message of the protocol, by
  /// index, and after these any number for further addresses. `safe_values` holds `safe_capacity`; the first
  /// `safe_count` are those of the file. `leaving` holds the largest frame, `together` the bytes that `to_write` gives
  /// at once.
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
    /// How many frames were sent of each of `message_count` messages; null: not counted.
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

  // ---- requests of programs

  /// Queue one whole frame of `message`, for `address` if frames have one. `takes_number`: it gets a sequence number as
  /// it leaves, if its format has one. O(size). If its lease `keeps_latest` and repeats nothing, it takes the place of
  /// a waiting one, which counts as replaced.
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
        note_motion(message, address);
        return accept_value(*found, now_us) ? SendResult::accepted : SendResult::full;
      }
    }
    // One place is reserved for the repeated value of each message: these are never refused.
    if (size == 0 || size > memory_.leaving_capacity || !queue_.has_room(size, memory_.lease_count) ||
        !queue_.push({static_cast<std::uint32_t>(size), message, reply, now_us, takes_number, address, 0}, frame)) {
      return refuse(account_.refused_full, SendResult::full);
    }
    account_.accepted += 1;
    note_motion(message, address);
    return SendResult::accepted;
  }

  /// Repeat this value at the message's rhythm until `hold_us` from now. `full`: the message has no rhythm, the frame
  /// is larger than its memory, or no lease is left for one more address.
  SendResult repeat(std::int16_t message, const std::uint8_t* frame, std::size_t size, std::int16_t reply,
                    bool takes_number, std::uint64_t hold_us, std::uint64_t now_us, std::uint64_t address = 0) {
    if (is_stopped(message)) return SendResult::stopped;
    if (is_closed_) return SendResult::down;
    Lease* const found = lease_for(message, address);
    if (found == nullptr || !found->can_repeat(size)) return SendResult::full;
    Lease& lease = *found;
    lease.renew(frame, size, reply, takes_number, now_us + hold_us, now_us);
    note_motion(message, address);
    poll(now_us);
    return SendResult::accepted;
  }

  /// Stop repeating it to any address, without a last value; waiting frames are dropped.
  void stop_repeating(std::int16_t message) {
    each_lease(message, [this](Lease& lease) { end_silently(lease); });
  }
  /// Stop repeating it to one address.
  void stop_repeating(std::int16_t message, std::uint64_t address) {
    each_lease(message, [&](Lease& lease) {
      if (lease.address() == address) end_silently(lease);
    });
  }

  /// Check whether the message has a safe value for this address.
  bool has_safe(std::int16_t message, std::uint64_t address) const { return safe_of(message, address) != nullptr; }
  /// Add a message to the stop, or one that ends leases: see SafeValue. Returns false if the memory is full, or one of
  /// the file has this address already.
  bool add_safe(const SafeValue& safe) {
    if (safe_count_ == memory_.safe_capacity || has_safe(safe.message(), safe.address())) return false;
    memory_.safe_values[safe_count_++] = safe;
    return true;
  }

  /// End the message's lease for this address, drop all its waiting frames for that address, and send its safe value
  /// before all else. Also while the port is closed: then it is the first to leave. Returns false if it has none, or
  /// the link is closed.
  bool end_safely(std::int16_t message, std::uint64_t address) {
    SafeValue* const safe = is_closed_ ? nullptr : safe_of(message, address);
    if (safe == nullptr) return false;
    each_lease(message, [&](Lease& lease) {
      if (lease.address() == address) lease.end();
    });
    send_safe(*safe);
    return true;
  }

  /// Do the same, unless the safe value was the last of its message for this address. Returns false if it has none, or
  /// the link is closed.
  bool end_if_moved(std::int16_t message, std::uint64_t address) {
    const SafeValue* const safe = is_closed_ ? nullptr : safe_of(message, address);
    return safe != nullptr && (!safe->moved || end_safely(message, address));
  }

  /// Let `close` send no safe value for frames accepted so far: another program continues the motion.
  void hand_over_motion() {
    for (std::size_t i = 0; i < safe_count_; ++i) memory_.safe_values[i].moved = false;
  }

  /// Drop all waiting frames of the stop's messages, end their leases, and send the stop before all else, and again
  /// until `release_stop`. Also while the port is closed: then it is the first to leave.
  void stop(std::uint64_t now_us) {
    is_latched_ = true;
    if (waiting_safe() == nullptr) first_safe_ = 0;
    for (std::size_t i = 0; i < safe_count_; ++i) {
      SafeValue& safe = memory_.safe_values[i];
      drop([&](const QueuedFrame& frame) { return frame.message == safe.message(); });
      each_lease(safe.message(), [](Lease& lease) { lease.end(); });
      safe.moved = false;
      if (!safe.is_in_stop()) continue;
      offer_safe(safe);
      safe.begin_repeating(now_us);
    }
  }

  /// Allow the messages again. Sends nothing; a stop that has not left yet still leaves.
  void release_stop() { is_latched_ = false; }

  bool is_stopped() const { return is_latched_; }
  bool is_stopped(std::int16_t message) const {
    for (std::size_t i = 0; is_latched_ && i < safe_count_; ++i) {
      if (memory_.safe_values[i].message() == message) return true;
    }
    return false;
  }

  /// End every lease, and send the safe value of everything that moved. More may be sent.
  void end_motion() {
    for (std::size_t i = 0; i < memory_.lease_count; ++i) {
      if (memory_.leases[i].is_alive()) end_lease(memory_.leases[i]);
    }
    for (std::size_t i = 0; i < safe_count_; ++i) {
      if (memory_.safe_values[i].moved) send_safe(memory_.safe_values[i]);
    }
  }

  /// End motion, and accept nothing more.
  void close() {
    is_closed_ = true;
    end_motion();
  }

  /// Expire all waiting frames: they will never leave.
  void end() {
    port_down();
    for (std::size_t i = 0; i < safe_count_; ++i) {
      account_.expired += memory_.safe_values[i].waits ? 1 : 0;
      memory_.safe_values[i].waits = false;
    }
  }

  // ---- time and port

  /// End leases, queue values that are due, expire old frames.
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

  /// Return when to call `poll` or `to_write` next; `never` if nothing is to be done. While the port takes nothing
  /// (`is_blocked`), the port decides when to write.
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

  /// Expire waiting frames, except safe values: those are the first to leave when the port is open again.
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

  /// Return the bytes to give to the port now. Call `written` before anything else. `together`: frames that may leave
  /// now and need no individual treatment are given at once; otherwise one by one.
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

  /// Note that the port took `size` bytes from `to_write`. 0: it takes nothing until it reports that it can.
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
      leaving_size_ = queue_.front().size;  // it was given together with the frame before it
      leaving_message_ = queue_.front().message;
    }
  }

  /// Check whether the port took nothing, and will report when it can.
  bool is_blocked() const { return is_blocked_; }

  /// Note how many bytes the driver holds, where it can report that.
  void driver_holds(std::size_t size, std::uint64_t now_us) { pacing_.driver_holds(size, now_us); }

  /// Check whether nothing waits and nothing is being sent.
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
    const auto index = static_cast<std::size_t>(message);  // without a message: beyond all
    return index < memory_.message_count && memory_.leases[index].keeps_latest();
  }

  /// Return the lease of this value, or an idle one; null: none is left.
  Lease* lease_for(std::int16_t message, std::uint64_t address) {
    Lease* idle = nullptr;
    for (std::size_t i = 0; i < memory_.lease_count; ++i) {
      Lease& lease = memory_.leases[i];
      if (lease.is_of(message, address)) return &lease;
      // Leases of messages are reserved for them.
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

  void note_motion(std::int16_t message, std::uint64_t address) {
    if (SafeValue* const safe = safe_of(message, address)) safe->moved = true;
  }

  SafeValue* waiting_safe() const {
    for (std::size_t i = 0; i < safe_count_; ++i) {
      SafeValue& safe = memory_.safe_values[(first_safe_ + i) % safe_count_];
      if (safe.waits) return &safe;
    }
    return nullptr;
  }

  /// Overrule all waiting frames that match.
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

  /// Send a safe value in place of all waiting frames of its message for its address.
  void send_safe(SafeValue& safe) {
    drop([&](const QueuedFrame& frame) { return frame.message == safe.message() && frame.address == safe.address(); });
    safe.moved = false;
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

  /// Queue a lease's value. Returns false, and counts it, if there is no place for it.
  bool accept_value(Lease& lease, std::uint64_t now_us) {
    if (lease.waits) {  // it leaves with the newest bytes, in the place that it has
      account_.accepted += 1;
      account_.replaced += 1;
      return true;
    }
    const auto place = static_cast<std::uint32_t>(&lease - memory_.leases);
    lease.waits = queue_.push({0, lease.message(), -1, now_us, false, lease.address(), place}, nullptr);
    (lease.waits ? account_.accepted : account_.refused_full) += 1;  // more places may be taken than `send` leaves free
    return lease.waits;
  }

  /// Return when the first frame in the queue was accepted; `never`: it is repeated, and does not age.
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

  /// Return how many bytes the first frames of the queue have that may leave at once; 0: the next one leaves alone.
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

  /// Note that the frame from `copy_next` is being sent.
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
  std::size_t written_ = 0;                ///< bytes written of the frame being sent; 0: none has begun
  std::size_t leaving_size_ = 0;
  std::int16_t leaving_message_ = -1;
  bool takes_number_ = false;  ///< for the frame that `to_write` gave last
  SafeValue* safe_under_way_ = nullptr;
  std::size_t first_safe_ = 0;  ///< the search for a waiting one begins here
  bool is_up_ = false;
  bool is_blocked_ = false;
  bool is_latched_ = false;
  bool is_closed_ = false;
};

}  // namespace wirebond
