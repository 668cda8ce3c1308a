// A port in C: a UART of an STM32 by its registers, with circular DMA in and DMA out, for projects without the HAL.
// C99. Compile wirebond_stm32_ll.c with it. It needs only the vendor's device header.
#ifndef WIREBOND_STM32_LL_H
#define WIREBOND_STM32_LL_H

#include "wirebond/mcu/c_api.h"
#include "wirebond/stm32_ll/registers.h"

#ifdef __cplusplus
extern "C" {
#endif

/// One UART. Your project sets up clocks, pins, the UART (speed and format, receiver and transmitter on), and both DMA
/// streams or channels: their channel or request, bytes on both sides, memory increment, receive circular, transmit
/// not.
///     static wirebond_stm32_ll_t uart = {
///         .registers = {.wiring = {USART3, DMA1, DMA1_Stream1, 1, DMA1_Stream3, 3, USART3_IRQn}}};
typedef struct wirebond_stm32_ll {
  wirebond_stm32_registers_t registers;
  void (*drive)(bool on);  ///< RS-485: switches the transceiver's driver by a pin; NULL: there is none
} wirebond_stm32_ll_t;

/// The port of this UART, for ..._link_open; the table may be `const`. `clock`: NULL, or the clock that is passed to
/// the poll, in microseconds.
///     static const wirebond_port_t port = WIREBOND_STM32_LL_PORT(uart, NULL);
///
/// Enable two interrupts with one priority, with these handlers:
///     void USART3_IRQHandler(void) {
///       ..._link_on_pended(link);  // first: it reads the status, whose errors may be cleared below
///       const wirebond_stm32_events_t events = wirebond_stm32_ll_usart_events(&uart);
///       if (events.received) ..._link_on_received(link);
///       if (events.transmitted) ..._link_on_transmitted(link);
///     }
///     void DMA1_Stream1_IRQHandler(void) {  // of reception
///       if (wirebond_stm32_ll_receive_event(&uart)) ..._link_on_received(link);
///       else ..._link_on_error(link);
///     }
/// The transmit carrier needs no interrupt: a run is complete when the UART reports that its last stop bit has left.
/// Line errors raise no interrupt: DMA continues, and the checks reject the frame.
#define WIREBOND_STM32_LL_PORT(uart, clock)                                                                         \
  {                                                                                                                 \
    .context = &(uart), .start_receive = wirebond_stm32_ll_start_receive, .receiving = wirebond_stm32_ll_receiving, \
    .receive_position = wirebond_stm32_ll_receive_position, .start_transmit = wirebond_stm32_ll_start_transmit,     \
    .stop_transmit = wirebond_stm32_ll_stop_transmit, .pend = wirebond_stm32_ll_pend,                               \
    .reaches = wirebond_stm32_ll_reaches, .now_us = (clock), .check = wirebond_stm32_ll_check,                      \
    .take_line_errors = wirebond_stm32_ll_take_line_errors, .stop_receive = wirebond_stm32_ll_stop_receive,         \
    .line_free = wirebond_stm32_ll_line_free                                                                        \
  }

// ---- for the two handlers

wirebond_stm32_events_t wirebond_stm32_ll_usart_events(wirebond_stm32_ll_t* uart);
/// Returns true if bytes came, false if a bus error has stopped reception.
bool wirebond_stm32_ll_receive_event(wirebond_stm32_ll_t* uart);

// ---- the functions of wirebond_port_t; see there for contexts and results

/// Returns false while the carrier does not stop: DMA ends the transfer of one byte first.
bool wirebond_stm32_ll_start_receive(void* uart, uint8_t* ring, size_t size);
bool wirebond_stm32_ll_receiving(void* uart);
size_t wirebond_stm32_ll_receive_position(void* uart);
void wirebond_stm32_ll_stop_receive(void* uart);
bool wirebond_stm32_ll_start_transmit(void* uart, const uint8_t* bytes, size_t size);
void wirebond_stm32_ll_stop_transmit(void* uart);
/// A run's end is reported when its last stop bit has left, so the driver is switched off then.
void wirebond_stm32_ll_line_free(void* uart);
void wirebond_stm32_ll_pend(void* uart);
/// DMA counts bytes in 16 bits, and does not reach all memory.
bool wirebond_stm32_ll_reaches(void* uart, const void* bytes, size_t size);
/// Return the fault of the settings. The baud rate is not compared: registers do not show the clock.
wirebond_why_t wirebond_stm32_ll_check(void* uart, uint32_t baud);
wirebond_line_errors_t wirebond_stm32_ll_take_line_errors(void* uart);

#ifdef __cplusplus
}
#endif

#endif
