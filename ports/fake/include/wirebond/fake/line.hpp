// One direction of a simulated serial line: a byte clock, faults, a cable, and the truth about every byte sent on it.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <deque>
#include <numeric>
#include <vector>

#include "wirebond/fake/draw.hpp"

namespace wirebond::fake {

/// Nanoseconds on the time line that all parts of a simulation share.
using Time = std::uint64_t;
inline constexpr Time never = ~Time{0};

/// Fault that the receiving UART finds in a byte.
enum class Fault : std::uint8_t {
  none,
  framing,  ///< no stop bit
  noise,    ///< samples of one bit disagree
  overrun,  ///< DMA did not fetch the byte in time, so it is lost
};

/// Outcome of a byte. Each byte has exactly one fate.
enum class Fate : std::uint8_t {
  travelling,  ///< not yet at the receiver
  received,    ///< in the receiver's memory, and no fault was found
  damaged,     ///< in the receiver's memory, with a framing or noise error
  dropped,     ///< discarded by the receiver because of its framing or noise error
  overrun,     ///< lost by the receiver
  unheard,     ///< came while reception was stopped
  unplugged,   ///< never got through the cable
};
inline constexpr std::size_t fates = 7;

struct LineByte {
  Time end;           ///< of its last stop bit
  std::uint8_t sent;  ///< as it was sent
  std::uint8_t seen;  ///< as it was received
  Fault fault;
  Fate fate;
};

/// Faults of the line, per million bytes.
struct LineFaults {
  std::uint32_t framing = 0;
  std::uint32_t noise = 0;
  std::uint32_t overrun = 0;
  std::uint32_t flipped = 0;  ///< one bit is wrong and the UART does not notice
};

/// Bytes are put on it at one end and taken in order at the other. One thread.
class Line {
 public:
  /// `bits_per_byte` includes start and stop bits: 10 for 8N1, 11 for 8N2.
  Line(std::uint32_t baud, std::uint32_t bits_per_byte, std::uint64_t seed = 1)
      : byte_time_((std::uint64_t{bits_per_byte} * 1'000'000'000 + baud - 1) / baud), draw_(seed) {}

  Time byte_time() const { return byte_time_; }
  /// Return when the line can take the next byte.
  Time free_at() const { return free_at_; }

  LineFaults faults;

  /// Put one byte on the line at `now`, or as soon as it is free. Returns when its last stop bit ends. `fault` happens
  /// to it, unless `faults` draws another.
  Time put(std::uint8_t byte, Time now, Fault fault = Fault::none) {
    const Time start = now > free_at_ ? now : free_at_;
    free_at_ = start + byte_time_;
    LineByte entry{free_at_, byte, byte, fault, Fate::travelling};
    if (fault == Fault::none) draw_fault(entry);
    // A byte with an error flag may have any value, often the right one.
    if (entry.fault == Fault::framing || entry.fault == Fault::noise) {
      if (draw_.chance(500'000)) entry.seen = static_cast<std::uint8_t>(draw_.next());
    }
    bytes_.push_back(entry);
    ++count_[index(Fate::travelling)];
    ++put_;
    if (!plugged_) move(bytes_.back(), Fate::unplugged);
    pass_settled();
    return free_at_;
  }

  Time put(const std::uint8_t* bytes, std::size_t size, Time now) {
    for (std::size_t i = 0; i < size; ++i) put(bytes[i], now);
    return free_at_;
  }
  Time put(const std::vector<std::uint8_t>& bytes, Time now) { return put(bytes.data(), bytes.size(), now); }

  /// Pull the cable at `now`. A byte being sent ends without a stop bit; later ones do not get through.
  void unplug(Time now) {
    plugged_ = false;
    for (std::size_t i = arrived_; i < bytes_.size(); ++i) {
      LineByte& byte = bytes_[i];
      if (byte.fate != Fate::travelling) continue;
      if (byte.end <= now) continue;
      if (byte.end < now + byte_time_) {
        byte.fault = Fault::framing;
        byte.seen = static_cast<std::uint8_t>(draw_.next());
      } else {
        move(byte, Fate::unplugged);
      }
    }
    pass_settled();
  }
  void plug() { plugged_ = true; }
  bool plugged() const { return plugged_; }

  // ---- the receiver's end

  /// Return the next byte that arrives, or null.
  const LineByte* arriving() const { return arrived_ < bytes_.size() ? &bytes_[arrived_] : nullptr; }
  Time next_arrival() const { return arrived_ < bytes_.size() ? bytes_[arrived_].end : never; }

  /// Take the byte that arrived, and note its fate.
  void take(Fate fate) {
    move(bytes_[arrived_], fate);
    pass_settled();
  }

  /// For an end that is not an `Uart`: return all bytes that arrived until `now`, as a tty gives them, including faulty
  /// ones.
  std::vector<std::uint8_t> read(Time now) {
    std::vector<std::uint8_t> out;
    while (next_arrival() <= now) {
      const LineByte byte = *arriving();
      const bool lost = byte.fault == Fault::overrun;
      if (!lost) out.push_back(byte.seen);
      take(lost ? Fate::overrun : byte.fault == Fault::none ? Fate::received : Fate::damaged);
    }
    return out;
  }

  // ---- the truth

  std::uint64_t put_count() const { return put_; }
  std::uint64_t count(Fate fate) const { return count_[index(fate)]; }
  /// Check whether every byte has one fate.
  bool closes() const { return std::accumulate(count_.begin(), count_.end(), std::uint64_t{0}) == put_; }
  /// Return every byte since the start, or since `forget`.
  const std::deque<LineByte>& bytes() const { return bytes_; }
  /// Return how many bytes were put before the first of `bytes`.
  std::uint64_t forgotten() const { return forgotten_; }
  /// Drop the bytes that arrived; the counts stay.
  void forget() {
    forgotten_ += arrived_;
    bytes_.erase(bytes_.begin(), bytes_.begin() + static_cast<std::ptrdiff_t>(arrived_));
    arrived_ = 0;
  }

 private:
  static constexpr std::size_t index(Fate fate) { return static_cast<std::size_t>(fate); }

  void draw_fault(LineByte& byte) {
    if (draw_.chance(faults.framing)) {
      byte.fault = Fault::framing;
    } else if (draw_.chance(faults.noise)) {
      byte.fault = Fault::noise;
    } else if (draw_.chance(faults.overrun)) {
      byte.fault = Fault::overrun;
    } else if (draw_.chance(faults.flipped)) {
      byte.seen = static_cast<std::uint8_t>(byte.sent ^ (1u << draw_.below(8)));
    }
  }

  void move(LineByte& byte, Fate fate) {
    --count_[index(byte.fate)];
    byte.fate = fate;
    ++count_[index(fate)];
  }

  void pass_settled() {
    while (arrived_ < bytes_.size() && bytes_[arrived_].fate != Fate::travelling) ++arrived_;
  }

  Time byte_time_;
  Draw draw_;
  Time free_at_ = 0;
  bool plugged_ = true;
  std::deque<LineByte> bytes_;
  std::size_t arrived_ = 0;  ///< index in `bytes_`: earlier ones are settled, this one travels
  std::uint64_t put_ = 0;
  std::uint64_t forgotten_ = 0;
  std::array<std::uint64_t, fates> count_{};
};

}  // namespace wirebond::fake
