// A port: a UART of an STM32 by its registers, with circular DMA in and DMA out, where the HAL is in the way. It needs
// the vendor's device header alone, as projects with the LL drivers or without any have it.
#pragma once

// The device header of the family, where your project has not included it before: CMSIS names it by -DSTM32F407xx.
#ifndef USART_CR1_UE
#if __has_include("stm32f4xx.h")
#include "stm32f4xx.h"
#elif __has_include("stm32g4xx.h")
#include "stm32g4xx.h"
#endif
#ifndef USART_CR1_UE
#error "no device header: include that of your family before this one, such as stm32f4xx.h"
#endif
#endif

#include <cstddef>
#include <cstdint>

#include "wirebond/mcu/line_errors.hpp"
#include "wirebond/mcu/why.hpp"

namespace wirebond::stm32_ll {

/// What carries the bytes of one direction: a stream (F2, F4, F7, H7) or a channel (the others).
#ifdef DMA_SxCR_EN
using Carrier = DMA_Stream_TypeDef;
#else
using Carrier = DMA_Channel_TypeDef;
#endif

/// What is connected to what, by the names of the device header. Numbers are those in the carriers' names.
struct Wiring {
  USART_TypeDef* usart;  ///< USART3
  DMA_TypeDef* dma;      ///< DMA1, of both carriers
  Carrier* receive;      ///< DMA1_Stream1
  unsigned receive_number;
  Carrier* transmit;  ///< DMA1_Stream3
  unsigned transmit_number;
  IRQn_Type interrupt;  ///< USART3_IRQn
};

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
  explicit Uart(const Wiring& wiring) : wiring_(wiring) {}

  /// False while the carrier does not stop: DMA ends the transfer of one byte first.
  bool start_receive(std::uint8_t* ring, std::size_t size) {
    if (!begin(*wiring_.receive, wiring_.receive_number, ring, size, receive_register())) return false;
    size_ = size;
    wiring_.usart->CR3 = (wiring_.usart->CR3 & ~USART_CR3_EIE) | USART_CR3_DMAR;
    end_idle();
    wiring_.usart->CR1 = (wiring_.usart->CR1 & ~USART_CR1_PEIE) | USART_CR1_IDLEIE;
    control(*wiring_.receive) = control(*wiring_.receive) | half_and_full | enable;
    return true;
  }

  /// False after a bus error, which stops the carrier.
  bool receiving() const { return (control(*wiring_.receive) & enable) != 0; }

  /// Any context.
  std::size_t receive_position() const {
    const std::size_t position = size_ - left(*wiring_.receive);
    return position == size_ ? 0 : position;  // the counter may be read at 0, before it starts the next round
  }

  /// Where a link is stopped.
  void stop_receive() {
    wiring_.usart->CR1 = wiring_.usart->CR1 & ~USART_CR1_IDLEIE;
    static_cast<void>(stop(*wiring_.receive, wiring_.receive_number));
  }

  bool start_transmit(const std::uint8_t* bytes, std::size_t size) {
    if (is_sending_ || !begin(*wiring_.transmit, wiring_.transmit_number, bytes, size, transmit_register()))
      return false;
    is_sending_ = true;
    forget_complete();  // it comes up again behind the last byte
    wiring_.usart->CR3 = wiring_.usart->CR3 | USART_CR3_DMAT;
    control(*wiring_.transmit) = control(*wiring_.transmit) | enable;
    wiring_.usart->CR1 = wiring_.usart->CR1 | USART_CR1_TCIE;
    return true;
  }

  void stop_transmit() {
    wiring_.usart->CR1 = wiring_.usart->CR1 & ~USART_CR1_TCIE;
    static_cast<void>(stop(*wiring_.transmit, wiring_.transmit_number));  // if it hangs, the next start says so
    is_sending_ = false;
  }

  /// Any task, any interrupt.
  void pend() { NVIC_SetPendingIRQ(wiring_.interrupt); }

  /// DMA counts bytes in 16 bits. F3, F4 and G4: the core-coupled memory at 0x10000000 is for the core alone
  /// (RM0090 2.1, RM0440 2.4). H7: so are both tightly coupled memories (RM0433 2.1).
  bool reaches(const void* bytes, std::size_t size) const {
    const auto address = reinterpret_cast<std::uintptr_t>(bytes);
    [[maybe_unused]] const auto lies_outside = [=](std::uintptr_t from, std::uintptr_t to) {
      return address + size <= from || address >= to;
    };
#if defined(STM32F3) || defined(STM32F4)
    if (!lies_outside(0x1000'0000, 0x1001'0000)) return false;
#elif defined(STM32G4)
    if (!lies_outside(0x1000'0000, 0x1000'8000)) return false;
#elif defined(STM32H7)
    if (!lies_outside(0, 0x1'0000) || !lies_outside(0x2000'0000, 0x2002'0000)) return false;
#endif
    return size <= 0xFFFF;
  }

  /// What the UART's status says since the last call.
  LineErrors take_line_errors() {
#ifdef USART_ICR_FECF
    const std::uint32_t flags = wiring_.usart->ISR;
    wiring_.usart->ICR = USART_ICR_PECF | USART_ICR_FECF | noise_clear | USART_ICR_ORECF;
    return {(flags & USART_ISR_FE) != 0, (flags & noise_flag) != 0, (flags & USART_ISR_ORE) != 0,
            (flags & USART_ISR_PE) != 0};
#else
    // F1, F2, F4: this read, and that of the next byte by DMA, clear the flags. To read the byte here could take it
    // away from the DMA. So flags are old as long as no byte came.
    const std::uint32_t now_left = left(*wiring_.receive);
    const std::uint32_t status = wiring_.usart->SR;
    const std::uint32_t flags = now_left == left_at_look_ ? status & ~status_at_look_ : status;
    status_at_look_ = status;
    left_at_look_ = now_left;
    return {(flags & USART_SR_FE) != 0, (flags & noise_flag) != 0, (flags & USART_SR_ORE) != 0,
            (flags & USART_SR_PE) != 0};
#endif
  }

  /// For Link::why: what is wrong with the settings. The baud rate is not compared: registers do not tell the clock.
  Why check(std::uint32_t) const {
    if ((wiring_.usart->CR1 & USART_CR1_UE) == 0) return Why::uart_not_set_up;
    if ((control(*wiring_.receive) & circular) == 0) return Why::receive_dma_not_circular;
    const auto number = static_cast<std::uint32_t>(wiring_.interrupt);
    return (NVIC->ISER[number / 32] >> number % 32 & 1u) == 0 ? Why::interrupt_off : Why::nothing;
  }

  // ---- the two handlers

  template <class Link>
  void usart_interrupt(Link& link) {
    link.on_pended();  // first: it looks at the status, whose errors may be cleared below
    const std::uint32_t status = status_register();
    if ((status & idle_flag) != 0 && (wiring_.usart->CR1 & USART_CR1_IDLEIE) != 0) {
      end_idle();
      link.on_received();
    }
    if (!is_sending_ || (status & complete_flag) == 0) return;
    if (left(*wiring_.transmit) != 0) return forget_complete();  // DMA was late by more than a byte, and goes on
    wiring_.usart->CR1 = wiring_.usart->CR1 & ~USART_CR1_TCIE;
    is_sending_ = false;
    link.on_transmitted();
  }

  template <class Link>
  void receive_interrupt(Link& link) {
    forget_events(wiring_.receive_number);
    receiving() ? link.on_received() : link.on_error();
  }

 private:
#ifdef DMA_SxCR_EN
  static constexpr std::uint32_t enable = DMA_SxCR_EN;
  static constexpr std::uint32_t circular = DMA_SxCR_CIRC;
  static constexpr std::uint32_t half_and_full = DMA_SxCR_HTIE | DMA_SxCR_TCIE | DMA_SxCR_TEIE;

  static volatile std::uint32_t& control(Carrier& carrier) { return carrier.CR; }
  static std::uint32_t left(const Carrier& carrier) { return carrier.NDTR; }
  static void connect(Carrier& carrier, std::uint32_t memory, std::uint32_t peripheral, std::uint32_t size) {
    carrier.M0AR = memory;
    carrier.PAR = peripheral;
    carrier.NDTR = size;
  }
  void forget_events(unsigned number) {
    static constexpr std::uint8_t place[] = {0, 6, 16, 22};
    volatile std::uint32_t& clear = number < 4 ? wiring_.dma->LIFCR : wiring_.dma->HIFCR;
    clear = 0x3Du << place[number % 4];
  }
#else
  static constexpr std::uint32_t enable = DMA_CCR_EN;
  static constexpr std::uint32_t circular = DMA_CCR_CIRC;
  static constexpr std::uint32_t half_and_full = DMA_CCR_HTIE | DMA_CCR_TCIE | DMA_CCR_TEIE;

  static volatile std::uint32_t& control(Carrier& carrier) { return carrier.CCR; }
  static std::uint32_t left(const Carrier& carrier) { return carrier.CNDTR; }
  static void connect(Carrier& carrier, std::uint32_t memory, std::uint32_t peripheral, std::uint32_t size) {
    carrier.CMAR = memory;
    carrier.CPAR = peripheral;
    carrier.CNDTR = size;
  }
  void forget_events(unsigned number) { wiring_.dma->IFCR = 0xFu << 4 * (number - 1); }
#endif

#ifdef USART_ICR_FECF  // the families that clear flags by writing them: F0, F3, F7, G0, G4, H7, L4
  static constexpr std::uint32_t idle_flag = USART_ISR_IDLE;
  static constexpr std::uint32_t complete_flag = USART_ISR_TC;
#ifdef USART_ISR_NF
  static constexpr std::uint32_t noise_flag = USART_ISR_NF;
#else
  static constexpr std::uint32_t noise_flag = USART_ISR_NE;
#endif
#ifdef USART_ICR_NCF
  static constexpr std::uint32_t noise_clear = USART_ICR_NCF;
#else
  static constexpr std::uint32_t noise_clear = USART_ICR_NECF;
#endif

  std::uint32_t status_register() const { return wiring_.usart->ISR; }
  const volatile void* receive_register() const { return &wiring_.usart->RDR; }
  const volatile void* transmit_register() const { return &wiring_.usart->TDR; }
  void end_idle() { wiring_.usart->ICR = USART_ICR_IDLECF; }
  void forget_complete() { wiring_.usart->ICR = USART_ICR_TCCF; }
#else
  static constexpr std::uint32_t idle_flag = USART_SR_IDLE;
  static constexpr std::uint32_t complete_flag = USART_SR_TC;
#ifdef USART_SR_NE
  static constexpr std::uint32_t noise_flag = USART_SR_NE;
#else
  static constexpr std::uint32_t noise_flag = USART_SR_NF;
#endif

  std::uint32_t status_register() const { return wiring_.usart->SR; }
  const volatile void* receive_register() const { return &wiring_.usart->DR; }
  const volatile void* transmit_register() const { return &wiring_.usart->DR; }
  /// A read of the status and then of the data. The line is silent, so no byte is taken away from the DMA.
  void end_idle() {
    static_cast<void>(wiring_.usart->SR);
    static_cast<void>(wiring_.usart->DR);
  }
  void forget_complete() { wiring_.usart->SR = ~USART_SR_TC; }  // a 1 changes no flag

  std::uint32_t status_at_look_ = 0;
  std::uint32_t left_at_look_ = 0;
#endif

  static std::uint32_t address_of(const volatile void* place) {
    return static_cast<std::uint32_t>(reinterpret_cast<std::uintptr_t>(place));
  }

  bool stop(Carrier& carrier, unsigned number) {
    control(carrier) = control(carrier) & ~enable;
    for (int tries = 0; (control(carrier) & enable) != 0; ++tries) {
      if (tries == 100) return false;
    }
    forget_events(number);  // a stream that is disabled raises a flag, too
    return true;
  }

  bool begin(Carrier& carrier, unsigned number, const std::uint8_t* bytes, std::size_t size,
             const volatile void* peripheral) {
    if (!stop(carrier, number)) return false;
    connect(carrier, address_of(bytes), address_of(peripheral), static_cast<std::uint32_t>(size));
    return true;
  }

  Wiring wiring_;
  std::size_t size_ = 0;
  bool is_sending_ = false;
};

}  // namespace wirebond::stm32_ll
