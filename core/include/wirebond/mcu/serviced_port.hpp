// Common part of ports without an interrupt: their work is done where `service` is called. No register, no driver.
#pragma once

#include <cstddef>
#include <cstdint>

#include "wirebond/load_store.hpp"
#include "wirebond/mcu/software_ring.hpp"

namespace wirebond {

/// Call `service` in the context of the link's `poll`, as often as that; it replaces the UART's interrupt of a link.
/// Bytes that do not fit into the receive ring wait in `Port`, which derives from this and has:
/// - `std::size_t read(std::uint8_t* bytes, std::size_t most)`: take at most `most` received bytes; returns how many
/// - `std::size_t write(const std::uint8_t* bytes, std::size_t size)`: send some of these; returns how many it took
template <class Port>
class ServicedPort {
 public:
  static constexpr bool is_unpaced = true;       ///< bytes wait in `Port`, and it may be USB
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

  /// Request the next `service` to do the interrupt's work. Any task, any interrupt.
  void pend() { is_pended_.store(true, std::memory_order_release); }  // pairs with `service`

  bool reaches(const void*, std::size_t) const { return true; }

  /// Called by the link, after each poll.
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
    std::uint8_t piece[64];
    for (std::size_t room = ring_.room(); room != 0; room = ring_.room()) {
      const std::size_t count = port().read(piece, room < sizeof piece ? room : sizeof piece);
      if (count == 0) break;
      ring_.put(piece, count);
      has_come = true;
    }
    if (has_come) link.on_received();
  }

  template <class Link>
  void transmit(Link& link) {
    while (left_ != 0) {
      const std::size_t count = port().write(next_, left_);
      if (count == 0) return;
      next_ += count;
      left_ -= count;
      if (left_ == 0) link.on_transmitted();  // it may start the next run
    }
  }

  Port& port() { return static_cast<Port&>(*this); }

  SoftwareRing ring_;
  const std::uint8_t* next_ = nullptr;
  std::size_t left_ = 0;
  LoadStore<bool> is_pended_{false};
};

}  // namespace wirebond
