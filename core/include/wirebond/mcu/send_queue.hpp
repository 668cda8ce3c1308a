// A byte ring and a table of its frames: many senders, one consumer. Positions and states only: no byte of a frame is
// read or written here, and nothing is counted permanently.
#pragma once

#include <cstddef>
#include <cstdint>
#include <cstring>
#include <type_traits>

#include "wirebond/bytes.hpp"
#include "wirebond/mcu/atomics.hpp"
#include "wirebond/mcu/grant.hpp"

namespace wirebond {

/// Bytes for the line: `frames` whole frames, one after the other. `size` 0: there is nothing to send.
struct Run {
  std::uint8_t* data = nullptr;
  std::size_t size = 0;
  std::size_t frames = 0;
};

/// Every atomic operation of the queue that is more than relaxed, and the one it pairs with. If any of them is
/// weakened, the queue breaks; tests/concurrency/relacy_queue.cpp shows how.
struct SendQueueOrders {
  /// A sender opens its table entry: where its frame begins. Pairs with `looks`, for the end of the frame before it.
  static constexpr std::memory_order opens = std::memory_order_release;
  /// A sender closes its table entry: the frame's bytes and size. Pairs with `looks`, which passes them to DMA. As a
  /// sender closes one frame before it opens the next, a reader that sees the next also sees this one closed.
  static constexpr std::memory_order closes = std::memory_order_release;
  /// The consumer reads an entry. Pairs with `opens` and `closes`.
  static constexpr std::memory_order looks = std::memory_order_acquire;
  /// The consumer frees bytes and entries that it no longer uses. Pairs with `finds`.
  static constexpr std::memory_order frees = std::memory_order_release;
  /// A sender finds free bytes, and may write there. Pairs with `frees`.
  static constexpr std::memory_order finds = std::memory_order_acquire;
  /// A sender gives back bytes that its frame did not need, and may have written to. Pairs with `takes`.
  static constexpr std::memory_order gives_back = std::memory_order_release;
  /// A sender takes bytes that another one may have given back. Pairs with `gives_back`.
  static constexpr std::memory_order takes = std::memory_order_acquire;
};

/// Passes frames from any number of senders (tasks, interrupts, threads) to one consumer, which passes them to DMA.
///
/// The problem: a sender may be interrupted or suspended at any moment, even for seconds, by another sender. A lock
/// would let a task block an interrupt; a queue that waits for the oldest frame would let a suspended task silence the
/// link.
///
/// **Sender.** `reserve` takes bytes and a table entry in one atomic change of one word; the frame is written at the
/// place from which it will be sent; the grant's `commit` closes the entry. No sender ever waits for another one: one
/// that is interrupted or suspended between reserve and commit delays only its own frame.
///
/// **Consumer.** `next` returns a run of finished frames, `sent` or `aborted` ends it. Frames of one sender leave in
/// the order in which it reserved them. Frames of others may pass an unfinished one.
///
/// **Memory.** A frame is contiguous; if it does not fit before the end of the ring, the rest of the ring is skipped
/// and belongs to the frame after it. Memory is reused in the order in which it was taken: frames after an unfinished
/// one leave, but their memory waits until that one is finished (`Refusal::held`). So size the ring for the frames that
/// wait for the line, and for the bytes that others send while the sender of the lowest priority is pre-empted.
///
/// The consumer's functions belong to one context; all others may be called from any. No call blocks or allocates.
/// Costs: reserve and commit take a constant number of steps, reserve again for each sender that came in between;
/// `next` and a refusal read each entry in use once, `next` again for each unfinished frame that was closed in between.
template <class Atomics = DefaultAtomics, class Orders = SendQueueOrders>
class SendQueue {
 public:
  using Position = typename Atomics::Position;

  /// One frame's entry in the table.
  class Entry {
    friend class SendQueue;
    typename Atomics::template Atomic<typename Atomics::Word> place_{};  // start and number of its bytes
    typename Atomics::template Atomic<std::uint32_t> state_{};           // State, tag << 8, stamp << 16
  };

  /// Data of a grant about its frame.
  struct Ticket {
    std::uint8_t* data;
    Position size;
    Position begin;       // free-running position of its first byte
    Position number;      // free-running number of its entry
    std::uint32_t label;  // tag and stamp, as in the entry
  };

  /// `capacity` bytes at `ring`, which DMA can reach, and `entry_count` entries: powers of two, at most half of what a
  /// Position can count. The caller owns both, and they must outlive the queue.
  SendQueue(std::uint8_t* ring, std::size_t capacity, Entry* entries, std::size_t entry_count)
      : ring_(ring),
        entries_(entries),
        byte_mask_(static_cast<Position>(capacity - 1)),
        entry_mask_(static_cast<Position>(entry_count - 1)) {}
  SendQueue(const SendQueue&) = delete;  // grants point to it
  SendQueue& operator=(const SendQueue&) = delete;

  static constexpr std::size_t max_capacity = (static_cast<std::size_t>(static_cast<Position>(~Position{0})) >> 1) + 1;
  static constexpr bool is_capacity(std::size_t size) {
    return size >= 2 && size <= max_capacity && (size & (size - 1)) == 0;
  }

  /// Maximum size of a frame: half the ring, so that a frame fits into an empty ring wherever that begins.
  std::size_t largest_frame() const { return (std::size_t{byte_mask_} + 1) / 2; }

  // ---- senders: any context -----------------------------------------------------------------------------------------

  /// Reserve memory for a frame of at most `size` bytes. `tag` and `stamp` are returned with it; a stamp is a time
  /// modulo 2^16, for `expire`. On refusal nothing has changed.
  Grant<SendQueue> reserve(std::size_t size, std::uint8_t tag = 0, std::uint16_t stamp = 0) {
    Ticket ticket;
    const Refusal refusal = take(size, tag, stamp, ticket);
    return refusal == Refusal::none ? Grant<SendQueue>(*this, ticket) : Grant<SendQueue>(refusal);
  }

  /// Do the same as `reserve`, for owners with their own grants.
  WIREBOND_QUICK Refusal take(std::size_t size, std::uint8_t tag, std::uint16_t stamp, Ticket& ticket) {
    if (size == 0 || size > largest_frame()) return Refusal::full;
    for (;;) {
      Word seen{};
      const bool taken = Atomics::update(head_, Orders::takes, [&](Word& head) {
        seen = head;
        const Word tail = tail_.load(Orders::finds);
        const Position used = distance(position_of(tail), position_of(head));
        const Position offset = position_of(head) & byte_mask_;
        const Position to_end = static_cast<Position>(byte_mask_ - offset + 1);
        const Position skipped = size > to_end ? to_end : Position{0};
        // If the tail has overtaken the loaded `head`, both differences are huge: this fails, and is repeated with the
        // new one.
        if (used > byte_mask_ + 1u || skipped + size > byte_mask_ + 1u - used) return false;
        if (distance(number_of(tail), number_of(head)) > entry_mask_) return false;
        ticket.begin = static_cast<Position>(position_of(head) + skipped);
        head = word_of(static_cast<Position>(ticket.begin + size), static_cast<Position>(number_of(head) + 1));
        return true;
      });
      if (taken) {
        ticket.number = number_of(seen);
        break;
      }
      if (head_.load(std::memory_order_relaxed) == seen) return why_full(number_of(seen));
    }
    ticket.size = static_cast<Position>(size);
    ticket.data = ring_ + (ticket.begin & byte_mask_);
    ticket.label = static_cast<std::uint32_t>(tag) << 8 | static_cast<std::uint32_t>(stamp) << 16;
    Entry& entry = entry_of(ticket.number);
    entry.place_.store(word_of(ticket.begin, ticket.size), std::memory_order_relaxed);
    entry.state_.store(ticket.label | open, Orders::opens);
    return Refusal::none;
  }

  /// Commit the first `used` bytes, 1 .. ticket.size, as the frame. From now on the consumer owns it.
  WIREBOND_QUICK void commit(const Ticket& ticket, std::size_t used) {
    close(ticket, static_cast<Position>(used), ready);
  }

  /// End without a frame. Its memory is free once the consumer has read the entry.
  void abandon(const Ticket& ticket, Refusal) { close(ticket, 0, gone); }

  // ---- the consumer: one context ------------------------------------------------------------------------------------

  /// Return the next finished frames that follow each other: as many as fit in `max_bytes`, and in any case the first.
  /// The consumer owns them until `sent` or `aborted`; until then every call returns the same run, so that it can be
  /// offered again to a port that refused it. `finish(data, size, tag)` is called once for each frame, in the order of
  /// the wire, before the run is returned: here a frame gets its sequence number. If it returns a size, 1 .. size, that
  /// is the frame's new one; later frames of the run move up. `passes` false: no frame passes an unfinished one.
  template <class Finish>
  Run next(std::size_t max_bytes, bool passes, Finish&& finish) {
    if (run_frames_ == 0 && !choose_run(max_bytes, passes)) return {};
    Run run{ring_ + (begin_of(run_first_) & byte_mask_), 0, run_frames_};
    for (Position i = 0; i < run_frames_; ++i) {
      Entry& entry = entry_of(static_cast<Position>(run_first_ + i));
      std::size_t size = size_in(entry.place_.load(std::memory_order_relaxed));
      if (!run_finished_) size = finish_in(entry, run.data + run.size, size, finish);
      run.size += size;
    }
    run_finished_ = true;
    return run;
  }
  Run next(std::size_t max_bytes) {
    return next(max_bytes, true, [](std::uint8_t*, std::size_t, std::uint8_t) {});
  }

  /// End the run, which has left or was stopped: its frames are gone. `visit(tag)` is called for each of them.
  template <class Visit>
  void end_run(Visit&& visit) {
    for (; run_frames_ != 0; --run_frames_, ++run_first_) dismiss(entry_of(run_first_), visit);
    free_room();
  }
  void end_run() {
    end_run([](std::uint8_t) {});
  }

  /// Remove finished frames for which `is_old(stamp)` is true, except a run that is being sent. `visit(tag)` is called
  /// for each of them.
  template <class IsOld, class Visit>
  void expire(IsOld&& is_old, Visit&& visit) {
    for_each([&](Position number, Entry& entry) {
      const std::uint32_t state = entry.state_.load(Orders::looks);
      if (kind_of(state) != ready || is_in_run(number) || !is_old(stamp_in(state))) return;
      dismiss(entry, visit);
    });
    free_room();
  }

  /// Check whether a run is being sent, from `next` to `end_run`.
  bool is_sending() const { return run_frames_ != 0; }

  // ---- state of the table: any context ------------------------------------------------------------------------------
  // Exact while no sender is inside a call.

  /// Count the frames that are finished and have not left, including a run that is being sent. `is_counted(tag)`
  /// selects.
  template <class IsCounted>
  std::size_t finished(IsCounted&& is_counted) const {
    return count([&](std::uint32_t state) { return kind_of(state) == ready && is_counted(tag_in(state)); });
  }
  std::size_t finished() const {
    return finished([](std::uint8_t) { return true; });
  }

  /// Count the frames between reserve and commit.
  template <class IsCounted>
  std::size_t unfinished(IsCounted&& is_counted) const {
    return count([&](std::uint32_t state) { return kind_of(state) == open && is_counted(tag_in(state)); });
  }
  std::size_t unfinished() const {
    return unfinished([](std::uint8_t) { return true; });
  }

  /// Bytes of the ring and entries of the table that are not free.
  std::size_t used_bytes() const { return distance(position_of(load(tail_)), position_of(load(head_))); }
  std::size_t used_entries() const { return distance(number_of(load(tail_)), number_of(load(head_))); }

  /// Their maximum whenever the consumer freed some, or now.
  std::size_t peak_bytes() const { return larger(position_of(load(peak_)), used_bytes()); }
  std::size_t peak_entries() const { return larger(number_of(load(peak_)), used_entries()); }

 private:
  using Word = typename Atomics::Word;
  template <class T>
  using Atomic = typename Atomics::template Atomic<T>;

  // A table entry's life. Senders write `open`, then `ready` or `gone`; the consumer the others.
  enum State : std::uint8_t {
    vacant,  // free; or its sender has taken it but not yet written where its frame begins
    open,    // the sender writes
    ready,   // finished, waits for the line or is being sent
    gone,    // has left, or never came: its memory is free once all frames before it are gone
  };

  static constexpr unsigned position_bits = 8 * sizeof(Position);
  static Position position_of(Word word) { return static_cast<Position>(word); }
  static Position number_of(Word word) { return static_cast<Position>(word >> position_bits); }
  static Position size_in(Word place) { return static_cast<Position>(place >> position_bits); }
  static Word word_of(Position low, Position high) { return low | static_cast<Word>(high) << position_bits; }
  static std::size_t larger(std::size_t a, std::size_t b) { return a < b ? b : a; }
  static Position distance(Position from, Position to) { return static_cast<Position>(to - from); }

  static State kind_of(std::uint32_t state) { return static_cast<State>(state & 0xFFu); }
  static std::uint8_t tag_in(std::uint32_t state) { return static_cast<std::uint8_t>(state >> 8); }
  static std::uint16_t stamp_in(std::uint32_t state) { return static_cast<std::uint16_t>(state >> 16); }

  static Word load(const Atomic<Word>& word) { return word.load(std::memory_order_relaxed); }
  Entry& entry_of(Position number) const { return entries_[number & entry_mask_]; }
  Position begin_of(Position number) const { return position_of(load(entry_of(number).place_)); }
  bool is_in_run(Position number) const { return distance(run_first_, number) < run_frames_; }

  template <class Visit>
  void for_each(Visit&& visit) const {
    const Position end = number_of(load(head_));
    for (Position number = number_of(load(tail_)); number != end; ++number) visit(number, entry_of(number));
  }

  template <class IsCounted>
  std::size_t count(IsCounted&& is_counted) const {
    std::size_t counted = 0;
    for_each([&](Position, Entry& entry) { counted += is_counted(entry.state_.load(std::memory_order_relaxed)); });
    return counted;
  }

  /// Return why there was no memory while the head was at number `end`: whether a frame has left after an unfinished
  /// one.
  Refusal why_full(Position end) const {
    bool unfinished = false;
    for (Position number = number_of(load(tail_)); distance(number, end) - 1u <= entry_mask_; ++number) {
      const State state = kind_of(entry_of(number).state_.load(std::memory_order_relaxed));
      if (state == gone && unfinished) return Refusal::held;
      unfinished = unfinished || state == open || state == vacant;
    }
    return Refusal::full;
  }

  WIREBOND_QUICK void close(const Ticket& ticket, Position used, State state) {
    if (used < ticket.size) {  // the last one to take memory gives the rest back; otherwise it stays with this frame
      const Word end =
          word_of(static_cast<Position>(ticket.begin + ticket.size), static_cast<Position>(ticket.number + 1));
      Atomics::update(head_, Orders::gives_back, [&](Word& head) {
        if (head != end) return false;
        head = word_of(static_cast<Position>(ticket.begin + used), number_of(end));
        return true;
      });
    }
    Entry& entry = entry_of(ticket.number);
    entry.place_.store(word_of(ticket.begin, used), std::memory_order_relaxed);
    entry.state_.store(ticket.label | state, Orders::closes);
  }

  State look_at(Position number) const { return kind_of(entry_of(number).state_.load(Orders::looks)); }

  /// Set run_first_ and run_frames_. Returns false if there is nothing to send.
  bool choose_run(std::size_t max_bytes, bool passes) {
    free_room();  // of abandoned frames
    const Position tail = number_of(load(tail_));
    const Position end = number_of(load(head_));
    Position first = tail;
    for (State state = vacant; first != end; ++first) {
      state = look_at(first);
      if (state == ready) break;
      if (!passes && state != gone) return false;
    }
    if (first == end) return false;
    // A sender whose unfinished frame was passed may have finished it and then one that is in the run, so all passed
    // frames are checked again after the run's last frame was read. Each round, the run begins earlier.
    for (;;) {
      run_first_ = first;
      run_frames_ = ready_frames(first, end, max_bytes);
      Position passed = tail;
      while (passed != first && look_at(passed) != ready) ++passed;
      if (passed == first) break;
      first = passed;
    }
    run_finished_ = false;
    return true;
  }

  /// Finish the frame of this entry, which moves to `to`: its own place, or nearer to the start of the run. Returns its
  /// size.
  template <class Finish>
  WIREBOND_INLINE std::size_t finish_in(Entry& entry, std::uint8_t* to, std::size_t size, Finish&& finish) {
    const std::uint8_t tag = tag_in(entry.state_.load(std::memory_order_relaxed));
    if constexpr (std::is_void_v<decltype(finish(to, size, tag))>) {
      finish(to, size, tag);
      return size;
    } else {
      const Position begin = position_of(load(entry.place_));
      std::uint8_t* const frame = ring_ + (begin & byte_mask_);
      const std::size_t finished = finish(frame, size, tag);
      if (frame != to) std::memmove(to, frame, finished);
      entry.place_.store(word_of(begin, static_cast<Position>(finished)), std::memory_order_relaxed);
      return finished;
    }
  }

  /// Count the frames from `first` on that are finished, follow each other, and fit in `max_bytes`: at least one.
  Position ready_frames(Position first, Position end, std::size_t max_bytes) const {
    Word place = load(entry_of(first).place_);
    std::size_t bytes = size_in(place);
    Position frames = 1;
    for (; distance(first, end) != frames; ++frames) {
      const Position number = static_cast<Position>(first + frames);
      if (look_at(number) != ready) break;
      const Position behind = static_cast<Position>(position_of(place) + size_in(place));
      place = load(entry_of(number).place_);
      bytes += size_in(place);
      if (position_of(place) != behind || (behind & byte_mask_) == 0 || bytes > max_bytes) break;
    }
    return frames;
  }

  template <class Visit>
  static void dismiss(Entry& entry, Visit&& visit) {
    const std::uint32_t state = entry.state_.load(std::memory_order_relaxed);
    visit(tag_in(state));
    entry.state_.store((state & ~0xFFu) | gone, std::memory_order_relaxed);
  }

  /// Free gone frames, up to the first that is not gone. A frame's memory ends where that of the next one begins.
  void free_room() {
    const Word before = load(tail_);
    Position position = position_of(before);
    Position number = number_of(before);
    Word head = load(head_);
    note_peak(distance(position, position_of(head)), distance(number, number_of(head)));
    while (number != number_of(head) && look_at(number) == gone) {
      head = load(head_);  // after look_at: before its sender closed the frame it may have moved the head back
      const Position following = static_cast<Position>(number + 1);
      if (following == number_of(head)) {
        position = position_of(head);
      } else if (look_at(following) != vacant) {
        position = begin_of(following);
      } else {
        break;  // its sender has not yet written where it begins
      }
      entry_of(number).state_.store(vacant, std::memory_order_relaxed);
      number = following;
    }
    if (number != number_of(before)) tail_.store(word_of(position, number), Orders::frees);
  }

  /// Only the consumer frees memory, so the maximum in use is reached just before it frees.
  void note_peak(Position bytes, Position entries) {
    const Word peak = load(peak_);
    if (bytes <= position_of(peak) && entries <= number_of(peak)) return;
    peak_.store(word_of(bytes > position_of(peak) ? bytes : position_of(peak),
                        entries > number_of(peak) ? entries : number_of(peak)),
                std::memory_order_relaxed);
  }

  std::uint8_t* ring_;
  Entry* entries_;
  Position byte_mask_;
  Position entry_mask_;
  Atomic<Word> head_{};  // where the next frame begins, and its number; senders move it
  Atomic<Word> tail_{};  // where the oldest frame not freed begins, and its number; the consumer moves it
  Atomic<Word> peak_{};  // maximum of bytes and entries in use; written by the consumer
  // The consumer's own:
  Position run_first_ = 0;
  Position run_frames_ = 0;
  bool run_finished_ = false;
};

}  // namespace wirebond
