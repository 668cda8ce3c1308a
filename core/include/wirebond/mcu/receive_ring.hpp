// A circular buffer that DMA fills: how far DMA wrote, what was read, laps and restarts. Positions only: no frame, no
// port.
#pragma once

#include <atomic>
#include <cstddef>
#include <cstdint>

#include "wirebond/mcu/atomics.hpp"

namespace wirebond {

/// Account of the bytes that DMA wrote, modulo 2^32: received = handed out + lapped + dropped + unread.
struct ReceiveAccount {
  std::uint32_t received = 0;    ///< bytes that DMA wrote into the ring
  std::uint32_t handed_out = 0;  ///< given to the deframer
  std::uint32_t lapped = 0;      ///< overwritten before they were read
  std::uint32_t laps = 0;        ///< how often that happened
  std::uint32_t overtaken = 0;   ///< handed out, but overwritten while they were read: the ring is too small
  std::uint32_t dropped = 0;     ///< not read, because an unknown number of bytes may have come
  /// How often no poll came for as long as the ring takes to fill. Whole rings may have come then that `received` does
  /// not count; the rest of them is counted in `dropped`.
  std::uint32_t laps_unknown = 0;
};

/// The problem: DMA never waits for the reader. It writes on and overwrites unread bytes; after an error of the line it
/// is stopped and begins again at the ring's front. The hardware shows only a place in the ring, not how many bytes
/// came: the same place can mean no byte or a whole lap. And the UART's interrupt may come at any moment while the
/// reader works.
///
/// The answer: count. Positions count every byte since the start, modulo 2^32, so a reader that is more than a ring
/// late knows how many bytes were overwritten, skips them and reports them as lapped. DMA restarts only when all is
/// read, so it overwrites nothing; `origin_`, the position at the ring's front, is then set to the position reached.
/// While DMA restarts, its place means nothing: `restarts_` is odd, and `look` returns false. If an event or a restart
/// comes during a look, the look is repeated.
///
/// Two contexts: the UART's interrupt reports the writer (`advance`, `restart`); one other context reads (`look`,
/// `next`, `consumed`), and may be interrupted by it. Neither waits and nothing is masked: each variable has one
/// writer.
///
/// Danger: a lap is counted only if `advance` is called at least once per turn of the DMA. The half and full events do
/// that, unless interrupts are masked for as long as the whole ring takes. A caller with a clock must detect that and
/// call `drop_unread`.
class ReceiveRing {
 public:
  using Count = std::uint32_t;

  struct Span {
    const std::uint8_t* data;
    std::size_t size;  ///< 0: nothing to read
  };

  /// `size`: a power of two, in bytes. The memory must outlive this object.
  ReceiveRing(const std::uint8_t* bytes, std::size_t size) : bytes_(bytes), mask_(static_cast<Count>(size - 1)) {}

  // ---- the UART's interrupt

  /// Note that DMA writes at `place` next. Events may come in any order, merged or without news. Returns the position.
  Count advance(std::size_t place) {
    Count written = written_.load(std::memory_order_relaxed);  // only this context writes it
    written += ahead(place, written);
    written_.store(written, std::memory_order_release);  // pairs with `look`
    return written;
  }

  /// Check whether the reader has read all that DMA wrote until the last `advance`: DMA may begin again only then.
  bool is_all_read() const {
    return read_.load(std::memory_order_acquire) == written_.load(std::memory_order_relaxed);  // pairs with `pass`
  }

  /// Mark that DMA is about to begin again. Until `end_restart` its place means nothing and `look` returns false: the
  /// reader may have a higher priority than this interrupt, or run on another core.
  void begin_restart() {
    restarts_.store(static_cast<std::uint8_t>(restarts_.load(std::memory_order_relaxed) + 1),
                    std::memory_order_relaxed);
    std::atomic_thread_fence(std::memory_order_release);  // before the port's stores; pairs with `look`
  }
  void end_restart() {  // after the new place and `restart`; pairs with `look`
    restarts_.store(static_cast<std::uint8_t>(restarts_.load(std::memory_order_relaxed) + 1),
                    std::memory_order_release);
  }

  /// Note that DMA has begun again at the ring's front. Call it between `begin_restart` and `end_restart`, after
  /// `advance` with the last place and after all was read: no byte that the reader still uses changes its place.
  void restart() { origin_.store(written_.load(std::memory_order_relaxed), std::memory_order_relaxed); }

  // ---- the reader

  /// Note how far DMA is. `place()` returns where the port says that DMA writes next. Returns false if reception is
  /// being restarted: the position is unknown.
  template <class Place>
  bool look(Place&& place) {
    for (;;) {
      const std::uint8_t restarts = restarts_.load(std::memory_order_acquire);  // pairs with `end_restart`
      if ((restarts & 1u) != 0) return false;
      const Count written = written_.load(std::memory_order_acquire);  // pairs with `advance`
      const Count seen = written + ahead(place(), written);
      std::atomic_thread_fence(std::memory_order_acquire);  // after the place; pairs with `begin_restart`
      // An event came between the two loads: its place is newer, and reception may have restarted.
      if (restarts_.load(std::memory_order_relaxed) != restarts) continue;
      if (written_.load(std::memory_order_relaxed) != written) continue;
      seen_ = seen;
      return true;
    }
  }

  /// Position of the next byte that `next` gives, counted as `advance` counts.
  Count position() const { return read_so_far(); }
  /// The same as a place in the ring.
  Count place() const { return (read_so_far() - origin_.load(std::memory_order_relaxed)) & mask_; }

  /// Return the next bytes in one piece, as far as `look` saw; empty if all is read. Overwritten bytes are skipped and
  /// counted. After a lap only the newest half ring is kept, so that DMA does not reach the reader again at once.
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

  /// Mark the first `count` bytes of `next` as read.
  void consumed(std::size_t count) {
    const Count written = written_.load(std::memory_order_acquire);  // pairs with `advance`
    if (written_over(written) != 0) overtaken_ += static_cast<Count>(count);
    pass(static_cast<Count>(count));
  }

  /// Begin again at the ring's front, while no interrupt calls this ring. Unread bytes are dropped.
  void begin_again() {
    dropped_ += seen_ - read_so_far();
    written_.store(seen_, std::memory_order_relaxed);
    read_.store(seen_, std::memory_order_relaxed);
    origin_.store(seen_, std::memory_order_relaxed);
  }

  /// Drop all that `look` saw, because whole rings may have come uncounted.
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

  /// Bytes not read because the reader came too late.
  Count lost() const { return lapped_ + dropped_; }

  /// Bytes that `look` saw and that are not read yet.
  std::size_t unread() const { return seen_ - read_so_far(); }

 private:
  Count size() const { return mask_ + 1; }
  Count read_so_far() const { return read_.load(std::memory_order_relaxed); }  // for the reader, its only writer
  void pass(Count count) { read_.store(read_so_far() + count, std::memory_order_release); }  // pairs with `is_all_read`
  Count ahead(std::size_t place, Count written) const {
    return (static_cast<Count>(place) + origin_.load(std::memory_order_relaxed) - written) & mask_;
  }

  /// How many bytes after `read_` DMA had overwritten when it reached `written`; half a ring is kept then.
  Count written_over(Count written) const {
    const Count unread = written - read_so_far();
    return unread > size() ? unread - size() / 2 : 0;
  }

  const std::uint8_t* bytes_;
  Count mask_;
  LoadStore<Count> written_{0};          ///< written by the interrupt
  LoadStore<Count> origin_{0};           ///< the position at the ring's front; written by the interrupt
  LoadStore<std::uint8_t> restarts_{0};  ///< written by the interrupt; odd: reception is being restarted
  LoadStore<Count> read_{0};             ///< written by the reader
  Count seen_ = 0;
  Count lapped_ = 0;
  Count laps_ = 0;
  Count overtaken_ = 0;
  Count dropped_ = 0;
  Count laps_unknown_ = 0;
};

}  // namespace wirebond
