// Messages of which only the newest counts: a slot for each, outside the ring. Cells and their states only: no byte of
// a frame is read or written here, and nothing is counted permanently.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>

#include "wirebond/mcu/atomics.hpp"
#include "wirebond/mcu/grant.hpp"
#include "wirebond/mcu/send_queue.hpp"

namespace wirebond {

/// Every atomic operation of the slots that is more than relaxed, and the one it pairs with.
struct LatestSlotsOrders {
  /// A writer takes an unused cell. Pairs with `frees`, and with `commits` of the frame that was replaced there.
  static constexpr std::memory_order takes = std::memory_order_acquire;
  /// A writer publishes its cell: the frame's bytes and size. Pairs with `sends`, and with `takes` once it is replaced.
  static constexpr std::memory_order commits = std::memory_order_release;
  /// A writer gives its cell back, and may have written to it. Pairs with `takes`.
  static constexpr std::memory_order abandons = std::memory_order_release;
  /// The consumer takes the newest frame. Pairs with `commits`.
  static constexpr std::memory_order sends = std::memory_order_acquire;
  /// The consumer has finished with a cell's bytes. Pairs with `takes`.
  static constexpr std::memory_order frees = std::memory_order_release;
};

/// One slot for each of `CellBytes...`: the size of its message's largest frame. A slot has `CellCount` cells of that
/// size: one that DMA reads, one that waits, and one for each sender that may write this message at the same time (one
/// for each priority that sends it). Any number of senders in any context, one consumer. No call blocks or allocates;
/// each takes a constant number of steps, repeated for each context that changes the same slot at the same time.
///
/// **The newest value is the one whose sender began last.** A sender that was interrupted by another one and commits
/// after it is older: its frame is dropped and counts as replaced, even if the newer one has left already. So no value
/// follows a newer one on the wire.
///
/// **The newest value is not refused because of an older one.** If no cell is free, a sender takes the cell of the
/// waiting frame, which counts as replaced. It is refused (`held`) only if unfinished senders have all cells except the
/// one that DMA reads: at least `CellCount - 1` at the same time.
///
/// A frame is never changed while DMA may read it.
template <class Atomics, std::size_t CellCount, class Orders, std::size_t... CellBytes>
class BasicLatestSlots {
  static_assert(CellCount >= 3 && CellCount <= 6,
                "a slot has 3 to 6 cells: one sent, one waiting, one for each writer");

 public:
  static constexpr std::size_t slot_count = sizeof...(CellBytes);
  static constexpr std::size_t memory_bytes = CellCount * (CellBytes + ... + 0);

  struct Ticket {
    std::uint8_t* data;
    std::uint16_t size;
    std::uint16_t stamp;
    std::uint8_t slot;
    std::uint8_t cell;
    bool replaces;  ///< it took the cell of a waiting frame
  };

  /// `memory`: memory_bytes that DMA can reach; owned by the caller.
  explicit BasicLatestSlots(std::uint8_t* memory) : memory_(memory) {}
  BasicLatestSlots(const BasicLatestSlots&) = delete;  // grants point to it
  BasicLatestSlots& operator=(const BasicLatestSlots&) = delete;

  // ---- senders: any context -----------------------------------------------------------------------------------------

  /// Take a cell for a frame in this slot. `full`: larger than its cells; `held`: too many senders are writing.
  Refusal take(std::size_t slot, std::size_t size, std::uint16_t stamp, Ticket& ticket) {
    if (size == 0 || size > cell_bytes[slot]) return Refusal::full;
    unsigned cell = 0;
    bool replaces = false;
    const bool taken = Atomics::update(entries_[slot].control, Orders::takes, [&](std::uint32_t& control) {
      const std::uint32_t used = writing_in(control) | bit_of(waiting_in(control)) | bit_of(sending_in(control));
      for (cell = 0; cell < CellCount; ++cell) {
        if ((used >> cell & 1u) == 0) break;
      }
      replaces = cell == CellCount;
      if (replaces) {
        cell = waiting_in(control);
        if (cell == nothing) return false;
      }
      const unsigned waiting = replaces ? nothing : waiting_in(control);
      control =
          make(writing_in(control) | 1u << cell, order_in(control) << order_bits | cell, waiting, sending_in(control));
      return true;
    });
    if (!taken) return Refusal::held;
    ticket = {cell_at(slot, cell),
              static_cast<std::uint16_t>(size),
              stamp,
              static_cast<std::uint8_t>(slot),
              static_cast<std::uint8_t>(cell),
              replaces};
    return Refusal::none;
  }

  /// Commit the first `used` bytes as the slot's frame. Returns true if a frame was replaced: one that waited or, if a
  /// newer one was committed since, this one.
  bool commit(const Ticket& ticket, std::size_t used) {
    Entry& entry = entries_[ticket.slot];
    entry.sizes[ticket.cell] = static_cast<std::uint16_t>(used);
    entry.stamps[ticket.cell].store(ticket.stamp, std::memory_order_relaxed);
    bool replaced = false;
    Atomics::update(entry.control, Orders::commits, [&](std::uint32_t& control) {
      const std::uint32_t writing = writing_in(control) & ~(1u << ticket.cell);
      const std::uint32_t order = order_in(control);
      const unsigned place = place_in(order, ticket.cell);
      const bool is_newest = place != nowhere;  // of all that were committed
      replaced = !is_newest || waiting_in(control) != nothing;
      // Senders that began before this one are older from now on: they leave the order.
      control = make(writing, is_newest ? order | ~std::uint32_t{0} << place : order,
                     is_newest ? ticket.cell : waiting_in(control), sending_in(control));
      return true;
    });
    return replaced;
  }

  void abandon(const Ticket& ticket) {
    Atomics::update(entries_[ticket.slot].control, Orders::abandons, [&](std::uint32_t& control) {
      std::uint32_t order = order_in(control);
      const unsigned place = place_in(order, ticket.cell);
      if (place != nowhere) {  // the older ones move up
        const std::uint32_t newer = (1u << place) - 1;
        const std::uint32_t older = order >> (place + order_bits) | ~std::uint32_t{0}
                                                                        << (all_orders - order_bits - place);
        order = (order & newer) | older << place;
      }
      control = make(writing_in(control) & ~(1u << ticket.cell), order, waiting_in(control), sending_in(control));
      return true;
    });
  }

  // ---- the consumer: one context ------------------------------------------------------------------------------------

  /// Return the frame that waits in this slot; the consumer owns it until `end_run`. Size 0: none waits. One frame of a
  /// slot is sent at a time.
  Run next(std::size_t slot) {
    Entry& entry = entries_[slot];
    unsigned cell = nothing;
    const bool taken = Atomics::update(entry.control, Orders::sends, [&](std::uint32_t& control) {
      cell = waiting_in(control);
      if (cell == nothing) return false;
      control = make(writing_in(control), order_in(control), nothing, cell);
      return true;
    });
    if (!taken) return {};
    return {cell_at(slot, cell), entry.sizes[cell], 1};
  }

  void end_run(std::size_t slot) {
    Atomics::update(entries_[slot].control, Orders::frees, [](std::uint32_t& control) {
      control = make(writing_in(control), order_in(control), waiting_in(control), nothing);
      return true;
    });
  }

  /// Drop the frame that waits in this slot if `is_old(stamp)`. Returns true if it was dropped.
  template <class IsOld>
  bool expire(std::size_t slot, IsOld&& is_old) {
    Entry& entry = entries_[slot];
    return Atomics::update(entry.control, Orders::frees, [&](std::uint32_t& control) {
      const unsigned cell = waiting_in(control);
      // If a sender takes this cell now, its stamp means nothing, but the word has changed and this is repeated.
      if (cell == nothing || !is_old(entry.stamps[cell].load(std::memory_order_relaxed))) return false;
      control = make(writing_in(control), order_in(control), nothing, sending_in(control));
      return true;
    });
  }

  // ---- any context --------------------------------------------------------------------------------------------------

  /// Return how many frames of this slot are finished and have not left: 0 to 2, including one being sent.
  std::size_t finished(std::size_t slot) const {
    const std::uint32_t control = entries_[slot].control.load(std::memory_order_relaxed);
    return std::size_t{waiting_in(control) != nothing} + std::size_t{sending_in(control) != nothing};
  }

  /// Return how many frames of this slot are between reserve and commit.
  std::size_t unfinished(std::size_t slot) const {
    std::size_t count = 0;
    for (std::uint32_t bits = writing_in(entries_[slot].control.load(std::memory_order_relaxed)); bits != 0;
         bits >>= 1) {
      count += bits & 1u;
    }
    return count;
  }

 private:
  // The whole state of a slot is in one word, so that a change sees all of it: a bit for each cell being written; those
  // of them that no newer frame has overtaken, newest first; the waiting cell, and the one being sent.
  static constexpr unsigned nothing = 7;
  static constexpr unsigned order_bits = 3;  // per place in the order; `nothing` after the last
  static constexpr unsigned all_orders = CellCount * order_bits;
  static constexpr std::uint32_t order_mask = (1u << all_orders) - 1;
  static constexpr unsigned nowhere = all_orders;

  static constexpr std::uint32_t make(std::uint32_t writing, std::uint32_t order, unsigned waiting, unsigned sending) {
    return writing | (order & order_mask) << 6 | waiting << 24 | sending << 27;
  }
  static constexpr std::uint32_t writing_in(std::uint32_t control) { return control & 0x3Fu; }
  static constexpr std::uint32_t order_in(std::uint32_t control) { return control >> 6 & order_mask; }
  static constexpr unsigned waiting_in(std::uint32_t control) { return control >> 24 & 7u; }
  static constexpr unsigned sending_in(std::uint32_t control) { return control >> 27 & 7u; }
  static constexpr std::uint32_t bit_of(unsigned cell) { return cell == nothing ? 0 : 1u << cell; }

  /// Return the bit at which this cell begins in the order, or `nowhere`.
  static constexpr unsigned place_in(std::uint32_t order, unsigned cell) {
    unsigned place = 0;
    while (place < all_orders && (order >> place & 7u) != cell) place += order_bits;
    return place;
  }

  struct Entry {
    typename Atomics::template Atomic<std::uint32_t> control{make(0, order_mask, nothing, nothing)};
    std::array<std::uint16_t, CellCount> sizes{};  // written by the cell's owner
    // When each frame was reserved: written by the cell's owner, read by the consumer while the frame waits.
    std::array<typename Atomics::template Atomic<std::uint16_t>, CellCount> stamps{};
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
