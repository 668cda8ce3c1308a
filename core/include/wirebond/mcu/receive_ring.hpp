// A circular buffer that DMA fills: how far it came, what was read, laps and restarts. Positions only: no frame, no
// port.
#pragma once

#include <array>
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
/// Positions count every byte since the start, modulo 2^32; the low bits are the place in the ring, whose size is a
/// power of two. A restarted DMA writes from the ring's front again, so the count then skips to the next multiple of
/// the size: a hole, in which no byte ever was.
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

  /// Has the reader read all that DMA wrote until the last `advance`?
  bool is_all_read() const {
    return read_.load(std::memory_order_acquire) == written_.load(std::memory_order_relaxed);  // pairs with `pass`
  }

  /// May DMA be begun again? Not while the reader is so many restarts behind that one more could not be noted.
  bool can_restart() const {
    // Pairs with `pass_hole`: what the reader passed may be written again.
    const std::uint8_t passed = holes_passed_.load(std::memory_order_acquire);
    return static_cast<std::uint8_t>(holes_noted_.load(std::memory_order_relaxed) - passed) != hole_capacity;
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
  /// called with its last place, and `can_restart` was true.
  void restart() {
    const Count written = written_.load(std::memory_order_relaxed);
    const Count front = round_up(written);
    if (front == written) return;
    const std::uint8_t noted = holes_noted_.load(std::memory_order_relaxed);
    holes_[noted % hole_capacity] = written;
    holes_noted_.store(static_cast<std::uint8_t>(noted + 1), std::memory_order_release);  // pairs with `hole_ahead`
    written_.store(front, std::memory_order_release);  // behind the hole, so that who sees this sees that
  }

  // ---- the reader

  /// Note how far DMA is. `place()` tells where it writes next, as the port says it. False: reception is being begun
  /// again just now, and nothing can be said.
  template <class Place>
  bool look(Place&& place) {
    for (;;) {
      const std::uint8_t restarts = restarts_.load(std::memory_order_acquire);  // pairs with `end_restart`
      if ((restarts & 1u) != 0) return false;
      const Count written = written_.load(std::memory_order_acquire);  // pairs with `advance` and `restart`
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

  /// The next bytes in one piece, as far as `look` saw; none: all is read. Bytes that DMA wrote over are left out, and
  /// counted. After a lap half a ring of the newest is kept, so that the DMA is not met again at once.
  Span next() {
    bool lapped = false;
    for (;;) {
      while (hole_ahead() && next_hole() == read_so_far()) pass_hole();
      const Count size = piece();
      const Count lost = size == 0 ? 0 : written_over(seen_, size);
      if (lost == 0) {
        if (lapped) laps_ += 1;
        return {bytes_ + (read_so_far() & mask_), size};
      }
      lapped = true;
      lapped_ += lost;
      pass(lost);
    }
  }

  /// The first `count` bytes of `next` were read.
  void consumed(std::size_t count) {
    const Count written = written_.load(std::memory_order_acquire);  // pairs with `advance` and `restart`
    if (written_over(written, static_cast<Count>(count)) != 0) overtaken_ += static_cast<Count>(count);
    pass(static_cast<Count>(count));
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
    account.received = seen_ - hole_bytes_ - holes_before(seen_);
    account.handed_out = read_so_far() - hole_bytes_ - lapped_ - dropped_;
    account.lapped = lapped_;
    account.laps = laps_;
    account.overtaken = overtaken_;
    account.dropped = dropped_;
    account.laps_unknown = laps_unknown_;
    return account;
  }

  /// Bytes that `look` saw and that were not read yet.
  std::size_t unread() const { return seen_ - read_so_far() - holes_before(seen_); }

 private:
  static constexpr std::uint8_t hole_capacity = 4;  // restarts between two reads

  Count size() const { return mask_ + 1; }
  Count read_so_far() const { return read_.load(std::memory_order_relaxed); }  // for the reader, who alone writes it
  void pass(Count count) { read_.store(read_so_far() + count, std::memory_order_release); }  // pairs with `is_all_read`
  Count round_up(Count position) const { return (position + mask_) & ~mask_; }
  Count ahead(std::size_t place, Count written) const { return (static_cast<Count>(place) - written) & mask_; }

  /// Is there a hole that the reader has yet to pass, within what it saw?
  bool hole_ahead() const {
    const std::uint8_t noted = holes_noted_.load(std::memory_order_acquire);  // pairs with `restart`
    const Count read = read_so_far();
    return noted != holes_passed_.load(std::memory_order_relaxed) && next_hole() - read < seen_ - read;
  }

  Count next_hole() const { return holes_[holes_passed_.load(std::memory_order_relaxed) % hole_capacity]; }

  void pass_hole() {
    const Count length = round_up(next_hole()) - next_hole();
    hole_bytes_ += length;
    pass(length);
    const std::uint8_t passed = holes_passed_.load(std::memory_order_relaxed);
    holes_passed_.store(static_cast<std::uint8_t>(passed + 1), std::memory_order_release);  // pairs with `restart`
  }

  /// Holes that are noted, within what was seen and not passed.
  Count holes_before(Count limit) const {
    const Count read = read_so_far();
    const std::uint8_t noted = holes_noted_.load(std::memory_order_acquire);  // pairs with `restart`
    Count bytes = 0;
    for (std::uint8_t i = holes_passed_.load(std::memory_order_relaxed); i != noted; ++i) {
      const Count begin = holes_[i % hole_capacity];
      if (begin - read < limit - read) bytes += round_up(begin) - begin;
    }
    return bytes;
  }

  /// Bytes from `read_` on that lie in one piece and were seen.
  Count piece() const {
    const Count read = read_so_far();
    Count end = read + size() - (read & mask_);
    if (hole_ahead() && next_hole() - read < end - read) end = next_hole();
    return (seen_ - read < end - read ? seen_ : end) - read;
  }

  /// How many bytes from `read_` on, of which `piece` lie in one piece, DMA wrote over until it came to `written`.
  Count written_over(Count written, Count piece) const {
    const Count read = read_so_far();
    const std::uint8_t noted = holes_noted_.load(std::memory_order_acquire);  // pairs with `restart`
    std::uint8_t hole = holes_passed_.load(std::memory_order_relaxed);
    const bool is_ended = hole != noted && holes_[hole % hole_capacity] - read < written - read;
    const Count end = is_ended ? holes_[hole % hole_capacity] : written;
    if (end - read > size()) return end - read - size() / 2;
    // What began again at the ring's front since: the longest of these went over all places below its length.
    Count longest = 0;
    for (Count from = round_up(end); hole != noted && from - read < written - read; ++hole) {
      const std::uint8_t following = static_cast<std::uint8_t>(hole + 1);
      const bool is_last = following == noted || holes_[following % hole_capacity] - read >= written - read;
      const Count to = is_last ? written : holes_[following % hole_capacity];
      if (to - from > longest) longest = to - from;
      from = round_up(to);
    }
    const Count place = read & mask_;
    if (place >= longest) return 0;
    return longest - place < piece ? longest - place : piece;
  }

  const std::uint8_t* bytes_;
  Count mask_;
  LoadStore<Count> written_{0};               ///< by the interrupt
  std::array<Count, hole_capacity> holes_{};  ///< where holes begin; by the interrupt
  LoadStore<std::uint8_t> holes_noted_{0};    ///< by the interrupt
  LoadStore<std::uint8_t> holes_passed_{0};   ///< by the reader
  LoadStore<std::uint8_t> restarts_{0};       ///< by the interrupt; odd: reception is being begun again
  LoadStore<Count> read_{0};                  ///< by the reader
  Count seen_ = 0;
  Count hole_bytes_ = 0;  ///< in the holes that were passed
  Count lapped_ = 0;
  Count laps_ = 0;
  Count overtaken_ = 0;
  Count dropped_ = 0;
  Count laps_unknown_ = 0;
};

}  // namespace wirebond
