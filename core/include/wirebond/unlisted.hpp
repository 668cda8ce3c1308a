// Counts of frames of messages that the protocol file does not list, where nothing lets them be delivered as unknown:
// candidates that failed by their id alone, and where their ends show. No byte of them.
#pragma once

#include <cstddef>
#include <cstdint>

#include "wirebond/deframer.hpp"

namespace wirebond {

/// How many frames by id and size: `most_kinds` kinds, in the order in which they were first seen.
class UnlistedKinds {
 public:
  struct Kind {
    std::uint32_t id = 0;
    std::uint32_t bytes = 0;  ///< of the frame
    std::uint64_t frames = 0;
  };
  static constexpr std::size_t most_kinds = 64;

  void add(std::uint32_t id, std::uint32_t bytes) {
    frames_ += 1;
    for (std::size_t i = 0; i < kind_count_; ++i) {
      if (kinds_[i].id == id && kinds_[i].bytes == bytes) {
        kinds_[i].frames += 1;
        return;
      }
    }
    if (kind_count_ < most_kinds) kinds_[kind_count_++] = {id, bytes, 1};
  }

  std::uint64_t frames() const { return frames_; }  ///< of all kinds, also of those that `kind` has no room for
  std::size_t kind_count() const { return kind_count_; }
  const Kind& kind(std::size_t index) const { return kinds_[index]; }

 private:
  std::uint64_t frames_ = 0;
  std::size_t kind_count_ = 0;
  Kind kinds_[most_kinds];
};

/// Under `unknown: reject` a candidate of unknown id is a false start, and its bytes are scanned again: its check is
/// weak, or counts a seed that the file does not give. But a peer that sends such messages is no noise. Counted here,
/// beside the discard of its bytes, is a candidate that failed by its id alone, if its end shows: a frame or another
/// such candidate begins there, or it is what lies between two delimiters or silences. What is found depends on the
/// bytes alone, and not on how they come in pieces.
///
/// `Found` has `add(id, bytes)`, which is called for each in the order in which their ends show.
template <class Found>
class UnlistedIn {
 public:
  /// A candidate at this place of the stream failed by its id alone; it would have `size` bytes.
  void failed(std::uint64_t at, std::uint32_t id, std::size_t size) {
    settle(at);
    if (waiting_count_ == most_waiting) return;  // false starts within false starts
    waiting_[waiting_count_++] = {at, at + size, id, static_cast<std::uint32_t>(size)};
  }

  /// A frame begins at this place.
  void begins(std::uint64_t at) {
    if (waiting_count_ != 0) settle(at);
  }

  /// A whole block of `size` bytes at this place failed by its id alone.
  void stands(std::uint64_t at, std::uint32_t id, std::size_t size) {
    if (at < stood_until_) return;  // it lies within one that was counted
    stood_until_ = at + size;
    found_.add(id, static_cast<std::uint32_t>(size));
  }

  /// Does a candidate wait for what follows?
  bool waits() const { return waiting_count_ != 0; }
  /// Does one wait for what begins at this place or later?
  bool waits_for(std::uint64_t at) const {
    for (std::size_t i = 0; i < waiting_count_; ++i) {
      if (waiting_[i].end >= at) return true;
    }
    return false;
  }

  const Found& found() const { return found_; }

 private:
  struct Waiting {
    std::uint64_t at;
    std::uint64_t end;
    std::uint32_t id;
    std::uint32_t size;
  };
  static constexpr std::size_t most_waiting = 16;

  /// Something begins here: what ends here is confirmed, and what began before that lay within it, or was none.
  void settle(std::uint64_t at) {
    std::size_t kept = 0;
    bool is_confirmed = false;
    for (std::size_t i = 0; i < waiting_count_ && !is_confirmed; ++i) {
      is_confirmed = waiting_[i].end == at;
      if (is_confirmed) found_.add(waiting_[i].id, waiting_[i].size);
    }
    for (std::size_t i = 0; i < waiting_count_ && !is_confirmed; ++i) {
      if (waiting_[i].end > at) waiting_[kept++] = waiting_[i];
    }
    waiting_count_ = kept;
  }

  Found found_;
  std::uint64_t stood_until_ = 0;
  std::size_t waiting_count_ = 0;
  Waiting waiting_[most_waiting];
};

/// Their number alone, for a link that asks only whether its peer speaks: 12 bytes.
class UnlistedCount {
 public:
  void failed(std::uint32_t at, std::uint32_t, std::size_t size) {
    begins(at);
    if (!waits_) end_ = at + static_cast<std::uint32_t>(size);
    waits_ = true;
  }

  void begins(std::uint32_t at) {
    if (!waits_ || static_cast<std::int32_t>(at - end_) < 0) return;
    if (at == end_) frames_ += 1;
    waits_ = false;
  }

  void stands(std::uint32_t, std::uint32_t, std::size_t) { frames_ += 1; }

  std::uint32_t frames() const { return frames_; }

 private:
  std::uint32_t end_ = 0;  ///< of a candidate that failed by its id alone, modulo 2^32
  std::uint32_t frames_ = 0;
  bool waits_ = false;
};

/// What an MCU's link counts, where the format can have such frames.
struct UnlistedByteCounts : ByteCounts<std::uint32_t> {
  UnlistedCount unlisted;
};

/// What a host's deframer counts.
struct HostAccount : ByteAccount<std::uint64_t> {
  UnlistedIn<UnlistedKinds> unlisted;
};

}  // namespace wirebond
