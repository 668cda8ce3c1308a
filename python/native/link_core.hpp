// A host's link with its memory, and what it received in batches for Python: no thread, no port, no clock.
#pragma once

#include <nanobind/nanobind.h>

#include <cstdint>
#include <deque>
#include <memory>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "decoder.hpp"
#include "link_setup.hpp"
#include "protocol.hpp"
#include "recent.hpp"
#include "tap.hpp"
#include "wirebond/host/host_echo.hpp"
#include "wirebond/host/link.hpp"

namespace wirebond::engine {

/// Messages that came with one read.
struct Arrivals {
  std::shared_ptr<Batch> batch;
  std::vector<Event> events;
};

/// What happens on a link beside frames.
enum class ChangeKind : std::uint8_t { struck, ended, port_up, port_down };
struct LinkChange {
  std::uint64_t t_us = 0;
  ChangeKind kind = ChangeKind::struck;
  std::uint8_t action = 0;  ///< of the deadline that has struck or ended
};

/// All that a link counts, at one moment.
struct LinkAccount {
  HostSendAccount send;
  HostAccount receive;
  std::uint64_t bytes = 0;
  std::uint64_t pending = 0;
  std::vector<std::uint64_t> counts;  ///< delivered frames by message
  std::vector<std::uint64_t> sent;    ///< frames that left, by message
  SequenceAccount sequence;
  NotActed<std::uint64_t> not_acted;
  ForeignCounts foreign;
  std::uint64_t dropped_messages = 0;
  std::uint64_t reconnects = 0;
  std::uint64_t echoed = 0;      ///< own bytes that came back
  std::uint64_t collisions = 0;  ///< frames that did not come back as they were sent
};

/// The fields of `wirebond.LinkStats`. With the GIL, and no lock.
nb::dict to_dict(const LinkAccount& account, const ProtocolTable& protocol, const FormatTable& receive);

/// One thread at a time. Makes no Python object: that may run any Python code (garbage collection), which must not
/// happen while a lock is held.
class LinkCore {
 public:
  static constexpr std::size_t max_queued_bytes = 65536;
  static constexpr std::size_t max_queued_frames = 16384;
  static constexpr std::size_t max_together_bytes = 4096;
  static constexpr std::size_t max_waiting_messages = 65536;
  /// What this computer may be late to hear an echo: to wait longer only tells a collision later.
  static constexpr std::uint64_t scheduling_us = 100'000;
  static constexpr std::size_t max_waiting_changes = 1024;  ///< then the oldest are dropped

  /// Of received messages; see Message. For who has the GIL.
  nb::object stamper;

  LinkCore(LinkSetup setup, std::uint64_t now_us);
  LinkCore(const LinkCore&) = delete;
  LinkCore& operator=(const LinkCore&) = delete;

  HostLink& link() { return *link_; }
  const HostLink& link() const { return *link_; }
  HostOutbox& outbox() { return link_->outbox(); }
  /// A message of the stop goes to this address: from now on that has a safe value of its own. False: no room.
  bool note_safe(StopFrame safe);

  void received(const std::uint8_t* bytes, std::size_t size, std::uint64_t before_us, std::uint64_t after_us,
                bool is_all);
  void idle(std::uint64_t began_us);
  void poll(std::uint64_t now_us);
  void recover_deadline(std::uint8_t action, std::uint64_t now_us);
  /// That of `link()`, and when own bytes are not expected to come back any more.
  std::uint64_t next_due(std::uint64_t now_us) const;
  /// Those of `link()`; what was written is kept for `recent`. An echo is compared frame by frame: then none leave
  /// together.
  Outgoing to_write(std::uint64_t now_us, bool together = false);
  void written(std::size_t size, std::uint64_t now_us);
  void port_up(std::uint64_t now_us);
  /// `why`: the sentence that says it; empty where the link ends.
  void port_down(std::uint64_t now_us, const std::string& why);

  /// What may be written now, for a driver that writes while others send: all but the last byte count as written, so
  /// that the frame is under way. That byte follows with `written(1)` when the port has taken all. One lone byte counts
  /// at once, and nothing follows. With the GIL.
  nb::bytes hand_over(std::uint64_t now_us);

  bool has_arrivals() const { return !arrivals_.empty(); }
  bool has_changes() const { return !changes_.empty(); }
  bool has_news() const { return has_arrivals() || has_changes(); }
  /// All that came and was not taken; without the GIL.
  std::deque<Arrivals> take();
  std::deque<LinkChange> take_changes() { return std::exchange(changes_, {}); }

  /// From now on all that is read, written and happens is kept for `take_tap`, up to this many bytes.
  int open_tap(std::size_t capacity, std::uint64_t now_us);
  /// Nothing for a number that is not open. Without the GIL.
  TapCopy take_tap(int number);
  void close_tap(int number);
  /// Taps get what a program says: a text of its own.
  void note(const std::string& text, std::uint64_t now_us);
  /// Taps get what changed since the last call: the stop, deadlines, leases. Call it behind whatever may change them.
  /// Costs one comparison while there is no tap. `why`: why a lease that is not there any more has ended.
  void note_changes(std::uint64_t now_us, const char* why = "ended") {
    if (!taps_.empty()) compare(now_us, why);
  }

  LinkAccount account() const;
  const RecentBytes& recent() const { return recent_; }
  std::vector<std::uint8_t> struck_deadlines() const;
  const ProtocolTable& protocol() const { return *setup_.protocol; }
  const FormatTable& receives() const { return *setup_.receive; }

 private:
  /// Bytes that are not the link's own.
  void take_received(const std::uint8_t* bytes, std::size_t size, std::uint64_t before_us, std::uint64_t after_us,
                     bool is_all);
  void give_up_echo(std::uint64_t now_us);
  void note_collisions(std::uint64_t now_us);
  void keep(const Frame& frame, MayAct may_act, bool is_foreign, std::uint64_t when_us, Arrivals& arrivals);
  void publish(Arrivals&& arrivals);
  void compare(std::uint64_t now_us, const char* why);
  void tap(TapKind kind, const std::uint8_t* bytes, std::size_t size, std::uint64_t before_us, std::uint64_t t_us) {
    for (Tap& tap : taps_) tap.note(kind, bytes, size, before_us, t_us);
  }
  void tap_text(TapKind kind, const std::string& text, std::uint64_t t_us) {
    tap(kind, reinterpret_cast<const std::uint8_t*>(text.data()), text.size(), t_us, t_us);
  }
  void tell_deadlines(std::uint64_t now_us);
  void tell(LinkChange change);

  LinkSetup setup_;
  std::vector<std::uint8_t> workspace_;
  std::vector<std::uint8_t> queue_bytes_;
  std::unique_ptr<QueuedFrame[]> queue_frames_;
  std::vector<std::vector<std::uint8_t>> values_;  ///< by message: the repeated value
  std::vector<Lease> leases_;
  std::vector<SafeValue> safe_values_;
  std::deque<std::vector<std::uint8_t>> safe_frames_;  ///< of addresses that the file does not name
  std::vector<std::uint8_t> leaving_;
  std::vector<std::uint8_t> together_;
  std::vector<std::uint64_t> next_numbers_;  ///< one, or one for each message
  std::vector<std::uint8_t> numbering_;      ///< scratch
  std::unique_ptr<FrameNumbers> numbers_;    ///< null: frames have no sequence number
  std::vector<std::uint64_t> deadline_since_;
  std::vector<std::uint8_t> deadline_marks_;
  std::vector<std::uint8_t> deadline_struck_;  ///< by rule: its action had struck when it was looked at last
  std::unique_ptr<HostLink> link_;

  std::vector<std::uint64_t> counts_;  ///< delivered frames by message
  std::vector<std::uint64_t> sent_;    ///< frames that left, by message
  SequenceBook sequence_;
  RecentBytes recent_;
  std::vector<Tap> taps_;
  int last_tap_ = 0;
  bool was_stopped_ = false;                 ///< as the taps know it; so are the next two
  std::vector<std::uint8_t> had_struck_;     ///< actions
  std::vector<std::uint8_t> was_repeating_;  ///< by lease
  Outgoing to_write_;                        ///< what `to_write` gave last
  bool is_under_way_ = false;                ///< of it, a part was written
  std::vector<std::uint8_t> echo_memory_;
  std::unique_ptr<HostEcho> echo_;      ///< null: the line does not echo
  std::vector<std::uint8_t> others_;    ///< scratch: received bytes that are not own ones
  std::uint64_t noted_collisions_ = 0;  ///< in `recent`
  ForeignCounts foreign_;
  std::deque<Arrivals> arrivals_;
  std::size_t waiting_messages_ = 0;
  std::deque<LinkChange> changes_;
  std::uint64_t dropped_messages_ = 0;
  std::uint64_t reconnects_ = 0;
  bool was_up_ = false;
};

/// As Python calls it: `LinkCore` with times in microseconds as arguments, for tests under virtual time.
void bind_link_core(nb::module_& m);

/// ``[(kind, before, t, bytes), …]``, and what was lost since the last time: pieces, received bytes, sent bytes.
nb::tuple to_tuple(const TapCopy& taken);

/// ``(kind, t, bytes)`` for each piece, times in microseconds; and how many bytes were dropped. With the GIL, no lock.
nb::tuple to_tuple(const RecentCopy& recent);

/// ``(kind, t, action)`` for each, times in microseconds. With the GIL, no lock.
nb::list to_list(const std::deque<LinkChange>& changes);

/// 0 to 3 in the order of SendResult.
inline int answer_of(SendResult result) { return static_cast<int>(result); }
const char* name_of(HostLinkState state);

}  // namespace wirebond::engine
