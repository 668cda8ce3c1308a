// Counts frames of messages that the protocol file does not list, where no rule lets them be delivered as unknown. No
// byte of them.
#pragma once

#include <cstddef>
#include <cstdint>
#include <type_traits>

#include "wirebond/deframer.hpp"
#include "wirebond/format.hpp"
#include "wirebond/source.hpp"

namespace wirebond {

/// Counts frames by id and size: up to `most_kinds` kinds, in the order in which they were first seen.
class UnlistedKinds {
 public:
  struct Kind {
    std::uint32_t id = 0;
    std::uint32_t bytes = 0;  ///< size of the frame
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

  std::uint64_t frames() const { return frames_; }  ///< of all kinds, including those that did not fit
  std::size_t kind_count() const { return kind_count_; }
  const Kind& kind(std::size_t index) const { return kinds_[index]; }

 private:
  std::uint64_t frames_ = 0;
  std::size_t kind_count_ = 0;
  Kind kinds_[most_kinds];
};

/// Where a candidate ends on the wire: each escape among its bytes makes it one byte longer. Places are modulo 2^32 or
/// 2^64.
template <class Place>
struct WireEnd {
  Place end = 0;            ///< as far as its bytes have passed
  Place stuffed = 0;        ///< its escapes begin here
  bool is_escaped = false;  ///< the next byte to pass follows an escape

  /// Pass these bytes, the first of them at the place `at`.
  template <class Source>
  void pass(const Source& source, const std::uint8_t* bytes, std::size_t size, Place at) {
    const std::uint8_t escape = detail::escapes_of(source).escape;
    for (std::size_t i = 0; i < size; ++i, ++at) {
      if (is_before(at, stuffed)) continue;
      if (!is_before(at, end - static_cast<Place>(source.format().plain_back))) return;
      is_escaped = !is_escaped && bytes[i] == escape;
      if (is_escaped) end += 1;
    }
  }

  /// Check whether a frame that begins here cuts this one short: its escaped bytes contain no start.
  bool is_cut(Place at, std::size_t plain_back) const {
    return !is_before(at, stuffed) && is_before(at, end - static_cast<Place>(plain_back));
  }

  static bool is_before(Place a, Place b) { return static_cast<std::make_signed_t<Place>>(a - b) < 0; }
};

/// The problem: under `unknown: reject` a candidate with an unknown id is a false start, because its check is weak or
/// counts a seed that the file does not give; its bytes are scanned again. But a peer that sends such messages is not
/// noise, and a user who sees only discarded bytes would look for a bad cable.
///
/// The answer: a candidate that failed only by its id is counted here, beside the discard of its bytes, if its end is
/// confirmed: a frame or another such candidate begins there, or it fills the space between two delimiters or silences.
/// The result depends only on the bytes, not on the pieces in which they come.
///
/// `Found::add(id, bytes)` is called for each, in the order in which their ends are confirmed.
template <class Found>
class UnlistedIn {
 public:
  /// Note a candidate at this place of the stream that failed only by its id. It has `size` bytes, and one more for
  /// each escape that passes after its first `plain_front` bytes.
  void failed(std::uint64_t at, std::uint32_t id, std::size_t size, std::size_t plain_front) {
    settle(at);
    if (waiting_count_ == most_waiting) return;  // false starts within false starts
    waiting_[waiting_count_++] = {at, {at + size, at + plain_front}, id};
  }

  /// Drop each candidate that the escaped frame beginning here cuts short: those that have not reached their last
  /// `plain_back` bytes.
  void cut(std::uint64_t at, std::size_t plain_back) {
    std::size_t kept = 0;
    for (std::size_t i = 0; i < waiting_count_; ++i) {
      if (!waiting_[i].wire.is_cut(at, plain_back)) waiting_[kept++] = waiting_[i];
    }
    waiting_count_ = kept;
  }

  /// Where escapes make frames longer: pass the bytes that are settled next, the first of them at the place `at`.
  template <class Source>
  void pass(const Source& source, const std::uint8_t* bytes, std::size_t size, std::uint64_t at) {
    for (std::size_t i = 0; i < waiting_count_; ++i) waiting_[i].wire.pass(source, bytes, size, at);
  }

  /// Note that a frame begins at this place.
  void begins(std::uint64_t at) {
    if (waiting_count_ != 0) settle(at);
  }

  /// Note a whole block of `size` bytes at this place that failed only by its id.
  void stands(std::uint64_t at, std::uint32_t id, std::size_t size) {
    if (at < stood_until_) return;  // inside one that was counted
    stood_until_ = at + size;
    found_.add(id, static_cast<std::uint32_t>(size));
  }

  /// Check whether a candidate still waits for its end.
  bool waits() const { return waiting_count_ != 0; }
  /// Check whether one waits for a frame that begins at this place or later.
  bool waits_for(std::uint64_t at) const {
    for (std::size_t i = 0; i < waiting_count_; ++i) {
      if (waiting_[i].wire.end >= at) return true;
    }
    return false;
  }

  const Found& found() const { return found_; }

 private:
  struct Waiting {
    std::uint64_t at;
    WireEnd<std::uint64_t> wire;
    std::uint32_t id;
  };
  static constexpr std::size_t most_waiting = 16;

  /// Confirm the candidate that ends here. Drop those that began before: they were inside it, or false.
  void settle(std::uint64_t at) {
    std::size_t kept = 0;
    bool is_confirmed = false;
    for (std::size_t i = 0; i < waiting_count_ && !is_confirmed; ++i) {
      is_confirmed = waiting_[i].wire.end == at;
      if (is_confirmed) found_.add(waiting_[i].id, static_cast<std::uint32_t>(at - waiting_[i].at));
    }
    for (std::size_t i = 0; i < waiting_count_ && !is_confirmed; ++i) {
      if (waiting_[i].wire.end > at) waiting_[kept++] = waiting_[i];
    }
    waiting_count_ = kept;
  }

  Found found_;
  std::uint64_t stood_until_ = 0;
  std::size_t waiting_count_ = 0;
  Waiting waiting_[most_waiting];
};

/// Counts such frames without their ids and sizes, for a link that only needs to know whether its peer speaks: 20
/// bytes.
class UnlistedCount {
 public:
  void failed(std::uint32_t at, std::uint32_t, std::size_t size, std::size_t plain_front) {
    begins(at);
    if (!waits_) wire_ = {at + static_cast<std::uint32_t>(size), at + static_cast<std::uint32_t>(plain_front)};
    waits_ = true;
  }

  void cut(std::uint32_t at, std::size_t plain_back) {
    if (wire_.is_cut(at, plain_back)) waits_ = false;
  }

  template <class Source>
  void pass(const Source& source, const std::uint8_t* bytes, std::size_t size, std::uint32_t at) {
    if (waits_) wire_.pass(source, bytes, size, at);
  }

  void begins(std::uint32_t at) {
    if (!waits_ || wire_.is_before(at, wire_.end)) return;
    if (at == wire_.end) frames_ += 1;
    waits_ = false;
  }

  void stands(std::uint32_t, std::uint32_t, std::size_t) { frames_ += 1; }

  std::uint32_t frames() const { return frames_; }

 private:
  WireEnd<std::uint32_t> wire_;  ///< of a candidate that failed only by its id
  std::uint32_t frames_ = 0;
  bool waits_ = false;
};

/// Counters of an MCU's link, where the format can have such frames.
struct UnlistedByteCounts : ByteCounts<std::uint32_t> {
  UnlistedCount unlisted;
};

/// Counters of a host's deframer.
struct HostAccount : ByteAccount<std::uint64_t> {
  UnlistedIn<UnlistedKinds> unlisted;
};

}  // namespace wirebond
