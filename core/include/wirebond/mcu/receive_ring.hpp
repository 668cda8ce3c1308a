// A circular buffer that DMA fills: how far it came, what was read, laps and restarts. Positions only: no frame, no
// port.
#pragma once

#include <atomic>
#include <cstddef>
#include <cstdint>

#include "wirebond/mcu/atomics.hpp"

namespace wirebond {

/// What became of the bytes that DMA wrote, modulo 2^32: received = handed out + lapped + dropped + still there.
struct ReceiveAccount {
  std::uint32_t received = 0;    ///< bytes that DMA wrote into the ring
  std::uint32_t handed_out = 0;  ///< of these, given to the deframer
  std::uint32_t lapped = 0;      ///< of these, written over before they were read
  std::uint32_t laps = 0;        ///< how often that happened
  std::uint32_t overtaken = 0;   ///< handed out, and written over while they were read: the ring is too small
  std::uint32_t dropped = 0;     ///< of `received`: not read, because more may have come than anybody could count
  /// How often there was no poll for as long as the ring takes to fill. Whole rings may have come then that `received`
  /// does not know of; what was left of them is in `dropped`.
  std::uint32_t laps_unknown = 0;
};

/// The writer is the DMA, told of by the UART's interrupt (`advance`, `restart`); the reader is one other context,
/// which may be interrupted by it (`look`, `next`, `consumed`). Nobody waits, nothing is masked: each variable has one
/// writer.
///
/// Positions count every byte since the start, modulo 2^32. A restarted DMA writes from the ring's front again. That
/// waits until all is read, so that it writes over nothing; from then on `origin_` lies at the front.
///
/// The hardware tells a place and not a count: `advance` must be called once for every turn of the DMA at least, which
/// the half and full events do unless interrupts are masked for as long as the whole ring takes. Whoever has a clock
/// finds that out, and calls `drop_unread`.
class ReceiveRing {
 public:
  using Count = std::uint32_t;

  struct Span {
    const std::uint8_t* data;
    std::size_t size;  ///< 0: nothing to read
  };

  /// `size`: a power of two, in bytes. The memory outlives this object.
  ReceiveRing(const std::uint8_t* bytes, std::size_t size) : bytes_(bytes), mask_(static_cast<Count>(size - 1)) {}

  // ---- the UART's interrupt

  /// DMA writes at `place` next. Events may come in any order, merged or without news. Returns the position.
  Count advance(std::size_t place) {
    Count written = written_.load(std::memory_order_relaxed);  // only this context writes it
    written += ahead(place, written);
    written_.store(written, std::memory_order_release);  // pairs with `look`
    return written;
  }

  /// Has the reader read all that DMA wrote until the last `advance`? Only then may DMA be begun again.
  bool is_all_read() const {
    return read_.load(std::memory_order_acquire) == written_.load(std::memory_order_relaxed);  // pairs with `pass`
  }

  /// DMA is about to begin again. Until `end_restart` its place says nothing, and `look` does not look: it may run
  /// above this interrupt, or on another core.
  void begin_restart() {
    restarts_.store(static_cast<std::uint8_t>(restarts_.load(std::memory_order_relaxed) + 1),
                    std::memory_order_relaxed);
    std::atomic_thread_fence(std::memory_order_release);  // before the port's stores; pairs with `look`
  }
  void end_restart() {  // behind the new place and `restart`; pairs with `look`
    restarts_.store(static_cast<std::uint8_t>(restarts_.load(std::memory_order_relaxed) + 1),
                    std::memory_order_release);
  }

  /// DMA has begun again at the ring's front, between `begin_restart` and `end_restart`. Before it did, `advance` was
  /// called with its last place, and all was read: the reader has no byte in hand whose place this changes.
  void restart() { origin_.store(written_.load(std::memory_order_relaxed), std::memory_order_relaxed); }

  // ---- the reader

  /// Note how far DMA is. `place()` tells where it writes next, as the port says it. False: reception is being begun
  /// again just now, and nothing can be said.
  template <class Place>
  bool look(Place&& place) {
    for (;;) {
      const std::uint8_t restarts = restarts_.load(std::memory_order_acquire);  // pairs with `end_restart`
      if ((restarts & 1u) != 0) return false;
      const Count written = written_.load(std::memory_order_acquire);  // pairs with `advance`
      const Count seen = written + ahead(place(), written);
      std::atomic_thread_fence(std::memory_order_acquire);  // behind the place; pairs with `begin_restart`
      // An event between the two: its place is newer, and a restart may lie between.
      if (restarts_.load(std::memory_order_relaxed) != restarts) continue;
      if (written_.load(std::memory_order_relaxed) != written) continue;
      seen_ = seen;
      return true;
    }
  }

  /// Where the next byte lies that `next` gives, counted as `advance` counts.
  Count position() const { return read_so_far(); }
  /// Where in the ring that is.
  Count place() const { return (read_so_far() - origin_.load(std::memory_order_relaxed)) & mask_; }

  /// The next bytes in one piece, as far as `look` saw; none: all is read. Bytes that DMA wrote over are left out, and
  /// counted. After a lap half a ring of the newest is kept, so that the DMA is not met again at once.
  Span next() {
    const Count lost = written_over(seen_);
    if (lost != 0) {
      laps_ += 1;
      lapped_ += lost;
      pass(lost);
    }
    const Count unread = seen_ - read_so_far();
    const Count to_wrap = size() - place();
    return {bytes_ + place(), unread < to_wrap ? unread : to_wrap};
  }

  /// The first `count` bytes of `next` were read.
  void consumed(std::size_t count) {
    const Count written = written_.load(std::memory_order_acquire);  // pairs with `advance`
    if (written_over(written) != 0) overtaken_ += static_cast<Count>(count);
    pass(static_cast<Count>(count));
  }

  /// DMA begins at the ring's front, and no interrupt calls this ring until it has: what was not read is dropped.
  void begin_again() {
    dropped_ += seen_ - read_so_far();
    written_.store(seen_, std::memory_order_relaxed);
    read_.store(seen_, std::memory_order_relaxed);
    origin_.store(seen_, std::memory_order_relaxed);
  }

  /// All that `look` saw is given up: whole rings may have come uncounted.
  void drop_unread() {
    for (Span span = next(); span.size != 0; span = next()) {
      dropped_ += static_cast<Count>(span.size);
      pass(static_cast<Count>(span.size));
    }
    laps_unknown_ += 1;
  }

  ReceiveAccount account() const {
    ReceiveAccount account;
    account.received = seen_;
    account.handed_out = read_so_far() - lapped_ - dropped_;
    account.lapped = lapped_;
    account.laps = laps_;
    account.overtaken = overtaken_;
    account.dropped = dropped_;
    account.laps_unknown = laps_unknown_;
    return account;
  }

  /// Bytes that `look` saw and that were not read yet.
  std::size_t unread() const { return seen_ - read_so_far(); }

 private:
  Count size() const { return mask_ + 1; }
  Count read_so_far() const { return read_.load(std::memory_order_relaxed); }  // for the reader, who alone writes it
  void pass(Count count) { read_.store(read_so_far() + count, std::memory_order_release); }  // pairs with `is_all_read`
  Count ahead(std::size_t place, Count written) const {
    return (static_cast<Count>(place) + origin_.load(std::memory_order_relaxed) - written) & mask_;
  }

  /// How many bytes from `read_` on DMA wrote over until it came to `written`; then half a ring is kept.
  Count written_over(Count written) const {
    const Count unread = written - read_so_far();
    return unread > size() ? unread - size() / 2 : 0;
  }

  const std::uint8_t* bytes_;
  Count mask_;
  LoadStore<Count> written_{0};          ///< by the interrupt
  LoadStore<Count> origin_{0};           ///< the position that lies at the ring's front; by the interrupt
  LoadStore<std::uint8_t> restarts_{0};  ///< by the interrupt; odd: reception is being begun again
  LoadStore<Count> read_{0};             ///< by the reader
  Count seen_ = 0;
  Count lapped_ = 0;
  Count laps_ = 0;
  Count overtaken_ = 0;
  Count dropped_ = 0;
  Count laps_unknown_ = 0;
};

}  // namespace wirebond
