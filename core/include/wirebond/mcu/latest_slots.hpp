// Messages of which only the newest counts: a slot each, outside the ring. Cells and their states only: no byte of a
// frame is read or written here, and nothing is counted for good.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>

#include "wirebond/mcu/atomics.hpp"
#include "wirebond/mcu/grant.hpp"
#include "wirebond/mcu/send_queue.hpp"

namespace wirebond {

/// Every atomic operation of the slots that is more than relaxed, and the one that it pairs with.
struct LatestSlotsOrders {
  /// A writer takes a cell that nobody uses. With `frees`, and with `commits` of the frame that was replaced there.
  static constexpr std::memory_order takes = std::memory_order_acquire;
  /// A writer publishes its cell: the frame's bytes and size. With `sends`, and with `takes` once it is replaced.
  static constexpr std::memory_order commits = std::memory_order_release;
  /// A writer gives its cell back, and may have written to it. With `takes`.
  static constexpr std::memory_order abandons = std::memory_order_release;
  /// The consumer takes the newest frame. With `commits`.
  static constexpr std::memory_order sends = std::memory_order_acquire;
  /// The consumer is done with a cell's bytes. With `takes`.
  static constexpr std::memory_order frees = std::memory_order_release;
};

/// One slot for each of `CellBytes...`: the largest frame of its message. A slot has `CellCount` cells of that size:
/// one that DMA reads, one that waits, and one for each sender that may write this message at the same time. Any number
/// of senders in any context, one consumer. A later commit wins, whoever reserved first; a frame is never changed while
/// DMA may read it. No call blocks or allocates; each is a constant number of steps, done again for each context that
/// changed the same slot meanwhile.
template <class Atomics, std::size_t CellCount, class Orders, std::size_t... CellBytes>
class BasicLatestSlots {
  static_assert(CellCount >= 3 && CellCount <= 8,
                "a slot has 3 to 8 cells: one sent, one waiting, one for each writer");

 public:
  static constexpr std::size_t slot_count = sizeof...(CellBytes);
  static constexpr std::size_t memory_bytes = CellCount * (CellBytes + ... + 0);

  struct Ticket {
    std::uint8_t* data;
    std::uint16_t size;
    std::uint16_t stamp;
    std::uint8_t slot;
    std::uint8_t cell;
  };

  /// `memory`: memory_bytes that DMA can reach; they stay the caller's.
  explicit BasicLatestSlots(std::uint8_t* memory) : memory_(memory) {}
  BasicLatestSlots(const BasicLatestSlots&) = delete;  // grants point to it
  BasicLatestSlots& operator=(const BasicLatestSlots&) = delete;

  // ---- senders: any context -----------------------------------------------------------------------------------------

  /// Room for a frame in this slot. `full`: larger than its cells; `held`: all cells are being written.
  Refusal take(std::size_t slot, std::size_t size, std::uint16_t stamp, Ticket& ticket) {
    if (size == 0 || size > cell_bytes[slot]) return Refusal::full;
    unsigned cell = 0;
    const bool taken = Atomics::update(entries_[slot].control, Orders::takes, [&](std::uint32_t& control) {
      const std::uint32_t used = writing_in(control) | bit_of(waiting_in(control)) | bit_of(sending_in(control));
      for (cell = 0; cell < CellCount; ++cell) {
        if ((used >> cell & 1u) == 0) break;
      }
      control |= 1u << cell;
      return cell < CellCount;
    });
    if (!taken) return Refusal::held;
    ticket = {cell_at(slot, cell), static_cast<std::uint16_t>(size), stamp, static_cast<std::uint8_t>(slot),
              static_cast<std::uint8_t>(cell)};
    return Refusal::none;
  }

  /// The slot's frame is the first `used` bytes. True: it replaced one that had not been sent.
  bool commit(const Ticket& ticket, std::size_t used) {
    Entry& entry = entries_[ticket.slot];
    entry.sizes[ticket.cell] = static_cast<std::uint16_t>(used);
    bool replaced = false;
    Atomics::update(entry.control, Orders::commits, [&](std::uint32_t& control) {
      replaced = waiting_in(control) != nothing;
      control = make(writing_in(control) & ~(1u << ticket.cell), ticket.cell, sending_in(control), ticket.stamp);
      return true;
    });
    return replaced;
  }

  void abandon(const Ticket& ticket) {
    Atomics::update(entries_[ticket.slot].control, Orders::abandons, [&](std::uint32_t& control) {
      control &= ~(1u << ticket.cell);
      return true;
    });
  }

  // ---- the consumer: one context ------------------------------------------------------------------------------------

  /// The frame that waits in this slot; it is the consumer's until `end_run`. Of size 0: none waits.
  /// One frame of a slot is sent at a time.
  Run next(std::size_t slot) {
    Entry& entry = entries_[slot];
    unsigned cell = nothing;
    const bool taken = Atomics::update(entry.control, Orders::sends, [&](std::uint32_t& control) {
      cell = waiting_in(control);
      if (cell == nothing) return false;
      control = make(writing_in(control), nothing, cell, 0);
      return true;
    });
    if (!taken) return {};
    return {cell_at(slot, cell), entry.sizes[cell], 1};
  }

  void end_run(std::size_t slot) {
    Atomics::update(entries_[slot].control, Orders::frees, [](std::uint32_t& control) {
      control = make(writing_in(control), waiting_in(control), nothing, stamp_in(control));
      return true;
    });
  }

  /// Drop the frame that waits in this slot if `is_old(stamp)`. True: it was dropped.
  template <class IsOld>
  bool expire(std::size_t slot, IsOld&& is_old) {
    return Atomics::update(entries_[slot].control, Orders::frees, [&](std::uint32_t& control) {
      if (waiting_in(control) == nothing || !is_old(stamp_in(control))) return false;
      control = make(writing_in(control), nothing, sending_in(control), 0);
      return true;
    });
  }

  // ---- any context --------------------------------------------------------------------------------------------------

  /// Frames of this slot that are finished and have not left: 0 to 2, one that is under way among them.
  std::size_t finished(std::size_t slot) const {
    const std::uint32_t control = entries_[slot].control.load(std::memory_order_relaxed);
    return std::size_t{waiting_in(control) != nothing} + std::size_t{sending_in(control) != nothing};
  }

  /// Frames of this slot between reserve and commit.
  std::size_t unfinished(std::size_t slot) const {
    std::size_t count = 0;
    for (std::uint32_t bits = writing_in(entries_[slot].control.load(std::memory_order_relaxed)); bits != 0;
         bits >>= 1) {
      count += bits & 1u;
    }
    return count;
  }

 private:
  // All that is known of a slot is in one word, so that a change sees all of it: a bit for each cell that is being
  // written, the cell that waits, the cell that is sent, and when the waiting one was reserved.
  static constexpr unsigned nothing = 0xF;
  static constexpr std::uint32_t make(std::uint32_t writing, unsigned waiting, unsigned sending, std::uint16_t stamp) {
    return writing | waiting << 8 | sending << 12 | static_cast<std::uint32_t>(stamp) << 16;
  }
  static constexpr std::uint32_t writing_in(std::uint32_t control) { return control & 0xFFu; }
  static constexpr unsigned waiting_in(std::uint32_t control) { return control >> 8 & 0xFu; }
  static constexpr unsigned sending_in(std::uint32_t control) { return control >> 12 & 0xFu; }
  static constexpr std::uint16_t stamp_in(std::uint32_t control) { return static_cast<std::uint16_t>(control >> 16); }
  static constexpr std::uint32_t bit_of(unsigned cell) { return cell == nothing ? 0 : 1u << cell; }

  struct Entry {
    typename Atomics::template Atomic<std::uint32_t> control{make(0, nothing, nothing, 0)};
    std::array<std::uint16_t, CellCount> sizes{};  // whoever owns the cell owns its size
  };

  static constexpr std::array<std::uint16_t, slot_count> cell_bytes{CellBytes...};

  std::uint8_t* cell_at(std::size_t slot, unsigned cell) const {
    std::size_t before = 0;
    for (std::size_t i = 0; i < slot; ++i) before += CellCount * cell_bytes[i];
    return memory_ + before + cell * cell_bytes[slot];
  }

  std::uint8_t* memory_;
  std::array<Entry, slot_count> entries_;
};

template <class Atomics, std::size_t CellCount, std::size_t... CellBytes>
using LatestSlots = BasicLatestSlots<Atomics, CellCount, LatestSlotsOrders, CellBytes...>;

}  // namespace wirebond
