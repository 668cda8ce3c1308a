// A host's link with its memory, and its received messages in batches: no thread, no port, no clock.
#pragma once

#include <cstdint>
#include <deque>
#include <memory>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "wirebond/engine/batch.hpp"
#include "wirebond/engine/link_setup.hpp"
#include "wirebond/engine/protocol.hpp"
#include "wirebond/engine/recent.hpp"
#include "wirebond/engine/sequence_book.hpp"
#include "wirebond/engine/tap.hpp"
#include "wirebond/host/host_echo.hpp"
#include "wirebond/host/link.hpp"

namespace wirebond::engine {

/// Events of a link other than frames.
enum class ChangeKind : std::uint8_t { struck, ended, port_up, port_down };
struct LinkChange {
  std::uint64_t t_us = 0;
  ChangeKind kind = ChangeKind::struck;
  std::uint8_t action = 0;  ///< of the deadline that has struck or ended
};

/// All counters of a link, at one moment.
struct LinkAccount {
  HostSendAccount send;
  HostAccount receive;
  std::uint64_t bytes = 0;
  std::uint64_t pending = 0;
  std::vector<std::uint64_t> counts;  ///< delivered frames by message
  std::vector<std::uint64_t> sent;    ///< sent frames by message
  SequenceAccount sequence;
  NotActed<std::uint64_t> not_acted;
  ForeignCounts foreign;
  std::uint64_t dropped_messages = 0;
  std::uint64_t reconnects = 0;
  std::uint64_t echoed = 0;      ///< own bytes that came back
  std::uint64_t collisions = 0;  ///< frames that did not come back as they were sent
};

/// One thread at a time.
class LinkCore {
 public:
  static constexpr std::size_t max_queued_bytes = 65536;
  static constexpr std::size_t max_queued_frames = 16384;
  static constexpr std::size_t max_together_bytes = 4096;
  static constexpr std::size_t max_waiting_messages = 65536;
  /// How late this computer may hear an echo: a longer wait only delays the report of a collision.
  static constexpr std::uint64_t scheduling_us = 100'000;
  static constexpr std::size_t max_waiting_changes = 1024;  ///< beyond, the oldest are dropped

  LinkCore(LinkSetup setup, std::uint64_t now_us);
  LinkCore(const LinkCore&) = delete;
  LinkCore& operator=(const LinkCore&) = delete;

  HostLink& link() { return *link_; }
  const HostLink& link() const { return *link_; }
  HostOutbox& outbox() { return link_->outbox(); }
  /// Give this address its own safe value, because a message of the stop goes to it. Returns false if the memory is
  /// full.
  bool note_safe(StopFrame safe);

  void received(const std::uint8_t* bytes, std::size_t size, std::uint64_t before_us, std::uint64_t after_us,
                bool is_all);
  void idle(std::uint64_t began_us);
  void poll(std::uint64_t now_us);
  void recover_deadline(std::uint8_t action, std::uint64_t now_us);
  /// Return the due time of `link()`, or when own bytes are no longer expected back, whichever comes first.
  std::uint64_t next_due(std::uint64_t now_us) const;
  /// Wrap those of `link()`, and keep written bytes for `recent`. An echo is compared frame by frame: then none leave
  /// together.
  Outgoing to_write(std::uint64_t now_us, bool together = false);
  void written(std::size_t size, std::uint64_t now_us);
  void port_up(std::uint64_t now_us);
  /// `why`: a sentence with the reason; empty if the link ends.
  void port_down(std::uint64_t now_us, const std::string& why);

  /// Return the bytes that may be written now, for a driver that writes while others send: all but the last byte count
  /// as written, so that the frame counts as begun. That byte follows with `written(1)` when the port has taken all. A
  /// single byte counts at once, and nothing follows.
  std::vector<std::uint8_t> hand_over(std::uint64_t now_us);

  bool has_arrivals() const { return !arrivals_.empty(); }
  bool has_changes() const { return !changes_.empty(); }
  bool has_news() const { return has_arrivals() || has_changes(); }
  /// Return all messages that came and were not taken.
  std::deque<Arrivals> take();
  std::deque<LinkChange> take_changes() { return std::exchange(changes_, {}); }

  /// Keep all reads, writes and events from now on for `take_tap`, up to this many bytes.
  int open_tap(std::size_t capacity, std::uint64_t now_us);
  /// Returns nothing for a number that is not open.
  TapCopy take_tap(int number);
  void close_tap(int number);
  /// Add a program's own text to all taps.
  void note(const std::string& text, std::uint64_t now_us);
  /// Another program had changed the settings of the port.
  void settings_restored(std::uint64_t now_us);
  /// Add all changes since the last call to the taps: the stop, deadlines, leases. Call it after anything that may
  /// change them. Costs one comparison while there is no tap. `why`: why a missing lease has ended.
  void note_changes(std::uint64_t now_us, const char* why = "ended") {
    if (!taps_.empty()) compare(now_us, why);
  }

  LinkAccount account() const;
  const RecentBytes& recent() const { return recent_; }
  std::vector<std::uint8_t> struck_deadlines() const;
  const ProtocolTable& protocol() const { return *setup_.protocol; }
  const FormatTable& receives() const { return *setup_.receive; }

 private:
  /// Take bytes that are not the link's own.
  void take_received(const std::uint8_t* bytes, std::size_t size, std::uint64_t before_us, std::uint64_t after_us,
                     bool is_all);
  void give_up_echo(std::uint64_t now_us);
  void note_collisions(std::uint64_t now_us);
  /// One sink for all functions that feed: the deframer is compiled again for each type of sink.
  struct Keeping;
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
  std::deque<std::vector<std::uint8_t>> safe_frames_;  ///< of addresses that are not in the file
  std::vector<std::uint8_t> leaving_;
  std::vector<std::uint8_t> together_;
  std::vector<std::uint64_t> next_numbers_;  ///< one, or one for each message
  std::vector<std::uint8_t> numbering_;      ///< scratch
  std::unique_ptr<FrameNumbers> numbers_;    ///< null: frames have no sequence number
  std::vector<PeerStop> peer_stops_;
  std::vector<std::uint64_t> deadline_since_;
  std::vector<std::uint8_t> deadline_marks_;
  std::vector<std::uint8_t> deadline_struck_;  ///< by rule: whether its action had struck at the last check
  std::unique_ptr<HostLink> link_;

  std::vector<std::uint64_t> counts_;  ///< delivered frames by message
  std::vector<std::uint64_t> sent_;    ///< sent frames by message
  SequenceBook sequence_;
  RecentBytes recent_;
  std::vector<Tap> taps_;
  int last_tap_ = 0;
  bool was_stopped_ = false;                 ///< as the taps know it; so are the next two
  std::vector<std::uint8_t> had_struck_;     ///< actions
  std::vector<std::uint8_t> was_repeating_;  ///< by lease
  Outgoing to_write_;                        ///< result of the last `to_write`
  bool is_under_way_ = false;                ///< a part of it was written
  std::vector<std::uint8_t> echo_memory_;
  std::unique_ptr<HostEcho> echo_;      ///< null: the line does not echo
  std::vector<std::uint8_t> others_;    ///< scratch: received bytes that are not own ones
  std::uint64_t noted_collisions_ = 0;  ///< already in `recent`
  ForeignCounts foreign_;
  std::deque<Arrivals> arrivals_;
  std::size_t waiting_messages_ = 0;
  std::deque<LinkChange> changes_;
  std::uint64_t dropped_messages_ = 0;
  std::uint64_t reconnects_ = 0;
  bool was_up_ = false;
};

/// Return 0 to 3 in the order of SendResult.
inline int answer_of(SendResult result) { return static_cast<int>(result); }

inline const char* name_of(HostLinkState state) {
  switch (state) {
    case HostLinkState::down: return "down";
    case HostLinkState::stale: return "stale";
    case HostLinkState::up: break;
  }
  return "up";
}

}  // namespace wirebond::engine
