// A port: any Stream of Arduino, such as Serial1. It uses the class and no register.
#pragma once

#include <Arduino.h>

#include <cstddef>
#include <cstdint>

#include "wirebond/mcu/serviced_port.hpp"

namespace wirebond::arduino {

/// Call it in `loop`, as often as you can, and in one context with the link's `poll`:
///     port.service(link);
///     link.poll(micros());
/// This replaces the UART's interrupt of a link. `setup` begins the stream with the file's baud rate.
///
/// Bytes that do not fit into the receive ring wait in the stream. The stream's own buffer must hold the bytes that
/// come while `loop` does other work; it loses any more, and does not count them.
class StreamPort : public ServicedPort<StreamPort> {
 public:
  /// `may_block`: for streams whose `availableForWrite` is always 0. A run is then written in one call, which waits
  /// until the stream has taken it.
  explicit StreamPort(Stream& stream, bool may_block = false) : stream_(stream), may_block_(may_block) {}

  /// For Link::why, which detects with it that `poll` gets another clock than micros().
  std::uint32_t tick_ms() const { return static_cast<std::uint32_t>(millis()); }

  /// For DriverEnable: wait until the last bit has left, which takes as long as sending the stream's buffer.
  void wait_until_sent() { stream_.flush(); }

 private:
  friend ServicedPort<StreamPort>;

  std::size_t read(std::uint8_t* bytes, std::size_t most) {
    std::size_t count = 0;
    while (count != most && stream_.available() > 0) {
      const int byte = stream_.read();
      if (byte < 0) break;
      bytes[count++] = static_cast<std::uint8_t>(byte);
    }
    return count;
  }

  std::size_t write(const std::uint8_t* bytes, std::size_t size) {
    const int free = may_block_ ? static_cast<int>(size) : stream_.availableForWrite();
    if (free <= 0) return 0;
    return stream_.write(bytes, static_cast<std::size_t>(free) < size ? static_cast<std::size_t>(free) : size);
  }

  Stream& stream_;
  bool may_block_;
};

}  // namespace wirebond::arduino
