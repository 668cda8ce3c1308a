// Bytes that a UART receives from a sender with another rate or shape. No clock: bits in, bytes out.
#pragma once

#include <cstddef>
#include <cstdint>
#include <vector>

namespace wirebond::sim {

enum class Parity : std::uint8_t { none, even, odd };

/// Settings with which an end of a line sends and receives.
struct UartShape {
  std::uint32_t baud = 115'200;
  unsigned data_bits = 8;
  Parity parity = Parity::none;
  unsigned stop_bits = 1;

  unsigned bits_per_byte() const { return 1 + data_bits + (parity != Parity::none ? 1 : 0) + stop_bits; }
  /// Check whether an end of this shape can read a sender of the other shape. A receiver checks only one stop bit.
  bool understands(const UartShape& sender) const {
    return baud == sender.baud && data_bits == sender.data_bits && parity == sender.parity;
  }
};

/// A start bit is a falling edge of the line; each bit is sampled once, in its middle. A wrong stop or parity bit loses
/// nothing: a tty in raw mode gives the byte as it was sampled. Rates within a factor of 1000. One thread.
class UartReceiver {
 public:
  UartReceiver(const UartShape& sender, const UartShape& receiver) : sender_(sender), receiver_(receiver) { rest(); }

  /// Take bytes that follow the earlier ones without a pause. Calls `sink(byte)` for each byte received by now.
  template <class Sink>
  void take(const std::uint8_t* bytes, std::size_t size, Sink&& sink) {
    for (std::size_t i = 0; i < size; ++i) send(bytes[i]);
    hear(sink);
  }

  /// Let the line rest, so that the last byte can be received.
  template <class Sink>
  void rest(Sink&& sink) {
    rest();
    hear(sink);
  }

 private:
  /// Keep the line high for longer than the receiver takes for a byte.
  void rest() {
    const std::uint64_t bits = (receiver_.bits_per_byte() + 2) * std::uint64_t{sender_.baud} / receiver_.baud + 2;
    levels_.insert(levels_.end(), static_cast<std::size_t>(bits), 1);
  }

  void send(std::uint8_t byte) {
    unsigned ones = 0;
    levels_.push_back(0);
    for (unsigned bit = 0; bit < sender_.data_bits; ++bit) {
      const std::uint8_t level = byte >> bit & 1;
      levels_.push_back(level);
      ones += level;
    }
    if (sender_.parity != Parity::none) levels_.push_back((ones & 1) ^ (sender_.parity == Parity::odd ? 1u : 0u));
    levels_.insert(levels_.end(), sender_.stop_bits, 1);
  }

  /// Return the sender's bits from the start bit's edge to the middle of this bit of the receiver; 0 is the start bit.
  std::size_t middle_of(unsigned bit) const {
    return static_cast<std::size_t>((2 * bit + 1) * std::uint64_t{sender_.baud} / (2 * std::uint64_t{receiver_.baud}));
  }

  template <class Sink>
  void hear(Sink&& sink) {
    const unsigned stop = 1 + receiver_.data_bits + (receiver_.parity != Parity::none ? 1 : 0);
    std::size_t at = 0;
    for (;;) {
      std::size_t begin = at;
      while (begin < levels_.size() && levels_[begin] == 0) ++begin;
      while (begin < levels_.size() && levels_[begin] != 0) ++begin;
      if (begin == levels_.size()) {
        at = levels_.size() - 1;  // its last level: an edge may follow
        break;
      }
      if (begin + middle_of(stop) >= levels_.size()) break;
      std::uint8_t byte = 0;
      for (unsigned bit = 0; bit < receiver_.data_bits; ++bit) {
        byte = static_cast<std::uint8_t>(byte | levels_[begin + middle_of(1 + bit)] << bit);
      }
      sink(byte);
      at = begin + middle_of(stop);
    }
    levels_.erase(levels_.begin(), levels_.begin() + static_cast<std::ptrdiff_t>(at));
  }

  UartShape sender_;
  UartShape receiver_;
  std::vector<std::uint8_t> levels_;  ///< levels of the line, one for each bit of the sender; never empty
};

}  // namespace wirebond::sim
