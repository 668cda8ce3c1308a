// A port: a UART of an STM32 by its registers, with circular DMA in and DMA out, where the HAL is in the way. It needs
// the vendor's device header alone, as projects with the LL drivers or without any have it.
#pragma once

#include <cstddef>
#include <cstdint>

#include "wirebond/mcu/line_errors.hpp"
#include "wirebond/mcu/why.hpp"
#include "wirebond/stm32_ll/registers.h"

namespace wirebond::stm32_ll {

/// `{USART3, DMA1, DMA1_Stream1, 1, DMA1_Stream3, 3, USART3_IRQn}`: registers.h says what these are.
using Wiring = wirebond_stm32_wiring_t;

/// Your project sets up clocks, pins, the UART (speed and format, receiver and transmitter on), and both carriers:
/// their channel or request, bytes on both sides, memory increment, receive circular, transmit not. It enables two
/// interrupts with one priority. The rest is done here; forward the two handlers:
///   USARTn_IRQHandler -> uart.usart_interrupt(link)    of the receive carrier -> uart.receive_interrupt(link)
/// The transmit carrier needs no interrupt: a run is complete when the UART says that its last stop bit has left.
/// All functions but `pend` and `receive_position` are for these interrupts; Link keeps to that.
///
/// Line errors raise no interrupt: DMA goes on, and the checks refuse the frame. The UART's status says what happened
/// since its last interrupt.
class Uart {
 public:
  explicit Uart(const Wiring& wiring) : uart_{wiring, 0, false, {0, 0}} {}

  /// False while the carrier does not stop: DMA ends the transfer of one byte first.
  bool start_receive(std::uint8_t* ring, std::size_t size) { return wirebond_stm32_start_receive(&uart_, ring, size); }

  /// False after a bus error, which stops the carrier.
  bool receiving() const { return wirebond_stm32_receiving(&uart_); }

  /// Any context.
  std::size_t receive_position() const { return wirebond_stm32_receive_position(&uart_); }

  /// Where a link is stopped.
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

  /// What the UART's status says since the last call.
  LineErrors take_line_errors() {
    const std::uint32_t flags = wirebond_stm32_take_errors(&uart_);
    return {(flags & WIREBOND_STM32_FRAMING) != 0, (flags & WIREBOND_STM32_NOISE) != 0,
            (flags & WIREBOND_STM32_OVERRUN) != 0, (flags & WIREBOND_STM32_PARITY) != 0};
  }

  /// For Link::why: what is wrong with the settings. The baud rate is not compared: registers do not tell the clock.
  Why check(std::uint32_t) const { return static_cast<Why>(wirebond_stm32_check(&uart_)); }

  // ---- the two handlers

  template <class Link>
  void usart_interrupt(Link& link) {
    link.on_pended();  // first: it looks at the status, whose errors may be cleared below
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
