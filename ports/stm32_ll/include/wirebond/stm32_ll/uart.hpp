// A port: a UART of an STM32 by its registers, with circular DMA in and DMA out, for projects without the HAL. It needs
// only the vendor's device header, which projects with the LL drivers or without any have.
#pragma once

#include <cstddef>
#include <cstdint>

#include "wirebond/mcu/line_errors.hpp"
#include "wirebond/mcu/why.hpp"
#include "wirebond/stm32_ll/registers.h"

namespace wirebond::stm32_ll {

/// `{USART3, DMA1, DMA1_Stream1, 1, DMA1_Stream3, 3, USART3_IRQn}`: see registers.h.
using Wiring = wirebond_stm32_wiring_t;

/// Your project sets up clocks, pins, the UART (speed and format, receiver and transmitter on), and both carriers:
/// their channel or request, bytes on both sides, memory increment, receive circular, transmit not. It enables two
/// interrupts with one priority. The rest is done here; forward the two handlers:
///   USARTn_IRQHandler -> uart.usart_interrupt(link)    of the receive carrier -> uart.receive_interrupt(link)
/// The transmit carrier needs no interrupt: a run is complete when the UART reports that its last stop bit has left.
/// All functions except `pend` and `receive_position` are for these interrupts; Link calls them only there.
///
/// Line errors raise no interrupt: DMA continues, and the checks reject the frame. The UART's status shows the errors
/// since its last interrupt.
class Uart {
 public:
  explicit Uart(const Wiring& wiring) : uart_{wiring, 0, false, {0, 0}} {}

  /// Returns false while the carrier does not stop: DMA ends the transfer of one byte first.
  bool start_receive(std::uint8_t* ring, std::size_t size) { return wirebond_stm32_start_receive(&uart_, ring, size); }

  /// Returns false after a bus error, which stops the carrier, and after a carrier in normal mode has filled the ring.
  bool receiving() const { return wirebond_stm32_receiving(&uart_); }

  /// Any context.
  std::size_t receive_position() const { return wirebond_stm32_receive_position(&uart_); }

  /// Called when a link is stopped.
  void stop_receive() { wirebond_stm32_stop_receive(&uart_); }

  bool start_transmit(const std::uint8_t* bytes, std::size_t size) {
    return wirebond_stm32_start_transmit(&uart_, bytes, size);
  }

  void stop_transmit() { wirebond_stm32_stop_transmit(&uart_); }

  /// Any task, any interrupt.
  void pend() { NVIC_SetPendingIRQ(uart_.wiring.interrupt); }

  /// DMA counts bytes in 16 bits, and does not reach all memory.
  bool reaches(const void* bytes, std::size_t size) const {
    return wirebond_stm32_dma_reaches(WIREBOND_STM32_FAMILY, reinterpret_cast<std::uintptr_t>(bytes), size);
  }

  /// Return the errors in the UART's status since the last call.
  LineErrors take_line_errors() {
    const std::uint32_t flags = wirebond_stm32_take_errors(&uart_);
    return {(flags & WIREBOND_STM32_FRAMING) != 0, (flags & WIREBOND_STM32_NOISE) != 0,
            (flags & WIREBOND_STM32_OVERRUN) != 0, (flags & WIREBOND_STM32_PARITY) != 0};
  }

  /// For Link::why: return the fault of the settings. The baud rate is not compared: registers do not show the clock.
  Why check(std::uint32_t) const { return static_cast<Why>(wirebond_stm32_check(&uart_)); }

  // ---- the two handlers

  template <class Link>
  void usart_interrupt(Link& link) {
    link.on_pended();  // first: it reads the status, whose errors may be cleared below
    const wirebond_stm32_events_t events = wirebond_stm32_usart_events(&uart_);
    if (events.received) link.on_received();
    if (events.transmitted) link.on_transmitted();
  }

  template <class Link>
  void receive_interrupt(Link& link) {
    wirebond_stm32_receive_event(&uart_) ? link.on_received() : link.on_error();
  }

 private:
  wirebond_stm32_registers_t uart_;
};

}  // namespace wirebond::stm32_ll
