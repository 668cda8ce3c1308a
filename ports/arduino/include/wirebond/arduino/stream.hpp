// A port: any Stream of Arduino, such as Serial1. It knows the class and no register.
#pragma once

#include <Arduino.h>

#include <cstddef>
#include <cstdint>

#include "wirebond/mcu/atomics.hpp"
#include "wirebond/mcu/software_ring.hpp"

namespace wirebond::arduino {

/// Call in `loop`, as often as you can, and in one context with the link's `poll`:
///     port.service(link);
///     link.poll(micros());
/// This stands for the UART's interrupt of a link. `setup` begins the stream with the file's baud rate.
///
/// What finds no room in the receive ring waits in the stream. The stream's own buffer must hold what comes while
/// `loop` does something else; it loses what comes beyond that, and does not count it.
class StreamPort {
 public:
  /// `may_block`: for streams whose `availableForWrite` is always 0. A run is then written in one call, which waits
  /// until the stream has taken it.
  explicit StreamPort(Stream& stream, bool may_block = false) : stream_(stream), may_block_(may_block) {}

  static constexpr bool tells_every_lap = true;  ///< there is no DMA that could lap unseen

  bool start_receive(std::uint8_t* ring, std::size_t size) {
    ring_.start(ring, size);
    return true;
  }
  bool receiving() const { return ring_.runs(); }
  std::size_t receive_position() const { return ring_.place(); }
  void stop_receive() { ring_.stop(); }

  bool start_transmit(const std::uint8_t* bytes, std::size_t size) {
    if (left_ != 0) return false;
    next_ = bytes;
    left_ = size;
    return true;
  }
  void stop_transmit() { left_ = 0; }

  /// Any task, any interrupt: the next `service` does it.
  void pend() { is_pended_.store(true, std::memory_order_release); }  // pairs with `service`

  bool reaches(const void*, std::size_t) const { return true; }

  /// By the link, after each poll.
  void read_to(std::size_t place) { ring_.read_to(place); }

  template <class Link>
  void service(Link& link) {
    receive(link);
    transmit(link);
    if (is_pended_.load(std::memory_order_acquire)) {  // pairs with `pend`
      is_pended_.store(false, std::memory_order_relaxed);
      link.on_pended();
      transmit(link);
    }
  }

 private:
  template <class Link>
  void receive(Link& link) {
    bool has_come = false;
    while (ring_.room() != 0 && stream_.available() > 0) {
      const int byte = stream_.read();
      if (byte < 0) break;
      const auto value = static_cast<std::uint8_t>(byte);
      ring_.put(&value, 1);
      has_come = true;
    }
    if (has_come) link.on_received();
  }

  template <class Link>
  void transmit(Link& link) {
    while (left_ != 0) {
      const int free = may_block_ ? static_cast<int>(left_) : stream_.availableForWrite();
      if (free <= 0) return;
      const std::size_t most = static_cast<std::size_t>(free) < left_ ? static_cast<std::size_t>(free) : left_;
      const std::size_t count = stream_.write(next_, most);
      if (count == 0) return;
      next_ += count;
      left_ -= count;
      if (left_ == 0) link.on_transmitted();  // it may start the next run
    }
  }

  Stream& stream_;
  bool may_block_;
  SoftwareRing ring_;
  const std::uint8_t* next_ = nullptr;
  std::size_t left_ = 0;
  LoadStore<bool> is_pended_{false};
};

}  // namespace wirebond::arduino
