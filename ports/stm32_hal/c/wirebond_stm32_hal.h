// A port in C: a UART of an STM32 through the vendor's HAL, with circular DMA in and DMA out. C99. Compile
// wirebond_stm32_hal.c beside it. It defines no HAL callback.
#ifndef WIREBOND_STM32_HAL_H
#define WIREBOND_STM32_HAL_H

// The HAL of the family whose headers exist. For another family, include its HAL before this header.
#ifndef HAL_UART_MODULE_ENABLED
#if defined(__has_include)
#if __has_include("stm32f4xx_hal.h")
#include "stm32f4xx_hal.h"
#elif __has_include("stm32g4xx_hal.h")
#include "stm32g4xx_hal.h"
#elif __has_include("stm32h7xx_hal.h")
#include "stm32h7xx_hal.h"
#endif
#endif
#ifndef HAL_UART_MODULE_ENABLED
#error "no HAL with HAL_UART_MODULE_ENABLED: add its folder to the include path, or include it before this header"
#endif
#endif

#include "wirebond/mcu/c_api.h"
#include "wirebond/mcu/dma_uart.h"

#ifdef __cplusplus
extern "C" {
#endif

/// One UART, initialised by your project: CubeMX's MX_USARTn_UART_Init with a circular RX DMA and a normal TX DMA.
///     static wirebond_stm32_hal_t uart = {.handle = &huart3, .interrupt = USART3_IRQn};
typedef struct wirebond_stm32_hal {
  UART_HandleTypeDef* handle;
  IRQn_Type interrupt;          ///< the UART's own
  void (*drive)(bool on);       ///< RS-485: switches the transceiver's driver by a pin; NULL: there is none
  wirebond_status_look_t look;  ///< for the port only
} wirebond_stm32_hal_t;

/// The port of this UART, for ..._link_open; the table may be `const`. `clock`: NULL, or the clock that is passed to
/// the poll, in microseconds.
///     static const wirebond_port_t port = WIREBOND_STM32_HAL_PORT(uart, NULL);
///
/// Forward three callbacks of the HAL, and the pend from the UART's handler:
///   HAL_UARTEx_RxEventCallback -> ..._link_on_received     HAL_UART_TxCpltCallback -> ..._link_on_transmitted
///   HAL_UART_ErrorCallback     -> ..._link_on_error        USARTn_IRQHandler, before the HAL's -> ..._link_on_pended
///
/// Line errors do not end reception, as they would with the HAL: its interrupt for them is disabled, DMA continues, and
/// the checks reject the frame. The UART's status shows the errors since its last interrupt. It is read before the
/// HAL's handler runs, because that clears it. Only an error of DMA itself calls HAL_UART_ErrorCallback.
#define WIREBOND_STM32_HAL_PORT(uart, clock)                                                                          \
  {                                                                                                                   \
    .context = &(uart), .start_receive = wirebond_stm32_hal_start_receive, .receiving = wirebond_stm32_hal_receiving, \
    .receive_position = wirebond_stm32_hal_receive_position, .start_transmit = wirebond_stm32_hal_start_transmit,     \
    .stop_transmit = wirebond_stm32_hal_stop_transmit, .pend = wirebond_stm32_hal_pend,                               \
    .reaches = wirebond_stm32_hal_reaches, .now_us = (clock), .check = wirebond_stm32_hal_check,                      \
    .take_line_errors = wirebond_stm32_hal_take_line_errors, .stop_receive = wirebond_stm32_hal_stop_receive,         \
    .line_free = wirebond_stm32_hal_line_free, .tick_ms = wirebond_stm32_hal_tick_ms                                  \
  }

// The functions of wirebond_port_t; see there for contexts and results.

/// Returns false while DMA is still being stopped after an error (the HAL returns HAL_BUSY or HAL_ERROR), or without a
/// DMA.
bool wirebond_stm32_hal_start_receive(void* uart, uint8_t* ring, size_t size);
bool wirebond_stm32_hal_receiving(void* uart);
size_t wirebond_stm32_hal_receive_position(void* uart);
void wirebond_stm32_hal_stop_receive(void* uart);
bool wirebond_stm32_hal_start_transmit(void* uart, const uint8_t* bytes, size_t size);
void wirebond_stm32_hal_stop_transmit(void* uart);
/// The HAL reports a run's end when its last stop bit has left, so the driver is switched off then.
void wirebond_stm32_hal_line_free(void* uart);
void wirebond_stm32_hal_pend(void* uart);
/// The HAL counts bytes in 16 bits, and DMA does not reach all memory.
bool wirebond_stm32_hal_reaches(void* uart, const void* bytes, size_t size);
/// Return the fault of CubeMX's settings. Priorities are compared as HAL_Init groups them: no bit is a subpriority.
wirebond_why_t wirebond_stm32_hal_check(void* uart, uint32_t baud);
/// HAL_GetTick().
uint32_t wirebond_stm32_hal_tick_ms(void* uart);
wirebond_line_errors_t wirebond_stm32_hal_take_line_errors(void* uart);

#ifdef __cplusplus
}
#endif

#endif
