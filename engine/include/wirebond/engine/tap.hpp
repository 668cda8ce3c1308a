// Keeps a link's reads, writes and events with their times for a recorder. Bounded; knows no frame.
#pragma once

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <utility>
#include <vector>

namespace wirebond::engine {

/// The names for Python are in `to_tuple`, in this order.
enum class TapKind : std::uint8_t {
  received,
  sent,
  port_up,
  port_down,  ///< the bytes are a sentence with the reason; none: the link ended
  stopped,
  released,
  deadline_struck,  ///< one byte: the action
  deadline_ended,
  lease_begun,    ///< text: message, address
  lease_ended,    ///< text: message, address, why
  noted,          ///< a program's note
  port_settings,  ///< another program had changed them
};

/// One read, one write, or one event.
struct TapPiece {
  std::uint64_t t_us;
  std::uint64_t before_us;  ///< of a read: when it began, which is the time of its messages; otherwise `t_us`
  std::uint32_t size;
  TapKind kind;
};

/// Pieces that were dropped because their reader came too late.
struct TapLoss {
  std::uint64_t pieces = 0;
  std::uint64_t received_bytes = 0;
  std::uint64_t sent_bytes = 0;
};

struct TapCopy {
  std::vector<TapPiece> pieces;
  std::vector<std::uint8_t> bytes;  ///< of all pieces, one after the other
  TapLoss loss;                     ///< since the last time
};

/// One thread at a time: the link's lock guards it. `note` costs a copy of the bytes, and allocates until the memory
/// has reached its size for the first time. Pieces that do not fit are dropped and counted: kept ones stay whole. Times
/// never fall: a thread that waited for the lock may bring one that is older than the last.
class Tap {
 public:
  static constexpr std::size_t max_pieces = 65536;

  Tap(int number, std::size_t capacity) : number_(number), capacity_(capacity) {}

  int number() const { return number_; }

  void note(TapKind kind, const std::uint8_t* bytes, std::size_t size, std::uint64_t before_us, std::uint64_t t_us) {
    latest_us_ = std::max(latest_us_, t_us);
    if (held_.pieces.size() == max_pieces || size > capacity_ - held_.bytes.size()) {
      held_.loss.pieces += 1;
      if (kind == TapKind::received) held_.loss.received_bytes += size;
      if (kind == TapKind::sent) held_.loss.sent_bytes += size;
      return;
    }
    held_.bytes.insert(held_.bytes.end(), bytes, bytes + size);
    held_.pieces.push_back({latest_us_, std::min(before_us, latest_us_), static_cast<std::uint32_t>(size), kind});
  }

  /// O(1).
  TapCopy take() { return std::exchange(held_, {}); }

 private:
  int number_;
  std::size_t capacity_;
  TapCopy held_;
  std::uint64_t latest_us_ = 0;
};

}  // namespace wirebond::engine
