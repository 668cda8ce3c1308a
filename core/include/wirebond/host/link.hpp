// The host's end of one connection: bytes and times in; frames, bytes to write and the next due time out.
#pragma once

#include <algorithm>
#include <cstddef>
#include <cstdint>

#include "wirebond/deadline.hpp"
#include "wirebond/host/addressing.hpp"
#include "wirebond/host/outbox.hpp"
#include "wirebond/host/runtime_source.hpp"
#include "wirebond/stream_deframer.hpp"
#include "wirebond/unlisted.hpp"

namespace wirebond {

/// State of a host's link.
enum class HostLinkState : std::uint8_t {
  down,   ///< the port is closed
  stale,  ///< the port is open, but no frame came for a second
  up,
};

/// A message of the emergency stop that the peer sends, where this end is an MCU: it acts even if it is late or held
/// back. The bytes are the caller's, and outlive the link.
struct PeerStop {
  std::int16_t message;
  const std::uint8_t* payload;
  const std::uint8_t* mask;  ///< of bits that count
  std::size_t size;          ///< of both
  bool is_whole;             ///< a payload of another size is not it; else zeros that were trimmed count as zeros

  bool is_it(const Frame& frame) const {
    if (frame.message != message || (is_whole && frame.payload_size != size)) return false;
    for (std::size_t i = 0; i < size; ++i) {
      const std::uint8_t byte = i < frame.payload_size ? frame.payload[i] : std::uint8_t{0};
      if (((byte ^ payload[i]) & mask[i]) != 0) return false;
    }
    return true;
  }
};

/// No clock, thread, descriptor, heap or exception: its driver brings bytes and times, and writes the bytes that it
/// gives. So the same object runs under a thread with a port (python/native) and under virtual time (the tests).
///
/// The driver's loop:
///     wait for bytes, for the port to take bytes while `is_blocked`, or until `next_due`
///     `received` or `idle`; `poll`
///     while `to_write` gives bytes: write them, `written`
///
/// Time is in microseconds and does not wrap. One thread at a time; the driver holds the lock.
class HostLink {
 public:
  using ByteDeframer = StreamDeframer<RuntimeSource, std::uint64_t, HostAccount>;
  using Watch = BasicDeadlines<DeadlineSpans<std::uint64_t>, std::uint64_t>;

  /// Memory of the caller, which outlives the link. `workspace`: `workspace_bytes(source)` bytes.
  struct Memory {
    std::uint8_t* workspace = nullptr;
    HostOutbox::Memory outbox;
    DeadlineSpans<std::uint64_t> deadlines{nullptr, 0, nullptr, nullptr};  ///< of the host
  };

  struct Settings {
    Pacing pacing;
    std::uint64_t idle_us = 20'000;        ///< silence that ends an incomplete frame, including delays by the port
    std::uint64_t pause_us = 0;            ///< where silence ends a frame: that silence, without the port's delay
    const PeerStop* peer_stops = nullptr;  ///< owned by the caller, and outlive the link
    std::size_t peer_stop_count = 0;
    std::uint64_t max_age_us = 0;  ///< a frame that waited longer expires; 0: never
    HostAddressing::Rules addressing;
  };

  /// Deadlines run from `now_us` on.
  HostLink(const RuntimeSource& source, const Memory& memory, const Settings& settings, std::uint64_t now_us)
      : deframer_(source, memory.workspace, settings.idle_us,
                  settings.pause_us != 0 ? settings.pause_us : settings.idle_us),
        outbox_(memory.outbox, settings.pacing, settings.max_age_us),
        addressing_(source.format(), settings.addressing),
        deadlines_(memory.deadlines, now_us),
        peer_stops_(settings.peer_stops),
        peer_stop_count_(settings.peer_stop_count),
        looked_us_(now_us) {}
  HostLink(const HostLink&) = delete;
  HostLink& operator=(const HostLink&) = delete;

  // ---- input from the driver

  /// Take the bytes of a read that began at `before_us` and ended at `after_us`; `is_all`: no more bytes were there.
  /// Calls `sink(frame, may_act, is_foreign)` for each frame; its bytes live during the call. A foreign one acts on
  /// nothing. A frame may be as old as the last read that left nothing unread: that decides whether it is late.
  template <class Sink>
  void received(const std::uint8_t* bytes, std::size_t size, std::uint64_t before_us, std::uint64_t after_us,
                bool is_all, Sink&& sink) {
    last_byte_us_ = after_us;
    const std::uint64_t unlisted = unlisted_frames();
    deframer_.feed(bytes, size, looked_us_, after_us, Taking<Sink>{*this, sink, after_us});
    if (unlisted_frames() != unlisted) last_frame_us_ = after_us;  // the peer sends
    if (is_all) looked_us_ = before_us;
  }

  /// Note that a read that began at `began_us` found nothing.
  template <class Sink>
  void idle(std::uint64_t began_us, Sink&& sink) {
    const std::uint64_t unlisted = unlisted_frames();
    deframer_.idle(began_us, Taking<Sink>{*this, sink, began_us});
    if (unlisted_frames() != unlisted) last_frame_us_ = began_us;
    looked_us_ = began_us;
  }

  /// Note that the port is open: bytes received before are gone.
  void port_up(std::uint64_t now_us) {
    is_up_ = true;
    looked_us_ = now_us;
    outbox_.port_up(now_us);
  }

  /// Note that the port is closed: settles incomplete received bytes; waiting frames expire, except safe values.
  template <class Sink>
  void port_down(std::uint64_t now_us, Sink&& sink) {
    is_up_ = false;
    deframer_.give_up(Taking<Sink>{*this, sink, now_us});
    deframer_.expect(-1);  // requests are no longer answered
    addressing_.forget();
    outbox_.port_down();
  }

  /// Handle deadlines, leases, rhythms and ages.
  void poll(std::uint64_t now_us) {
    deadlines_.poll(now_us, [](std::uint8_t) {});  // `deadlines` shows which have struck
    outbox_.poll(now_us);
  }

  /// Return the bytes to give to the port now; then call `written` with how many it took. Sets first which answer the
  /// deframer expects: none can come before the first byte of its request leaves. `together`: see HostOutbox.
  Outgoing to_write(std::uint64_t now_us, bool together = false) {
    const Outgoing out = outbox_.to_write(now_us, together);
    if (out.size != 0 && out.reply >= 0) {
      deframer_.expect(out.reply);
      addressing_.asks(out.reply, out.address);
    }
    return out;
  }
  void written(std::size_t size, std::uint64_t now_us) { outbox_.written(size, now_us); }
  bool is_blocked() const { return outbox_.is_blocked(); }
  void driver_holds(std::size_t size, std::uint64_t now_us) { outbox_.driver_holds(size, now_us); }

  /// Return when to call again if no byte comes; `HostOutbox::never`: only when bytes come.
  std::uint64_t next_due(std::uint64_t now_us) const {
    std::uint64_t due = outbox_.next_due(now_us);
    if (deframer_.pending() != 0) due = std::min(due, std::max(deframer_.look_at(last_byte_us_, now_us), now_us));
    const std::uint64_t left_us = deadlines_.time_left(now_us);
    if (left_us != Watch::never) due = std::min(due, now_us + left_us);
    return due;
  }

  // ---- requests of programs: see HostOutbox

  HostOutbox& outbox() { return outbox_; }
  const HostOutbox& outbox() const { return outbox_; }

  // ---- state

  HostLinkState state(std::uint64_t now_us) const {
    if (!is_up_) return HostLinkState::down;
    const bool hears = last_frame_us_ != 0 && now_us - std::min(last_frame_us_, now_us) < stale_after_us;
    return hears ? HostLinkState::up : HostLinkState::stale;
  }
  bool is_up() const { return is_up_; }
  const ByteDeframer& deframer() const { return deframer_; }

  HostAddressing& addressing() { return addressing_; }
  const HostAddressing& addressing() const { return addressing_; }

  Watch& deadlines() { return deadlines_; }
  const Watch& deadlines() const { return deadlines_; }

 private:
  std::uint64_t unlisted_frames() const { return deframer_.account().unlisted.found().frames(); }

  bool is_peer_stop(const Frame& frame) const {
    return std::any_of(peer_stops_, peer_stops_ + peer_stop_count_,
                       [&](const PeerStop& stop) { return stop.is_it(frame); });
  }

  /// One type for all functions that bring bytes, so that the deframer is compiled once per sink.
  template <class Sink>
  struct Taking {
    HostLink& link;
    Sink& sink;
    std::uint64_t now_us;

    void operator()(const Frame& frame) const {
      link.last_frame_us_ = now_us;
      MayAct may_act = MayAct::yes;
      if (link.addressing_.is_foreign(frame)) return sink(frame, may_act, true);
      if (frame.message >= 0) {
        may_act =
            link.deadlines_.may_act(frame.message, link.looked_us_, now_us, [&] { return link.is_peer_stop(frame); });
      }
      if (frame.message >= 0 && may_act == MayAct::yes) link.deadlines_.seen(frame.message, link.looked_us_);
      sink(frame, may_act, false);
    }
  };

  ByteDeframer deframer_;
  HostOutbox outbox_;
  HostAddressing addressing_;
  Watch deadlines_;
  const PeerStop* peer_stops_;
  std::size_t peer_stop_count_;
  std::uint64_t looked_us_;  ///< every byte that came before this time has been read
  std::uint64_t last_byte_us_ = 0;
  std::uint64_t last_frame_us_ = 0;
  bool is_up_ = false;
};

}  // namespace wirebond
