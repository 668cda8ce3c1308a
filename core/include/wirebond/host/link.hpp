// The host's end of one connection: bytes and times in; frames, what to write, and when to come back out.
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

/// How a host's link stands.
enum class HostLinkState : std::uint8_t {
  down,   ///< the port is away
  stale,  ///< it is there, and no frame came for a second
  up,
};

/// No clock, thread, descriptor, heap or exception: whoever drives it brings bytes and times, and writes what it says.
/// So the same object runs under a thread with a port (python/native) and under virtual time (the tests).
///
/// The driver's loop:
///     wait for bytes, for room while `is_blocked`, or until `next_due`
///     `received` or `idle`; `poll`
///     while `to_write` gives bytes: write them, `written`
///
/// Time is in microseconds and does not wrap. One thread at a time; the driver has the lock.
class HostLink {
 public:
  using ByteDeframer = StreamDeframer<RuntimeSource, std::uint64_t, HostAccount>;
  using Watch = BasicDeadlines<DeadlineSpans<std::uint64_t>, std::uint64_t>;

  /// Silence of the peer after which the link is stale.
  static constexpr std::uint64_t stale_after_us = 1'000'000;

  /// The caller's, and outlives the link. `workspace`: `workspace_bytes(source)` bytes.
  struct Memory {
    std::uint8_t* workspace = nullptr;
    HostOutbox::Memory outbox;
    DeadlineSpans<std::uint64_t> deadlines{nullptr, 0, nullptr, nullptr};  ///< of the host
  };

  struct Settings {
    Pacing pacing;
    std::uint64_t idle_us = 20'000;  ///< silence that ends an incomplete frame, what the port may hold back included
    std::uint64_t pause_us = 0;      ///< where silence ends a frame: that silence, without it
    std::uint64_t max_age_us = 0;    ///< a frame that waited longer expires; 0: never
    HostAddressing::Rules addressing;
  };

  /// Deadlines run from `now_us` on.
  HostLink(const RuntimeSource& source, const Memory& memory, const Settings& settings, std::uint64_t now_us)
      : deframer_(source, memory.workspace, settings.idle_us,
                  settings.pause_us != 0 ? settings.pause_us : settings.idle_us),
        outbox_(memory.outbox, settings.pacing, settings.max_age_us),
        addressing_(source.format(), settings.addressing),
        deadlines_(memory.deadlines, now_us),
        looked_us_(now_us) {}
  HostLink(const HostLink&) = delete;
  HostLink& operator=(const HostLink&) = delete;

  // ---- what the driver brings

  /// A read that began at `before_us` and ended at `after_us` found these bytes; `is_all`: no more were there. For each
  /// frame `sink(frame, may_act, is_foreign)` is called; its bytes live during the call. A foreign one acts on nothing.
  /// A frame may be as old as the last look that left nothing behind: that decides whether it is late.
  template <class Sink>
  void received(const std::uint8_t* bytes, std::size_t size, std::uint64_t before_us, std::uint64_t after_us,
                bool is_all, Sink&& sink) {
    last_byte_us_ = after_us;
    const std::uint64_t unlisted = unlisted_frames();
    deframer_.feed(bytes, size, looked_us_, after_us, Taking<Sink>{*this, sink, after_us});
    if (unlisted_frames() != unlisted) last_frame_us_ = after_us;  // the peer speaks
    if (is_all) looked_us_ = before_us;
  }

  /// A read that began at `began_us` found nothing.
  template <class Sink>
  void idle(std::uint64_t began_us, Sink&& sink) {
    const std::uint64_t unlisted = unlisted_frames();
    deframer_.idle(began_us, Taking<Sink>{*this, sink, began_us});
    if (unlisted_frames() != unlisted) last_frame_us_ = began_us;
    looked_us_ = began_us;
  }

  /// Bytes that came before are not there any more.
  void port_up(std::uint64_t now_us) {
    is_up_ = true;
    looked_us_ = now_us;
    outbox_.port_up(now_us);
  }

  /// What was received and is incomplete is settled; what waits expires, but for safe values.
  template <class Sink>
  void port_down(std::uint64_t now_us, Sink&& sink) {
    is_up_ = false;
    deframer_.give_up(Taking<Sink>{*this, sink, now_us});
    deframer_.expect(-1);  // what was asked is not answered any more
    addressing_.forget();
    outbox_.port_down();
  }

  /// Deadlines, leases, rhythms, ages.
  void poll(std::uint64_t now_us) {
    deadlines_.poll(now_us, [](std::uint8_t) {});  // `deadlines` tells what has struck
    outbox_.poll(now_us);
  }

  /// The bytes to hand over now; then call `written` with how many the port took. Tells the deframer first which
  /// answer to expect: none can come before the first byte of its request leaves. `together`: see HostOutbox.
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

  /// When to call again where no byte comes; `HostOutbox::never`: only for bytes.
  std::uint64_t next_due(std::uint64_t now_us) const {
    std::uint64_t due = outbox_.next_due(now_us);
    if (deframer_.pending() != 0) due = std::min(due, std::max(deframer_.look_at(last_byte_us_, now_us), now_us));
    const std::uint64_t left_us = deadlines_.time_left(now_us);
    if (left_us != Watch::never) due = std::min(due, now_us + left_us);
    return due;
  }

  // ---- what programs want: see HostOutbox

  HostOutbox& outbox() { return outbox_; }
  const HostOutbox& outbox() const { return outbox_; }

  // ---- how it stands

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

  /// One type for all that brings bytes, so that the deframer is compiled once for a sink.
  template <class Sink>
  struct Taking {
    HostLink& link;
    Sink& sink;
    std::uint64_t now_us;

    void operator()(const Frame& frame) const {
      link.last_frame_us_ = now_us;
      MayAct may_act = MayAct::yes;
      if (link.addressing_.is_foreign(frame)) return sink(frame, may_act, true);
      if (frame.message >= 0) may_act = link.deadlines_.may_act(frame.message, link.looked_us_, now_us);
      if (frame.message >= 0 && may_act == MayAct::yes) link.deadlines_.seen(frame.message, link.looked_us_);
      sink(frame, may_act, false);
    }
  };

  ByteDeframer deframer_;
  HostOutbox outbox_;
  HostAddressing addressing_;
  Watch deadlines_;
  std::uint64_t looked_us_;  ///< no byte that came before is still to be read
  std::uint64_t last_byte_us_ = 0;
  std::uint64_t last_frame_us_ = 0;
  bool is_up_ = false;
};

}  // namespace wirebond
