// The sequence numbers that an end gives its frames, where the format is a constant: the newest of each counter.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>

#include "wirebond/numbering.hpp"
#include "wirebond/sequence.hpp"

namespace wirebond {

/// For frames without a sequence number: nothing is kept, and frames are sealed whole before they wait.
template <class Sends, bool = detail::has_sequence<Sends>()>
class SentNumbers {
 public:
  static constexpr bool has_numbers = false;
  static constexpr bool has_messages = false;
};

/// Numbers begin with 0 at start-up. One context: the UART's interrupt. O(bytes of the frame), including checks.
template <class Sends>
class SentNumbers<Sends, true> {
 public:
  static constexpr bool has_numbers = true;
  static constexpr bool has_messages = Sends{}.format().sequence_per_message;  ///< each message has its own counter

 protected:
  /// Close a frame that waited in `room` bytes and is about to be given to DMA: its number, checks and stuffing.
  /// Returns its size on the wire.
  WIREBOND_NOINLINE std::size_t close(std::uint8_t* waiting, std::size_t room, std::uint8_t message) {
    constexpr Sends source{};
    const std::size_t size = waiting_size(source.format(), waiting, room);
    return close_numbered(source, waiting, size, [&] { return next_[has_messages ? message : 0]++; });
  }

 private:
  static constexpr std::size_t counters = detail::sequence_counters<Sends>();
  static_assert(counters <= 256, "`per: message` takes protocols of 256 messages at most");

  std::array<detail::HoldsMask<sequence_mask(Sends{}.format())>, counters> next_{};
};

}  // namespace wirebond
