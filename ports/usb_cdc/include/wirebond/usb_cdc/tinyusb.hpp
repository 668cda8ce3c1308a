// A port: a virtual serial port over USB, by TinyUSB's class CDC. It knows the class and no register.
#pragma once

#include <cstddef>
#include <cstdint>

#include "tusb.h"
#include "wirebond/mcu/atomics.hpp"
#include "wirebond/mcu/software_ring.hpp"

namespace wirebond::usb_cdc {

/// Call in the task that has TinyUSB, or in the main loop, as often as `link.poll`, and in one context with it:
///     tud_task();
///     port.service(link);
///     link.poll(now_us);
/// This stands for the UART's interrupt of a link: no callback of TinyUSB is needed.
///
/// The link is down while no program has the port open (DTR), USB is not configured, or the computer sleeps. What finds
/// no room in the receive ring waits with TinyUSB and then with the computer (NAK), and no byte is lost to a late poll.
/// A run has no time limit: a program that has the port open may be slow to read.
class TinyUsb {
 public:
  /// `interface`: which of TinyUSB's CDC interfaces, from 0 on.
  explicit TinyUsb(std::uint8_t interface = 0) : interface_(interface) {}

  static constexpr bool tells_every_lap = true;  ///< there is no DMA that could lap unseen
  static constexpr bool may_wait = true;         ///< for the computer, without a limit

  bool start_receive(std::uint8_t* ring, std::size_t size) {
    ring_.start(ring, size);
    return true;
  }
  bool receiving() const { return ring_.runs(); }
  std::size_t receive_position() const { return ring_.place(); }
  void stop_receive() {
    ring_.stop();
    tud_cdc_n_read_flush(interface_);
  }

  bool start_transmit(const std::uint8_t* bytes, std::size_t size) {
    if (left_ != 0) return false;
    next_ = bytes;
    left_ = size;
    return true;
  }
  void stop_transmit() {
    left_ = 0;
    tud_cdc_n_write_clear(interface_);
  }

  /// Any task, any interrupt: the next `service` does it.
  void pend() { is_pended_.store(true, std::memory_order_release); }  // pairs with `service`

  bool reaches(const void*, std::size_t) const { return true; }

  bool connected() const { return tud_cdc_n_connected(interface_); }

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
    if (!ring_.runs()) return;
    bool has_come = false;
    std::uint8_t packet[64];
    for (std::size_t room = ring_.room(); room != 0; room = ring_.room()) {
      const std::size_t most = room < sizeof packet ? room : sizeof packet;
      const std::uint32_t count = tud_cdc_n_read(interface_, packet, static_cast<std::uint32_t>(most));
      if (count == 0) break;
      ring_.put(packet, count);
      has_come = true;
    }
    if (has_come) link.on_received();
  }

  template <class Link>
  void transmit(Link& link) {
    while (left_ != 0) {
      const std::uint32_t count = tud_cdc_n_write(interface_, next_, static_cast<std::uint32_t>(left_));
      tud_cdc_n_write_flush(interface_);
      if (count == 0) return;
      next_ += count;
      left_ -= count;
      if (left_ == 0) link.on_transmitted();  // it may start the next run
    }
  }

  std::uint8_t interface_;
  SoftwareRing ring_;
  const std::uint8_t* next_ = nullptr;
  std::size_t left_ = 0;
  LoadStore<bool> is_pended_{false};
};

}  // namespace wirebond::usb_cdc
