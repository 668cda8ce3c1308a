// Whole frames that wait for the line, in the caller's memory: no meaning of a message, no time.
#pragma once

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <cstring>

namespace wirebond {

/// A frame that waits. `size` 0 means a repeated value: its bytes are read when its turn comes, so the newest are sent.
struct QueuedFrame {
  std::uint32_t size = 0;
  std::int16_t message = -1;
  std::int16_t reply = -1;  ///< index of the message that answers it; -1: none
  std::uint64_t accepted_us = 0;
  bool takes_number = false;  ///< gets its sequence number when it leaves
  std::uint64_t address = 0;  ///< of the receiver, where frames have one
  std::uint32_t lease = 0;    ///< of a repeated value: index of its lease

  constexpr bool is_value() const { return size == 0; }
};

/// First in, first out, except for `drop`. Bytes are in one ring, facts in another. One thread at a time.
class FrameQueue {
 public:
  /// Both memories must outlive this object; it owns neither.
  FrameQueue(std::uint8_t* bytes, std::size_t byte_capacity, QueuedFrame* frames, std::size_t frame_capacity)
      : bytes_(bytes), byte_capacity_(byte_capacity), frames_(frames), frame_capacity_(frame_capacity) {}

  std::size_t size() const { return count_; }
  bool is_empty() const { return count_ == 0; }
  std::size_t bytes() const { return used_; }

  /// Check whether a frame of `size` bytes fits, with `kept` places left for others.
  bool has_room(std::size_t size, std::size_t kept = 0) const {
    return size <= byte_capacity_ - used_ && count_ + kept < frame_capacity_;
  }

  /// Append a frame. Returns false if the queue is full; nothing is changed then.
  bool push(const QueuedFrame& frame, const std::uint8_t* bytes) {
    if (!has_room(frame.size)) return false;
    write(wrapped(first_byte_ + used_), bytes, frame.size);
    frames_[(first_ + count_) % frame_capacity_] = frame;
    used_ += frame.size;
    ++count_;
    return true;
  }

  /// Return the first frame; only if there is one.
  const QueuedFrame& front() const { return frames_[first_]; }
  /// Return the frame after `index` others; only if there is one.
  const QueuedFrame& at(std::size_t index) const { return frames_[(first_ + index) % frame_capacity_]; }
  /// Copy its bytes to `out`, which holds `front().size`.
  void copy_front(std::uint8_t* out) const { copy_front(out, front().size); }
  /// Copy the bytes of the first frames, `size` bytes together.
  void copy_front(std::uint8_t* out, std::size_t size) const { read(first_byte_, out, size); }
  void pop() {
    used_ -= front().size;
    first_byte_ = wrapped(first_byte_ + front().size);
    first_ = (first_ + 1) % frame_capacity_;
    --count_;
  }

  /// Remove all frames for which `matches(frame)` is true, and return how many; the others keep their order. O(bytes).
  template <class Matches>
  std::size_t drop(Matches&& matches) {
    std::size_t kept = 0;
    std::size_t from = first_byte_;
    std::size_t to = first_byte_;
    for (std::size_t i = 0; i < count_; ++i) {
      const QueuedFrame frame = frames_[(first_ + i) % frame_capacity_];
      const std::size_t begin = from;
      from = wrapped(from + frame.size);
      if (matches(frame)) continue;
      if (begin != to) move(begin, to, frame.size);
      to = wrapped(to + frame.size);
      frames_[(first_ + kept) % frame_capacity_] = frame;
      ++kept;
    }
    const std::size_t dropped = count_ - kept;
    count_ = kept;
    used_ = 0;
    for (std::size_t i = 0; i < count_; ++i) used_ += frames_[(first_ + i) % frame_capacity_].size;
    return dropped;
  }

 private:
  std::size_t wrapped(std::size_t place) const { return place >= byte_capacity_ ? place - byte_capacity_ : place; }

  void write(std::size_t place, const std::uint8_t* bytes, std::size_t size) {
    if (bytes == nullptr || size == 0) return;
    const std::size_t first = std::min(size, byte_capacity_ - place);
    std::memcpy(bytes_ + place, bytes, first);
    std::memcpy(bytes_, bytes + first, size - first);
  }

  void read(std::size_t place, std::uint8_t* out, std::size_t size) const {
    if (size == 0) return;
    const std::size_t first = std::min(size, byte_capacity_ - place);
    std::memcpy(out, bytes_ + place, first);
    std::memcpy(out + first, bytes_, size - first);
  }

  /// Move towards the front of the ring, so that a byte is read before it is overwritten.
  void move(std::size_t from, std::size_t to, std::size_t size) {
    for (std::size_t i = 0; i < size; ++i) bytes_[wrapped(to + i)] = bytes_[wrapped(from + i)];
  }

  std::uint8_t* bytes_;
  std::size_t byte_capacity_;
  QueuedFrame* frames_;
  std::size_t frame_capacity_;
  std::size_t first_byte_ = 0;
  std::size_t used_ = 0;
  std::size_t first_ = 0;
  std::size_t count_ = 0;
};

}  // namespace wirebond
