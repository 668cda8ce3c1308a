// One direction of a simulated wire: bytes and times in, bytes and times out. No clock, no thread, no descriptor.
// One file: all faults act on one stream of bytes, in a fixed order.
#pragma once

#include <algorithm>
#include <array>
#include <cstddef>
#include <cstdint>
#include <deque>
#include <vector>

#include "wirebond/sim/random.hpp"

namespace wirebond::sim {

/// Nanoseconds on the time line that all parts of a simulation share.
using Time = std::uint64_t;
inline constexpr Time never = ~Time{0};

/// Random faults of the wire. Chances are in 10^12; see `certain`.
struct Faults {
  std::uint64_t bit_errors = 0;    ///< of each bit on the line. A wrong start or stop bit makes the byte random
  std::uint64_t bursts = 0;        ///< of each byte: from it on, `burst_bytes` become random
  std::uint32_t burst_bytes = 16;  ///< length of a burst
  std::uint64_t drops = 0;         ///< of each byte: it is lost
  std::uint64_t inserts = 0;       ///< of each byte: one that nobody sent comes before it
  std::uint64_t splits = 0;        ///< of each byte: the line pauses after it
  Time split_pause = 2'000'000;    ///< length of the pause
};

struct WireSettings {
  std::uint32_t baud = 115'200;
  unsigned bits_per_byte = 10;  ///< start, data, parity and stop bits: 10 for 8N1, 11 for 8N2
  Time restart_gap = 0;         ///< before the first start bit of each `put`: the cost of a run of DMA
  Time batch = 0;               ///< an adapter delivers bytes at multiples of this time; 0: each byte at once
  Time jitter = 0;              ///< maximum additional delay; needs a `batch`, and is no longer than it
  Faults faults;
  std::uint64_t seed = 1;  ///< the same seed and the same calls give the same faults, on every machine
};

/// A fault at a given place. Bytes are counted as they are put, from 0.
struct ScriptedFault {
  enum class Kind : std::uint8_t { flip, drop, insert, split };
  std::uint64_t at = 0;
  Kind kind = Kind::flip;
  std::uint8_t value = 1;  ///< flip: the bits that change. insert: the inserted byte
};

/// Exact after every call: put + inserted = handed_over + travelling + dropped + unplugged.
struct WireCounts {
  std::uint64_t put = 0;
  std::uint64_t handed_over = 0;
  std::uint64_t travelling = 0;  ///< now: put, but not read
  std::uint64_t dropped = 0;
  std::uint64_t inserted = 0;
  std::uint64_t unplugged = 0;  ///< did not get through the cable
  std::uint64_t bit_errors = 0;
  std::uint64_t bursts = 0;
  std::uint64_t burst_bytes = 0;
  std::uint64_t splits = 0;
  std::uint64_t collided = 0;  ///< changed, because another end sent at the same time

  constexpr bool closes() const { return put + inserted == handed_over + travelling + dropped + unplugged; }
};

/// Bytes leave at the pace of the baud rate, whenever they are put: as from a driver with a buffer that never fills.
/// `put` costs O(1) and one copy, and each fault O(1); memory grows with the bytes travelling. One thread.
class Wire {
 public:
  explicit Wire(const WireSettings& settings)
      : settings_(settings), random_(settings.seed), hands_over_(settings.seed ^ 0xD1B54A32D192ED03u) {
    const Faults& faults = settings.faults;
    gaps_ = {Gaps(faults.bit_errors), Gaps(faults.bursts), Gaps(faults.drops), Gaps(faults.inserts),
             Gaps(faults.splits)};
    for (Source source : {bit, burst, drop, insert, split}) pass(source);
    find_next();
  }

  const WireSettings& settings() const { return settings_; }
  /// Return the time of this many bytes on the line, in whole nanoseconds, rounded up.
  Time line_time(std::uint64_t bytes) const {
    return (bytes * settings_.bits_per_byte * 1'000'000'000 + settings_.baud - 1) / settings_.baud;
  }
  /// Return when the line can take the next byte.
  Time free_at() const { return start_ + line_time(slots_); }

  // ---- the sender's end

  /// Let this fault happen when its byte is put. In any order, before that.
  void script(const ScriptedFault& fault) {
    const auto behind = std::upper_bound(script_.begin(), script_.end(), fault.at,
                                         [](std::uint64_t at, const ScriptedFault& other) { return at < other.at; });
    script_.insert(behind, fault);
    find_next();
  }

  /// Send one run: the bytes go onto the line at `now`, or as soon as it is free, after the restart gap. Returns the
  /// end of its last stop bit. `now` must not fall from call to call.
  Time put(const std::uint8_t* bytes, std::size_t size, Time now) {
    if (size == 0) return free_at();
    // Runs that follow each other without a gap share one start, so that no rounding adds up.
    if (now > free_at() || settings_.restart_gap != 0 || slots_ > most_slots) {
      begin_at(std::max(now, free_at()) + settings_.restart_gap);
    }
    for (std::size_t i = 0; i < size;) {
      const std::uint64_t clean = std::min<std::uint64_t>(size - i, next_ - counts_.put);
      carry(bytes + i, static_cast<std::size_t>(clean));
      i += static_cast<std::size_t>(clean);
      if (i < size) damage(bytes[i++]);
    }
    return free_at();
  }

  /// Let another end send from `now` until `until`: bytes travelling in that time change. Bytes put after this call are
  /// unaffected.
  void collide(Time now, Time until) {
    const std::uint64_t fresh = collided_until_;  // a byte that meets two runs of the other end changes once
    std::size_t end = bytes_.size();
    for (std::size_t i = segments_.size(); i-- != 0;) {
      const Segment& segment = segments_[i];
      const std::uint64_t done = fresh > segment.sent ? fresh - segment.sent : 0;
      const std::uint64_t first = std::max(arrived_of(segment, now), done);
      const std::uint64_t last = segment.at_once ? first : begun_of(segment, until);
      for (std::uint64_t byte = first; byte < last; ++byte) {
        bytes_[end - static_cast<std::size_t>(segment.count - byte)] ^= collision;
        ++counts_.collided;
      }
      if (first < last) {
        touch(segment.sent + first, segment.sent + last);
        collided_until_ = std::max(collided_until_, segment.sent + last);
      }
      end -= static_cast<std::size_t>(segment.count);
    }
  }

  /// Pull the cable: bytes on the line, and bytes put from now on, are lost. Bytes that an adapter has taken off the
  /// line stay in it.
  void unplug(Time now) {
    is_plugged_ = false;
    while (!segments_.empty()) {
      Segment& last = segments_.back();
      const std::uint64_t arrived = arrived_of(last, now);
      if (arrived == last.count) break;
      const std::uint64_t lost = last.count - arrived;
      const std::uint64_t from = last.sent + (last.at_once ? 0 : arrived);
      touch(from, last.sent + (last.at_once ? 1 : last.count));
      last.count = arrived;
      bytes_.resize(bytes_.size() - static_cast<std::size_t>(lost));
      counts_.travelling -= lost;
      counts_.unplugged += lost;
      if (last.count != 0) break;
      segments_.pop_back();
    }
  }
  void plug() { is_plugged_ = true; }
  /// Pull the adapter out of its computer, together with the cable: all travelling bytes are lost.
  void unplug_adapter(Time now) {
    unplug(now);
    for (const Segment& segment : segments_) {
      touch(segment.sent, segment.sent + (segment.at_once ? 1 : segment.count));
    }
    counts_.unplugged += counts_.travelling;
    counts_.travelling = 0;
    bytes_.clear();
    head_ = 0;
    segments_.clear();
  }
  bool is_plugged() const { return is_plugged_; }

  // ---- the receiver's end

  /// Return when `read` has bytes next; `never`: nothing travels.
  Time next_handover() const {
    if (segments_.empty()) return never;
    const Segment& first = segments_.front();
    const Time end = first.at_once ? first.start : first.start + line_time(first.slot + 1);
    return settings_.batch == 0 ? end : handed_over_at((end + settings_.batch - 1) / settings_.batch);
  }

  /// Pass all bytes that have come out until `now` to `sink(bytes, size)`, in one or more calls, in order. The bytes
  /// live during the call. `most`: maximum number of bytes.
  template <class Sink>
  std::size_t read(Time now, Sink&& sink, std::size_t most = ~std::size_t{0}) {
    const Time until = settings_.batch == 0 ? now : taken_until(now);
    std::size_t size = 0;
    while (!segments_.empty() && size < most) {
      Segment& first = segments_.front();
      const std::uint64_t taken = std::min<std::uint64_t>(arrived_of(first, until), most - size);
      if (follows_ && taken != 0) note_origin(counts_.handed_over + size, first);
      size += static_cast<std::size_t>(taken);
      if (taken != first.count) {
        first.slot += taken;
        first.sent += first.at_once ? 0 : taken;
        first.count -= taken;
        break;
      }
      segments_.pop_front();
    }
    if (size == 0) return 0;
    sink(bytes_.data() + head_, size);
    head_ += size;
    counts_.handed_over += size;
    counts_.travelling -= size;
    if (head_ > compact_at) {
      bytes_.erase(bytes_.begin(), bytes_.begin() + static_cast<std::ptrdiff_t>(head_));
      head_ = 0;
    }
    return size;
  }

  // ---- the truth

  const WireCounts& counts() const { return counts_; }

  /// Check whether a fault touched one of the bytes from number `from` to before number `to`, or came between two of
  /// them. A split changes no byte, and touches none. Ask in order, each byte at most once: bytes before `from` are
  /// forgotten.
  bool was_touched(std::uint64_t from, std::uint64_t to) {
    while (!touched_.empty() && touched_.front().to <= from) touched_.pop_front();
    for (const Touch& touch : touched_) {
      if (touch.from >= to) return false;
      if (!touch.is_between || touch.from > from) return true;
    }
    return false;
  }

  /// Record for `origin_of`, from now on, which byte each delivered one was. Memory grows with faults.
  void follow() { follows_ = true; }
  /// Return the number, when it was put, of the byte with this number among all delivered ones; of an inserted one,
  /// that of the byte before it. Ask in order: earlier ones are forgotten.
  std::uint64_t origin_of(std::uint64_t handed_over) {
    while (origins_.size() > 1 && origins_[1].handed_over <= handed_over) origins_.pop_front();
    if (origins_.empty()) return handed_over;
    const Origin& origin = origins_.front();
    if (origin.at_once) return origin.sent == 0 ? 0 : origin.sent - 1;
    return origin.sent + (handed_over - origin.handed_over);
  }

 private:
  enum Source : std::uint8_t { bit, burst, drop, insert, split, sources };

  /// Bytes that come out one after the other: byte i ends with slot `slot + i` after `start`.
  struct Segment {
    Time start;
    std::uint64_t slot;
    std::uint64_t count;
    std::uint64_t sent;  ///< number of its first byte; of an inserted one, of the byte that it precedes
    bool at_once;        ///< it takes no line time, and comes at `start`
  };
  struct Touch {
    std::uint64_t from;
    std::uint64_t to;
    bool is_between;  ///< before byte `from`, which is whole
  };

  /// From byte `handed_over` on, bytes follow each other as they were put from `sent` on.
  struct Origin {
    std::uint64_t handed_over;
    std::uint64_t sent;
    bool at_once;
  };

  void note_origin(std::uint64_t handed_over, const Segment& from) {
    if (!origins_.empty()) {
      const Origin& last = origins_.back();
      const bool goes_on = !last.at_once && !from.at_once;
      if (goes_on && from.sent - last.sent == handed_over - last.handed_over) return;
    }
    origins_.push_back({handed_over, from.sent, from.at_once});
  }

  static constexpr std::uint64_t most_slots = std::uint64_t{1} << 26;  ///< of one start: products stay below 2^63
  static constexpr std::size_t compact_at = 65'536;
  static constexpr std::uint8_t collision = 0x5A;  ///< the bits that change if two ends send

  void begin_at(Time start) {
    start_ = start;
    slots_ = 0;
  }

  std::uint64_t arrived_of(const Segment& segment, Time until) const {
    if (until < segment.start) return 0;
    if (segment.at_once) return segment.count;
    const std::uint64_t slots = std::min<Time>(until - segment.start, line_time(segment.slot + segment.count)) *
                                settings_.baud / (std::uint64_t{settings_.bits_per_byte} * 1'000'000'000);
    return slots <= segment.slot ? 0 : std::min(slots - segment.slot, segment.count);
  }

  /// Return how many of its bytes begin before `until`.
  std::uint64_t begun_of(const Segment& segment, Time until) const {
    std::uint64_t begun = arrived_of(segment, until);
    if (begun != segment.count && segment.start + line_time(segment.slot + begun) < until) ++begun;
    return begun;
  }

  /// Return when the batch with this number is delivered.
  Time handed_over_at(std::uint64_t batch) const {
    if (settings_.jitter == 0) return batch * settings_.batch;
    return batch * settings_.batch + Random(hands_over_ + batch).below(settings_.jitter + 1);
  }
  /// Return the time until which bytes that left the line are delivered by `now`.
  Time taken_until(Time now) const {
    const std::uint64_t batch = now / settings_.batch;
    return (batch == 0 || handed_over_at(batch) <= now ? batch : batch - 1) * settings_.batch;
  }

  /// Carry bytes unchanged.
  void carry(const std::uint8_t* bytes, std::size_t size) {
    if (size == 0) return;
    const std::uint64_t number = counts_.put;
    counts_.put += size;
    const std::uint64_t slot = slots_;
    slots_ += size;
    if (!is_plugged_) {
      touch(number, number + size);
      counts_.unplugged += size;
      return;
    }
    bytes_.insert(bytes_.end(), bytes, bytes + size);
    counts_.travelling += size;
    Segment* const last = segments_.empty() ? nullptr : &segments_.back();
    if (last != nullptr && !last->at_once && last->start == start_ && last->slot + last->count == slot) {
      last->count += size;
    } else {
      segments_.push_back({start_, slot, size, number, false});
    }
  }

  /// Carry the next byte, with its faults.
  void damage(std::uint8_t byte) {
    const std::uint64_t number = counts_.put;
    bool is_touched = false;
    bool is_dropped = false;
    bool pauses = false;
    while (at_[bit] / settings_.bits_per_byte == number) {
      const std::uint64_t place = at_[bit] % settings_.bits_per_byte;
      // Start bit first, then eight data bits; after them parity and stop bits.
      byte = place >= 1 && place <= 8 ? static_cast<std::uint8_t>(byte ^ (1u << (place - 1)))
                                      : static_cast<std::uint8_t>(random_.next());
      ++counts_.bit_errors;
      is_touched = true;
      pass(bit);
    }
    if (at_[burst] == number) {
      burst_until_ = number + settings_.faults.burst_bytes;
      ++counts_.bursts;
      pass(burst);
    }
    if (number < burst_until_) {
      byte = static_cast<std::uint8_t>(random_.next());
      ++counts_.burst_bytes;
      is_touched = true;
    }
    if (at_[insert] == number) {
      put_in(static_cast<std::uint8_t>(random_.next()));
      pass(insert);
    }
    if (at_[drop] == number) {
      is_dropped = true;
      pass(drop);
    }
    if (at_[split] == number) {
      pauses = true;
      pass(split);
    }
    for (; !script_.empty() && script_.front().at <= number; script_.erase(script_.begin())) {
      const ScriptedFault fault = script_.front();
      if (fault.at < number) continue;  // scripted too late
      switch (fault.kind) {
        case ScriptedFault::Kind::flip:
          byte = static_cast<std::uint8_t>(byte ^ fault.value);
          ++counts_.bit_errors;
          is_touched = true;
          break;
        case ScriptedFault::Kind::drop: is_dropped = true; break;
        case ScriptedFault::Kind::insert: put_in(fault.value); break;
        case ScriptedFault::Kind::split: pauses = true; break;
      }
    }
    if (is_dropped) {
      touch(number, number + 1);
      ++counts_.put;
      ++slots_;
      ++counts_.dropped;
    } else {
      if (is_touched) touch(number, number + 1);
      carry(&byte, 1);
    }
    if (pauses) {
      ++counts_.splits;
      begin_at(free_at() + settings_.faults.split_pause);
    }
    find_next();
  }

  /// Insert a byte that nobody sent before the next one.
  void put_in(std::uint8_t byte) {
    if (!is_plugged_) return;
    touched_.push_back({counts_.put, counts_.put + 1, true});
    bytes_.push_back(byte);
    segments_.push_back({free_at(), 0, 1, counts_.put, true});
    ++counts_.inserted;
    ++counts_.travelling;
  }

  void touch(std::uint64_t from, std::uint64_t to) {
    if (!touched_.empty() && !touched_.back().is_between && touched_.back().to == from) {
      touched_.back().to = to;
    } else if (touched_.empty() || touched_.back().from <= from) {
      touched_.push_back({from, to, false});
    } else {  // of bytes put before others that are touched already: the cable was pulled
      const auto behind = std::upper_bound(touched_.begin(), touched_.end(), from,
                                           [](std::uint64_t at, const Touch& other) { return at < other.from; });
      touched_.insert(behind, {from, to, false});
    }
  }

  /// Draw where this source strikes next.
  void pass(Source source) {
    const std::uint64_t gap = gaps_[source].next(random_);
    const std::uint64_t behind = has_begun_[source] ? at_[source] + 1 : 0;
    at_[source] = gap >= no_place - behind ? no_place : behind + gap;
    has_begun_[source] = true;
  }

  /// Find the number of the next byte with a fault.
  void find_next() {
    next_ = at_[bit] == no_place ? no_place : at_[bit] / settings_.bits_per_byte;
    for (Source source : {burst, drop, insert, split}) next_ = std::min(next_, at_[source]);
    if (counts_.put < burst_until_) next_ = std::min(next_, counts_.put);
    if (!script_.empty()) next_ = std::min(next_, std::max(script_.front().at, counts_.put));
  }

  WireSettings settings_;
  Random random_;
  std::uint64_t hands_over_;  ///< seed of the batches' jitter
  std::array<Gaps, sources> gaps_{};
  std::array<std::uint64_t, sources> at_{};  ///< where each strikes next: a byte's number; for `bit`, a bit's
  std::array<bool, sources> has_begun_{};
  std::uint64_t burst_until_ = 0;
  std::uint64_t next_ = no_place;
  std::vector<ScriptedFault> script_;

  Time start_ = 0;  ///< of the bytes that follow each other without a gap; `slots_` of them were put
  std::uint64_t slots_ = 0;
  bool is_plugged_ = true;
  std::vector<std::uint8_t> bytes_;  ///< from `head_` on: travelling bytes
  std::size_t head_ = 0;
  std::uint64_t collided_until_ = 0;  ///< no other end has changed a byte from this number on
  std::deque<Segment> segments_;
  std::deque<Touch> touched_;
  std::deque<Origin> origins_;
  bool follows_ = false;
  WireCounts counts_;
};

}  // namespace wirebond::sim
