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

/// A frame that is offered again and again, and its payload in it.
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
  std::uint64_t expired = 0;    ///< accepted, and dropped before their turn
  std::uint64_t delivered = 0;  ///< to the handler at the other end
  std::uint64_t lost_to_faults = 0;
  std::uint64_t lost_intact = 0;   ///< no fault touched them, and they did not come
  std::uint64_t false_frames = 0;  ///< came, and nobody had sent them like this
};

/// One direction. Frames leave in the order in which they were accepted.
class Ledger {
 public:
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

  // A `Line` tells `line_time` and `was_touched`, as sim::Wire does.

  /// `size` bytes, whole frames, were put on the line; they are numbered from `number`, and the last one ends at `end`.
  /// False: they are not those that wait.
  template <class Line>
  bool leave(std::uint64_t number, std::size_t size, Time end, const Line& wire) {
    while (size != 0) {
      if (waiting_.empty() || waiting_.front().size > size) return false;
      Entry entry = waiting_.front();
      waiting_.pop_front();
      entry.number = number;
      number += entry.size;
      size -= entry.size;
      const Time gone = end - wire.line_time(size);
      if (gone - entry.accepted > longest_wait) longest_wait = gone - entry.accepted;
      fates.left += 1;
      travelling_.push_back(entry);
    }
    return true;
  }

  /// A handler got this. `samples(message, sample)` is what was sent.
  template <class Samples, class Line>
  void deliver(std::uint16_t message, const std::uint8_t* payload, std::size_t size, Time now, Samples&& samples,
               Line& wire) {
    for (std::size_t place = 0; place < travelling_.size(); ++place) {
      const Entry& entry = travelling_[place];
      if (entry.message != message) continue;
      if (!is_payload(samples(entry.message, entry.sample), payload, size)) continue;
      for (; place != 0; --place) lose(wire);
      latency.add(now - travelling_.front().accepted);
      travelling_.pop_front();
      fates.delivered += 1;
      return;
    }
    fates.false_frames += 1;
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
    (wire.was_touched(entry.number, entry.number + entry.size) ? fates.lost_to_faults : fates.lost_intact) += 1;
    travelling_.pop_front();
  }

  std::deque<Entry> waiting_;
  std::deque<Entry> travelling_;
};

}  // namespace soak
