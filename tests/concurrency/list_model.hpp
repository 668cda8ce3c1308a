// What a send queue and its slots are, said with lists and without regard to cost. The outbox is compared with it.
#pragma once

#include <cstddef>
#include <cstdint>
#include <deque>
#include <functional>
#include <optional>
#include <vector>

#include "wirebond/mcu/grant.hpp"

namespace model {

using wirebond::Refusal;

struct Frame {
  enum State { open, ready, sending, gone };
  std::uint64_t name = 0;   // what the test calls it
  std::uint64_t begin = 0;  // bytes from the beginning of time, skipped ones counted
  std::size_t size = 0;
  std::uint16_t stamp = 0;
  State state = open;
};

/// The ring and its table: frames in the order in which they were reserved.
class List {
 public:
  List(std::size_t capacity, std::size_t entries) : capacity_(capacity), entries_(entries) {}

  Refusal reserve(std::uint64_t name, std::size_t size, std::uint16_t stamp) {
    if (size == 0 || size > capacity_ / 2) return Refusal::full;
    const std::size_t offset = end_ % capacity_;
    const std::size_t skipped = offset + size > capacity_ ? capacity_ - offset : 0;
    if (used_bytes() + skipped + size > capacity_ || frames_.size() == entries_) return why();
    frames_.push_back({name, end_ + skipped, size, stamp, Frame::open});
    end_ += skipped + size;
    return Refusal::none;
  }

  void commit(std::uint64_t name, std::size_t used) { close(name, used, Frame::ready); }
  void abandon(std::uint64_t name) { close(name, 0, Frame::gone); }

  /// Names of the next run; empty where there is none.
  std::vector<std::uint64_t> next(std::size_t max_bytes, bool passes) {
    free_room();
    std::vector<std::uint64_t> run;
    std::size_t bytes = 0;
    for (std::size_t i = 0; i < frames_.size(); ++i) {
      Frame& frame = frames_[i];
      if (run.empty()) {
        if (frame.state == Frame::open && !passes) break;
        if (frame.state != Frame::ready) continue;
      } else {
        const Frame& before = frames_[i - 1];
        const bool follows = frame.state == Frame::ready && frame.begin == before.begin + before.size;
        if (!follows || frame.begin % capacity_ == 0 || bytes + frame.size > max_bytes) break;
      }
      run.push_back(frame.name);
      bytes += frame.size;
    }
    for (const std::uint64_t name : run) find(name).state = Frame::sending;
    return run;
  }

  void end_run() {
    for (Frame& frame : frames_) {
      if (frame.state == Frame::sending) frame.state = Frame::gone;
    }
    free_room();
  }

  std::size_t expire(const std::function<bool(std::uint16_t)>& is_old) {
    std::size_t expired = 0;
    for (Frame& frame : frames_) {
      if (frame.state != Frame::ready || !is_old(frame.stamp)) continue;
      frame.state = Frame::gone;
      ++expired;
    }
    free_room();
    return expired;
  }

  std::size_t queued() const {
    std::size_t count = 0;
    for (const Frame& frame : frames_) count += frame.state == Frame::ready || frame.state == Frame::sending;
    return count;
  }
  std::size_t unfinished() const {
    std::size_t count = 0;
    for (const Frame& frame : frames_) count += frame.state == Frame::open;
    return count;
  }
  bool is_full() const { return used_bytes() == capacity_ || frames_.size() == entries_; }
  bool is_sending() const {
    for (const Frame& frame : frames_) {
      if (frame.state == Frame::sending) return true;
    }
    return false;
  }
  std::size_t used_bytes() const { return end_ - free_to_; }

 private:
  Frame& find(std::uint64_t name) {
    for (Frame& frame : frames_) {
      if (frame.name == name) return frame;
    }
    return frames_.at(frames_.size());  // the test asks for a frame that is not there: throws
  }

  void close(std::uint64_t name, std::size_t used, Frame::State state) {
    Frame& frame = find(name);
    if (frame.begin + frame.size == end_ && &frame == &frames_.back()) end_ = frame.begin + used;
    frame.size = used;
    frame.state = state;
  }

  Refusal why() const {
    bool unfinished = false;
    for (const Frame& frame : frames_) {
      if (frame.state == Frame::gone && unfinished) return Refusal::held;
      unfinished = unfinished || frame.state == Frame::open;
    }
    return Refusal::full;
  }

  void free_room() {
    while (!frames_.empty() && frames_.front().state == Frame::gone) {
      frames_.pop_front();
      free_to_ = frames_.empty() ? end_ : frames_.front().begin;
    }
  }

  std::size_t capacity_;
  std::size_t entries_;
  std::deque<Frame> frames_;
  std::uint64_t end_ = 0;      // behind the last frame
  std::uint64_t free_to_ = 0;  // all before it is free
};

/// A slot of a `latest` message.
class Slot {
 public:
  Slot(std::size_t cells, std::size_t cell_bytes) : cells_(cells), cell_bytes_(cell_bytes) {}

  Refusal reserve(std::size_t size) {
    if (size == 0 || size > cell_bytes_) return Refusal::full;
    replaces = writing + waiting.has_value() + sending.has_value() == cells_;
    if (replaces && !waiting.has_value()) return Refusal::held;
    if (replaces) waiting.reset();
    ++writing;
    return Refusal::none;
  }
  /// True where a frame was replaced: the one that waited, or this one. Names grow in the order of `reserve`.
  bool commit(std::uint64_t name, std::uint16_t stamp) {
    --writing;
    if (name < newest_) return true;
    newest_ = name;
    const bool replaced = waiting.has_value();
    waiting = name;
    waiting_stamp = stamp;
    return replaced;
  }
  std::size_t queued() const { return waiting.has_value() + std::size_t{sending.has_value()}; }

  std::size_t writing = 0;
  std::optional<std::uint64_t> waiting;
  std::optional<std::uint64_t> sending;
  std::uint16_t waiting_stamp = 0;
  bool replaces = false;  ///< the last `reserve` took the cell of a frame that waited

 private:
  std::uint64_t newest_ = 0;  // of all that were committed
  std::size_t cells_;
  std::size_t cell_bytes_;
};

}  // namespace model
