// What became of every frame of one direction, seen from outside: no link's own counter is believed here.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <cstring>
#include <deque>

#include "wirebond/sim/wire.hpp"

namespace soak {

using wirebond::sim::Time;

/// A frame that is offered again and again, and its payload in it. Where a payload has room it holds the running number
/// of its message's frames, from 0 to the number of samples less one.
struct Sample {
  const std::uint8_t* frame;
  std::size_t size;
  const std::uint8_t* payload;
  std::size_t payload_size;
};

/// Times by their size, to 1/64 of each: no memory grows. In nanoseconds.
class Histogram {
 public:
  void add(Time time) {
    counts_[place(time)] += 1;
    total_ += 1;
    if (time > most_) most_ = time;
  }
  std::uint64_t total() const { return total_; }
  Time most() const { return most_; }
  /// The time that this share of all does not exceed. 0: there are none.
  Time percentile(double share) const {
    const double wanted = share * static_cast<double>(total_);
    std::uint64_t seen = 0;
    for (std::size_t i = 0; i < counts_.size(); ++i) {
      seen += counts_[i];
      if (seen != 0 && static_cast<double>(seen) >= wanted) return upper(i) < most_ ? upper(i) : most_;
    }
    return most_;
  }

 private:
  static constexpr std::size_t steps = 64;  ///< in each octave

  static std::size_t place(Time time) {
    unsigned octave = 0;
    while ((time >> octave) >= 2 * steps) ++octave;
    return octave * steps + static_cast<std::size_t>(time >> octave);  // time >> octave: 64 to 127, or less in octave 0
  }
  static Time upper(std::size_t place) {
    if (place < 2 * steps) return place;
    const std::size_t octave = place / steps - 1;
    return ((place - octave * steps + 1) << octave) - 1;
  }

  std::array<std::uint64_t, 60 * steps> counts_{};
  std::uint64_t total_ = 0;
  Time most_ = 0;
};

/// Frames since the start.
struct Fates {
  std::uint64_t offered = 0;
  std::uint64_t accepted = 0;
  std::uint64_t left = 0;       ///< on the line, whole
  std::uint64_t expired = 0;    ///< accepted, and dropped before their turn: too old, or the port went away
  std::uint64_t replaced = 0;   ///< accepted, and a newer one of `queue: latest` took their place
  std::uint64_t delivered = 0;  ///< to the handler at the other end
  std::uint64_t lost_to_faults = 0;
  std::uint64_t lost_to_false = 0;  ///< a false frame, which passed every check, may lie over them
  std::uint64_t lost_intact = 0;    ///< no fault touched them, and they did not come
  std::uint64_t false_frames = 0;   ///< came, and nobody had sent them like this
};

/// One direction. A frame that comes is known by its place on the line, and must have the payload of the one that was
/// put there.
class Ledger {
 public:
  /// `longest_frame`: bytes on the line.
  explicit Ledger(std::size_t longest_frame) : longest_frame_(longest_frame) {}

  Fates fates;
  Histogram latency;      ///< from accepted to delivered
  Time longest_wait = 0;  ///< from accepted to its last bit

  void accept(Time now, std::uint16_t message, std::uint16_t sample, std::size_t size) {
    waiting_.push_back({now, 0, static_cast<std::uint32_t>(size), message, sample});
    fates.accepted += 1;
  }

  /// The oldest ones are dropped.
  void expire(std::uint64_t count) {
    for (; count != 0 && !waiting_.empty(); --count) {
      waiting_.pop_front();
      fates.expired += 1;
    }
  }

  /// A newer one of its message takes the place of the one that waits, if one does.
  void replace(std::uint16_t message) {
    for (auto entry = waiting_.begin(); entry != waiting_.end(); ++entry) {
      if (entry->message != message) continue;
      waiting_.erase(entry);
      fates.replaced += 1;
      return;
    }
  }

  // A `Line` tells `line_time`, `was_touched` and `origin_of`, as sim::Wire does.

  /// `size` bytes, whole frames, were put on the line, in the order in which they were accepted; they are numbered from
  /// `number`, and the last one ends at `end`. False: they are not those that wait.
  template <class Line>
  bool leave(std::uint64_t number, std::size_t size, Time end, const Line& wire) {
    while (size != 0) {
      if (waiting_.empty() || waiting_.front().size > size) return false;
      const std::uint32_t of_frame = waiting_.front().size;
      size -= of_frame;
      go(waiting_.begin(), number, of_frame, end - wire.line_time(size));
      number += of_frame;
    }
    return true;
  }

  /// The oldest one was put on the line; its number made it `size` bytes long.
  bool leave_next(std::uint64_t number, std::size_t size, Time end) {
    if (waiting_.empty()) return false;
    go(waiting_.begin(), number, size, end);
    return true;
  }

  /// The oldest one with this payload was put on the line.
  template <class Samples>
  bool leave_with(std::uint16_t message, const std::uint8_t* payload, std::size_t payload_size, std::uint64_t number,
                  std::size_t size, Time end, Samples&& samples) {
    for (auto entry = waiting_.begin(); entry != waiting_.end(); ++entry) {
      if (entry->message != message) continue;
      if (!is_payload(samples(message, entry->sample), payload, payload_size)) continue;
      go(entry, number, size, end);
      return true;
    }
    return false;
  }

  /// A handler got this; its last byte is the one before byte `behind` of those that came. `samples(message, sample)`
  /// is what was sent.
  template <class Samples, class Line>
  void deliver(std::uint16_t message, const std::uint8_t* payload, std::size_t size, std::uint64_t behind, Time now,
               Samples&& samples, Line& wire) {
    const std::uint64_t last = wire.origin_of(behind - 1);
    std::size_t found = 0;
    while (found < travelling_.size() && travelling_[found].number + travelling_[found].size <= last) ++found;
    const auto is_it = [&](std::size_t place) {
      if (place >= travelling_.size() || travelling_[place].message != message) return false;
      return is_payload(samples(message, travelling_[place].sample), payload, size);
    };
    // Where a fault took its end, the next one's begin may stand for it.
    if (!is_it(found) && (found == 0 || !is_it(--found))) return deliver_false();
    for (; found != 0; --found) lose(wire);
    const Entry& entry = travelling_.front();
    latency.add(now - entry.accepted);
    // With a fault in it, it may be as long as a false frame is.
    false_bytes_ = wire.was_touched(entry.number, entry.number + entry.size) ? longest_frame_ : 0;
    travelling_.pop_front();
    fates.delivered += 1;
  }

  /// A frame came that passed every check, and was not sent like this.
  void deliver_false() {
    fates.false_frames += 1;
    false_bytes_ += longest_frame_;
  }

  /// Nothing comes any more.
  template <class Line>
  void end(Line& wire) {
    while (!travelling_.empty()) lose(wire);
  }

  std::uint64_t waiting() const { return waiting_.size(); }
  std::uint64_t travelling() const { return travelling_.size(); }

 private:
  struct Entry {
    Time accepted;
    std::uint64_t number;  ///< of its first byte on the wire
    std::uint32_t size;
    std::uint16_t message;
    std::uint16_t sample;
  };

  void go(std::deque<Entry>::iterator waiting, std::uint64_t number, std::size_t size, Time gone) {
    Entry entry = *waiting;
    waiting_.erase(waiting);
    entry.number = number;
    entry.size = static_cast<std::uint32_t>(size);
    if (gone - entry.accepted > longest_wait) longest_wait = gone - entry.accepted;
    fates.left += 1;
    travelling_.push_back(entry);
  }

  /// A frame of fixed size has zeros behind the fields, of which the handler knows nothing.
  static bool is_payload(const Sample& sent, const std::uint8_t* payload, std::size_t size) {
    if (size > sent.payload_size || (size != 0 && std::memcmp(sent.payload, payload, size) != 0)) return false;
    for (; size != sent.payload_size; ++size) {
      if (sent.payload[size] != 0) return false;
    }
    return true;
  }

  template <class Line>
  void lose(Line& wire) {
    const Entry& entry = travelling_.front();
    if (wire.was_touched(entry.number, entry.number + entry.size)) {
      fates.lost_to_faults += 1;
    } else if (false_bytes_ >= entry.size) {
      false_bytes_ -= entry.size;
      fates.lost_to_false += 1;
    } else {
      fates.lost_intact += 1;
    }
    travelling_.pop_front();
  }

  std::size_t longest_frame_;
  std::size_t false_bytes_ = 0;  ///< that false frames since the last delivery may lie over
  std::deque<Entry> waiting_;
  std::deque<Entry> travelling_;
};

}  // namespace soak
