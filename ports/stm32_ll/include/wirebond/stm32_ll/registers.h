// Register accesses of the port of a UART of an STM32, for the port in C++ (uart.hpp) and that in C
// (wirebond_stm32_ll.h): circular DMA in, DMA out, no HAL. No link. C99 and C++.
#ifndef WIREBOND_STM32_LL_REGISTERS_H
#define WIREBOND_STM32_LL_REGISTERS_H

// The device header of the family, if your project has not included it before: CMSIS selects it by -DSTM32F407xx.
#ifndef USART_CR1_UE
#if defined(__has_include)
#if __has_include("stm32f4xx.h")
#include "stm32f4xx.h"
#elif __has_include("stm32g4xx.h")
#include "stm32g4xx.h"
#elif __has_include("stm32h7xx.h")
#include "stm32h7xx.h"
#elif __has_include("stm32l4xx.h")
#include "stm32l4xx.h"
#elif __has_include("stm32f1xx.h")
#include "stm32f1xx.h"
#endif
#endif
#ifndef USART_CR1_UE
#error "no device header: include that of your family before this one, such as stm32f4xx.h"
#endif
#endif

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "wirebond/mcu/dma_uart.h"
#include "wirebond/mcu/why.h"
#include "wirebond/stm32/reach.h"

#ifdef __cplusplus
extern "C" {
#endif

/// Carries the bytes of one direction: a stream (F2, F4, F7, H7) or a channel (the others).
#ifdef DMA_SxCR_EN
typedef DMA_Stream_TypeDef wirebond_stm32_carrier_t;
#else
typedef DMA_Channel_TypeDef wirebond_stm32_carrier_t;
#endif

/// Connections, by the names of the device header. Numbers are those in the carriers' names.
typedef struct wirebond_stm32_wiring {
  USART_TypeDef* usart;               ///< USART3
  DMA_TypeDef* dma;                   ///< DMA1, of both carriers
  wirebond_stm32_carrier_t* receive;  ///< DMA1_Stream1
  unsigned receive_number;
  wirebond_stm32_carrier_t* transmit;  ///< DMA1_Stream3
  unsigned transmit_number;
  IRQn_Type interrupt;  ///< USART3_IRQn
} wirebond_stm32_wiring_t;

/// One UART: its connections, and the port's own state, initially zeros.
typedef struct wirebond_stm32_registers {
  wirebond_stm32_wiring_t wiring;
  size_t ring_size;
  bool is_sending;
  wirebond_status_look_t look;
} wirebond_stm32_registers_t;

/// Events of a UART's interrupt for the link.
typedef struct wirebond_stm32_events {
  bool received;     ///< the line is idle
  bool transmitted;  ///< the run has left, including its last stop bit
} wirebond_stm32_events_t;

// ---- the families' registers and bits

#ifdef DMA_SxCR_EN
#define WIREBOND_STM32_DMA_ENABLE DMA_SxCR_EN
#define WIREBOND_STM32_DMA_CIRCULAR DMA_SxCR_CIRC
#define WIREBOND_STM32_DMA_INCREMENTS DMA_SxCR_MINC
#define WIREBOND_STM32_DMA_TELLS (DMA_SxCR_HTIE | DMA_SxCR_TCIE | DMA_SxCR_TEIE)

static inline volatile uint32_t* wirebond_stm32_dma_control(wirebond_stm32_carrier_t* carrier) { return &carrier->CR; }
static inline uint32_t wirebond_stm32_dma_left(const wirebond_stm32_carrier_t* carrier) { return carrier->NDTR; }
static inline void wirebond_stm32_dma_connect(wirebond_stm32_carrier_t* carrier, uint32_t memory, uint32_t peripheral,
                                              uint32_t size) {
  carrier->M0AR = memory;
  carrier->PAR = peripheral;
  carrier->NDTR = size;
}
static inline void wirebond_stm32_dma_forget(DMA_TypeDef* dma, unsigned number) {
  static const uint8_t place[] = {0, 6, 16, 22};
  volatile uint32_t* const clear = number < 4 ? &dma->LIFCR : &dma->HIFCR;
  *clear = 0x3Du << place[number % 4];
}
#else
#define WIREBOND_STM32_DMA_ENABLE DMA_CCR_EN
#define WIREBOND_STM32_DMA_CIRCULAR DMA_CCR_CIRC
#define WIREBOND_STM32_DMA_INCREMENTS DMA_CCR_MINC
#define WIREBOND_STM32_DMA_TELLS (DMA_CCR_HTIE | DMA_CCR_TCIE | DMA_CCR_TEIE)

static inline volatile uint32_t* wirebond_stm32_dma_control(wirebond_stm32_carrier_t* carrier) { return &carrier->CCR; }
static inline uint32_t wirebond_stm32_dma_left(const wirebond_stm32_carrier_t* carrier) { return carrier->CNDTR; }
static inline void wirebond_stm32_dma_connect(wirebond_stm32_carrier_t* carrier, uint32_t memory, uint32_t peripheral,
                                              uint32_t size) {
  carrier->CMAR = memory;
  carrier->CPAR = peripheral;
  carrier->CNDTR = size;
}
static inline void wirebond_stm32_dma_forget(DMA_TypeDef* dma, unsigned number) {
  dma->IFCR = 0xFu << 4 * (number - 1);
}
#endif

#ifdef USART_ICR_FECF  // families that clear flags by writing them: F0, F3, F7, G0, G4, H7, L4
#define WIREBOND_STM32_IDLE USART_ISR_IDLE
#define WIREBOND_STM32_COMPLETE USART_ISR_TC
#define WIREBOND_STM32_FRAMING USART_ISR_FE
#define WIREBOND_STM32_OVERRUN USART_ISR_ORE
#define WIREBOND_STM32_PARITY USART_ISR_PE
#ifdef USART_ISR_NF
#define WIREBOND_STM32_NOISE USART_ISR_NF
#else
#define WIREBOND_STM32_NOISE USART_ISR_NE
#endif
#ifdef USART_ICR_NCF
#define WIREBOND_STM32_FORGET_NOISE USART_ICR_NCF
#else
#define WIREBOND_STM32_FORGET_NOISE USART_ICR_NECF
#endif

static inline uint32_t wirebond_stm32_status(const USART_TypeDef* usart) { return usart->ISR; }
static inline const volatile void* wirebond_stm32_receive_register(const USART_TypeDef* usart) { return &usart->RDR; }
static inline const volatile void* wirebond_stm32_transmit_register(const USART_TypeDef* usart) { return &usart->TDR; }
static inline void wirebond_stm32_end_idle(USART_TypeDef* usart) { usart->ICR = USART_ICR_IDLECF; }
static inline void wirebond_stm32_forget_complete(USART_TypeDef* usart) { usart->ICR = USART_ICR_TCCF; }
#else
#define WIREBOND_STM32_IDLE USART_SR_IDLE
#define WIREBOND_STM32_COMPLETE USART_SR_TC
#define WIREBOND_STM32_FRAMING USART_SR_FE
#define WIREBOND_STM32_OVERRUN USART_SR_ORE
#define WIREBOND_STM32_PARITY USART_SR_PE
#ifdef USART_SR_NE
#define WIREBOND_STM32_NOISE USART_SR_NE
#else
#define WIREBOND_STM32_NOISE USART_SR_NF
#endif

static inline uint32_t wirebond_stm32_status(const USART_TypeDef* usart) { return usart->SR; }
static inline const volatile void* wirebond_stm32_receive_register(const USART_TypeDef* usart) { return &usart->DR; }
static inline const volatile void* wirebond_stm32_transmit_register(const USART_TypeDef* usart) { return &usart->DR; }
/// End the idle event by reading the status and then the data. The line is silent, so no byte is taken away from DMA.
static inline void wirebond_stm32_end_idle(USART_TypeDef* usart) {
  const uint32_t status = usart->SR;
  const uint32_t data = usart->DR;
  (void)status;
  (void)data;
}
static inline void wirebond_stm32_forget_complete(USART_TypeDef* usart) {
  usart->SR = ~USART_SR_TC;  // a 1 changes no flag
}
#endif

// ---- common to the ports of both languages

/// Returns false if the carrier does not stop: DMA ends the transfer of one byte first, within a few cycles.
static inline bool wirebond_stm32_dma_stop(const wirebond_stm32_wiring_t* wiring, wirebond_stm32_carrier_t* carrier,
                                           unsigned number) {
  volatile uint32_t* const control = wirebond_stm32_dma_control(carrier);
  *control = *control & ~WIREBOND_STM32_DMA_ENABLE;
  for (int tries = 0; (*control & WIREBOND_STM32_DMA_ENABLE) != 0; ++tries) {
    if (tries == 100) return false;
  }
  wirebond_stm32_dma_forget(wiring->dma, number);  // a disabled stream raises a flag, too
  return true;
}

/// Convert an address as registers need it.
static inline uint32_t wirebond_stm32_address(const volatile void* place) { return (uint32_t)(uintptr_t)place; }

/// Returns false while the carrier does not stop.
static inline bool wirebond_stm32_start_receive(wirebond_stm32_registers_t* uart, uint8_t* ring, size_t size) {
  const wirebond_stm32_wiring_t* const wiring = &uart->wiring;
  USART_TypeDef* const usart = wiring->usart;
  volatile uint32_t* const control = wirebond_stm32_dma_control(wiring->receive);
  if (!wirebond_stm32_dma_stop(wiring, wiring->receive, wiring->receive_number)) return false;
  wirebond_stm32_dma_connect(wiring->receive, wirebond_stm32_address(ring),
                             wirebond_stm32_address(wirebond_stm32_receive_register(usart)), (uint32_t)size);
  uart->ring_size = size;
  usart->CR3 = (usart->CR3 & ~USART_CR3_EIE) | USART_CR3_DMAR;
  wirebond_stm32_end_idle(usart);
  usart->CR1 = (usart->CR1 & ~USART_CR1_PEIE) | USART_CR1_IDLEIE;
  *control = *control | WIREBOND_STM32_DMA_TELLS | WIREBOND_STM32_DMA_ENABLE;
  return true;
}

/// Returns false after a bus error, which stops the carrier, and after a carrier in normal mode has filled the ring; a
/// channel keeps its enable bit then. In circular mode the counter may be read at 0, before the next round starts.
static inline bool wirebond_stm32_receiving(const wirebond_stm32_registers_t* uart) {
  const uint32_t control = *wirebond_stm32_dma_control(uart->wiring.receive);
  if ((control & WIREBOND_STM32_DMA_ENABLE) == 0) return false;
  return (control & WIREBOND_STM32_DMA_CIRCULAR) != 0 || wirebond_stm32_dma_left(uart->wiring.receive) != 0;
}

/// Any context.
static inline size_t wirebond_stm32_receive_position(const wirebond_stm32_registers_t* uart) {
  return wirebond_ring_position(uart->ring_size, wirebond_stm32_dma_left(uart->wiring.receive));
}

static inline void wirebond_stm32_stop_receive(wirebond_stm32_registers_t* uart) {
  const wirebond_stm32_wiring_t* const wiring = &uart->wiring;
  wiring->usart->CR1 = wiring->usart->CR1 & ~USART_CR1_IDLEIE;
  (void)wirebond_stm32_dma_stop(wiring, wiring->receive, wiring->receive_number);
}

/// Returns false while a run is being sent, or if the carrier does not stop.
static inline bool wirebond_stm32_start_transmit(wirebond_stm32_registers_t* uart, const uint8_t* bytes, size_t size) {
  const wirebond_stm32_wiring_t* const wiring = &uart->wiring;
  USART_TypeDef* const usart = wiring->usart;
  volatile uint32_t* const control = wirebond_stm32_dma_control(wiring->transmit);
  if (uart->is_sending) return false;
  if (!wirebond_stm32_dma_stop(wiring, wiring->transmit, wiring->transmit_number)) return false;
  wirebond_stm32_dma_connect(wiring->transmit, wirebond_stm32_address(bytes),
                             wirebond_stm32_address(wirebond_stm32_transmit_register(usart)), (uint32_t)size);
  uart->is_sending = true;
  wirebond_stm32_forget_complete(usart);  // it is set again after the last byte
  usart->CR3 = usart->CR3 | USART_CR3_DMAT;
  *control = *control | WIREBOND_STM32_DMA_ENABLE;
  usart->CR1 = usart->CR1 | USART_CR1_TCIE;
  return true;
}

static inline void wirebond_stm32_stop_transmit(wirebond_stm32_registers_t* uart) {
  const wirebond_stm32_wiring_t* const wiring = &uart->wiring;
  wiring->usart->CR1 = wiring->usart->CR1 & ~USART_CR1_TCIE;
  // If it hangs, the next start fails.
  (void)wirebond_stm32_dma_stop(wiring, wiring->transmit, wiring->transmit_number);
  uart->is_sending = false;
}

/// Return the flags WIREBOND_STM32_FRAMING, _NOISE, _OVERRUN and _PARITY that were set since the last call.
static inline uint32_t wirebond_stm32_take_errors(wirebond_stm32_registers_t* uart) {
#ifdef USART_ICR_FECF
  const uint32_t flags = uart->wiring.usart->ISR;
  uart->wiring.usart->ICR = USART_ICR_PECF | USART_ICR_FECF | WIREBOND_STM32_FORGET_NOISE | USART_ICR_ORECF;
  return flags;
#else
  const uint32_t left = wirebond_stm32_dma_left(uart->wiring.receive);
  return wirebond_new_flags(&uart->look, wirebond_stm32_status(uart->wiring.usart), left);
#endif
}

/// Return the fault of the settings. A carrier that does not step through memory was never set up. The baud rate is not
/// compared: registers do not show the clock.
static inline wirebond_why_t wirebond_stm32_check(const wirebond_stm32_registers_t* uart) {
  const wirebond_stm32_wiring_t* const wiring = &uart->wiring;
  const uint32_t receive = *wirebond_stm32_dma_control(wiring->receive);
  const uint32_t transmit = *wirebond_stm32_dma_control(wiring->transmit);
  if ((wiring->usart->CR1 & USART_CR1_UE) == 0) return WIREBOND_WHY_UART_NOT_SET_UP;
  if ((receive & WIREBOND_STM32_DMA_INCREMENTS) == 0) return WIREBOND_WHY_NO_RECEIVE_DMA;
  if ((transmit & WIREBOND_STM32_DMA_INCREMENTS) == 0) return WIREBOND_WHY_NO_TRANSMIT_DMA;
  if ((receive & WIREBOND_STM32_DMA_CIRCULAR) == 0) return WIREBOND_WHY_RECEIVE_DMA_NOT_CIRCULAR;
  if (!wirebond_interrupt_enabled(NVIC->ISER, (uint32_t)wiring->interrupt)) return WIREBOND_WHY_INTERRUPT_OFF;
  return WIREBOND_WHY_NOTHING;
}

/// For the UART's handler, after the link's `on_pended`, which reads the status: its errors may be cleared here.
static inline wirebond_stm32_events_t wirebond_stm32_usart_events(wirebond_stm32_registers_t* uart) {
  USART_TypeDef* const usart = uart->wiring.usart;
  const uint32_t status = wirebond_stm32_status(usart);
  wirebond_stm32_events_t events = {false, false};
  if ((status & WIREBOND_STM32_IDLE) != 0 && (usart->CR1 & USART_CR1_IDLEIE) != 0) {
    wirebond_stm32_end_idle(usart);
    events.received = true;
  }
  if (!uart->is_sending || (status & WIREBOND_STM32_COMPLETE) == 0) return events;
  if (wirebond_stm32_dma_left(uart->wiring.transmit) != 0) {  // DMA was late by more than a byte, and continues
    wirebond_stm32_forget_complete(usart);
    return events;
  }
  usart->CR1 = usart->CR1 & ~USART_CR1_TCIE;
  uart->is_sending = false;
  events.transmitted = true;
  return events;
}

/// For the handler of the receive carrier. Returns true if bytes came, false if reception has stopped, which is an
/// error.
static inline bool wirebond_stm32_receive_event(wirebond_stm32_registers_t* uart) {
  wirebond_stm32_dma_forget(uart->wiring.dma, uart->wiring.receive_number);
  return wirebond_stm32_receiving(uart);
}

#ifdef __cplusplus
}
#endif

#endif
