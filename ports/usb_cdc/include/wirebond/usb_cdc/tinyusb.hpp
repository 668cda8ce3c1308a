// A port: a virtual serial port over USB, by TinyUSB's class CDC. It uses the class and no register.
#pragma once

#include <cstddef>
#include <cstdint>

#include "tusb.h"
#include "wirebond/mcu/serviced_port.hpp"

namespace wirebond::usb_cdc {

/// Call it in the task that has TinyUSB, or in the main loop, as often as `link.poll`, and in one context with it:
///     tud_task();
///     port.service(link);
///     link.poll(now_us);
/// This replaces the UART's interrupt of a link: no callback of TinyUSB is needed.
///
/// The link is down while no program has the port open (DTR), USB is not configured, or the computer sleeps. Bytes that
/// do not fit into the receive ring wait in TinyUSB and then in the computer (NAK), and no byte is lost to a late poll.
/// A run has no time limit: a program that has the port open may be slow to read.
class TinyUsb : public ServicedPort<TinyUsb> {
 public:
  /// `interface`: index of TinyUSB's CDC interface, from 0.
  explicit TinyUsb(std::uint8_t interface = 0) : interface_(interface) {}

  static constexpr bool may_wait = true;  ///< waits for the computer, without a limit

  void stop_receive() {
    ServicedPort::stop_receive();
    tud_cdc_n_read_flush(interface_);
  }
  void stop_transmit() {
    ServicedPort::stop_transmit();
    tud_cdc_n_write_clear(interface_);
  }

  bool connected() const { return tud_cdc_n_connected(interface_); }

 private:
  friend ServicedPort<TinyUsb>;

  std::size_t read(std::uint8_t* bytes, std::size_t most) {
    return tud_cdc_n_read(interface_, bytes, static_cast<std::uint32_t>(most));
  }

  std::size_t write(const std::uint8_t* bytes, std::size_t size) {
    const std::uint32_t count = tud_cdc_n_write(interface_, bytes, static_cast<std::uint32_t>(size));
    tud_cdc_n_write_flush(interface_);
    return count;
  }

  std::uint8_t interface_;
};

}  // namespace wirebond::usb_cdc
