// Keeps the last bytes of a link in both directions, with their times. Bounded memory; knows no frame.
#pragma once

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <cstring>
#include <memory>
#include <vector>

namespace wirebond::engine {

enum class RecentKind : std::uint8_t { received, sent, port_up, port_down, collision, settings };

/// One read, one write, or an event of the port.
struct RecentPiece {
  std::uint64_t t_us;
  std::uint32_t size;  ///< bytes; 0 for an event of the port
  RecentKind kind;
};

/// Pieces in their order, and all their bytes one after the other.
struct RecentCopy {
  std::vector<RecentPiece> pieces;
  std::vector<std::uint8_t> bytes;
  std::uint64_t dropped_bytes = 0;  ///< older ones, dropped to make space
};

/// One thread at a time. `note` copies the bytes and allocates nothing. Memory that was never written is not touched,
/// so that a link with little traffic takes little memory.
class RecentBytes {
 public:
  static constexpr std::size_t max_pieces = 65536;

  explicit RecentBytes(std::size_t capacity)
      : capacity_(std::max<std::size_t>(capacity, 1)),
        bytes_(new std::uint8_t[capacity_]),
        pieces_(new RecentPiece[max_pieces]) {}

  /// Keep a piece; the oldest pieces make space. Of a piece larger than all memory, the end is kept.
  void note(RecentKind kind, const std::uint8_t* bytes, std::size_t size, std::uint64_t t_us) {
    if (size > capacity_) {
      dropped_ += size - capacity_;
      bytes += size - capacity_;
      size = capacity_;
    }
    while (count_ == max_pieces || held_ + size > capacity_) drop_oldest();
    const std::size_t at = (first_byte_ + held_) % capacity_;
    const std::size_t straight = std::min(size, capacity_ - at);
    if (straight != 0) std::memcpy(bytes_.get() + at, bytes, straight);
    if (size > straight) std::memcpy(bytes_.get(), bytes + straight, size - straight);
    pieces_[(first_piece_ + count_) % max_pieces] = {t_us, static_cast<std::uint32_t>(size), kind};
    held_ += size;
    ++count_;
  }

  RecentCopy copy() const {
    RecentCopy out;
    out.pieces.reserve(count_);
    for (std::size_t i = 0; i < count_; ++i) out.pieces.push_back(pieces_[(first_piece_ + i) % max_pieces]);
    const std::size_t straight = std::min(held_, capacity_ - first_byte_);
    out.bytes.reserve(held_);
    out.bytes.insert(out.bytes.end(), bytes_.get() + first_byte_, bytes_.get() + first_byte_ + straight);
    out.bytes.insert(out.bytes.end(), bytes_.get(), bytes_.get() + (held_ - straight));
    out.dropped_bytes = dropped_;
    return out;
  }

 private:
  void drop_oldest() {
    const std::size_t size = pieces_[first_piece_].size;
    first_piece_ = (first_piece_ + 1) % max_pieces;
    --count_;
    first_byte_ = (first_byte_ + size) % capacity_;
    held_ -= size;
    dropped_ += size;
  }

  std::size_t capacity_;
  std::unique_ptr<std::uint8_t[]> bytes_;
  std::unique_ptr<RecentPiece[]> pieces_;
  std::size_t first_byte_ = 0;
  std::size_t held_ = 0;  ///< bytes
  std::size_t first_piece_ = 0;
  std::size_t count_ = 0;  ///< pieces
  std::uint64_t dropped_ = 0;
};

}  // namespace wirebond::engine
