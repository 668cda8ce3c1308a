// See wirebond_stm32_hal.h.
#include "wirebond_stm32_hal.h"

#include "wirebond/stm32/reach.h"

static void drive(void* uart, bool on) {
  const wirebond_stm32_hal_t* const port = uart;
  if (port->drive != NULL) port->drive(on);
}

static UART_HandleTypeDef* handle_of(void* uart) { return ((wirebond_stm32_hal_t*)uart)->handle; }

/// Clear bits even if an interrupt may change the register in between; older HALs lack the macro, and do not care.
static void clear_bits(volatile uint32_t* control, uint32_t bits) {
#ifdef ATOMIC_CLEAR_BIT
  ATOMIC_CLEAR_BIT(*control, bits);
#else
  *control = *control & ~bits;
#endif
}

bool wirebond_stm32_hal_start_receive(void* uart, uint8_t* ring, size_t size) {
  UART_HandleTypeDef* const handle = handle_of(uart);
  if (handle->hdmarx == NULL) return false;  // the HAL does not check
  // After a DMA error the HAL reports ready with the stream still running, and would never start again.
  if (HAL_UART_AbortReceive(handle) != HAL_OK) return false;
  if (HAL_UARTEx_ReceiveToIdle_DMA(handle, ring, (uint16_t)size) != HAL_OK) return false;
  // The HAL enabled them, and would end reception for each error.
  clear_bits(&handle->Instance->CR3, USART_CR3_EIE);
  clear_bits(&handle->Instance->CR1, USART_CR1_PEIE);
  return true;
}

bool wirebond_stm32_hal_receiving(void* uart) { return handle_of(uart)->RxState == HAL_UART_STATE_BUSY_RX; }

size_t wirebond_stm32_hal_receive_position(void* uart) {
  UART_HandleTypeDef* const handle = handle_of(uart);
  return wirebond_ring_position(handle->RxXferSize, __HAL_DMA_GET_COUNTER(handle->hdmarx));
}

void wirebond_stm32_hal_stop_receive(void* uart) { (void)HAL_UART_AbortReceive(handle_of(uart)); }

bool wirebond_stm32_hal_start_transmit(void* uart, const uint8_t* bytes, size_t size) {
  UART_HandleTypeDef* const handle = handle_of(uart);
  if (handle->hdmatx == NULL) return false;
  drive(uart, true);
  if (HAL_UART_Transmit_DMA(handle, (uint8_t*)(uintptr_t)bytes, (uint16_t)size) == HAL_OK)
    return true;  // older HALs: no const
  drive(uart, false);
  return false;
}

void wirebond_stm32_hal_line_free(void* uart) { drive(uart, false); }

void wirebond_stm32_hal_stop_transmit(void* uart) { (void)HAL_UART_AbortTransmit(handle_of(uart)); }

void wirebond_stm32_hal_pend(void* uart) { NVIC_SetPendingIRQ(((wirebond_stm32_hal_t*)uart)->interrupt); }

bool wirebond_stm32_hal_reaches(void* uart, const void* bytes, size_t size) {
  (void)uart;
  return wirebond_stm32_dma_reaches(WIREBOND_STM32_FAMILY, (uintptr_t)bytes, size);
}

uint32_t wirebond_stm32_hal_tick_ms(void* uart) {
  (void)uart;
  return HAL_GetTick();
}

wirebond_why_t wirebond_stm32_hal_check(void* uart, uint32_t baud) {
  UART_HandleTypeDef* const handle = handle_of(uart);
  const IRQn_Type interrupt = ((wirebond_stm32_hal_t*)uart)->interrupt;
  if (handle->gState == HAL_UART_STATE_RESET) return WIREBOND_WHY_UART_NOT_SET_UP;
  if (handle->hdmarx == NULL) return WIREBOND_WHY_NO_RECEIVE_DMA;
  if (handle->hdmatx == NULL) return WIREBOND_WHY_NO_TRANSMIT_DMA;
  if (handle->hdmarx->Init.Mode != DMA_CIRCULAR) return WIREBOND_WHY_RECEIVE_DMA_NOT_CIRCULAR;
  if (handle->Init.BaudRate != baud) return WIREBOND_WHY_BAUD_DIFFERS;
  if (!wirebond_interrupt_enabled(NVIC->ISER, (uint32_t)interrupt)) return WIREBOND_WHY_INTERRUPT_OFF;
  return uwTickPrio >= NVIC_GetPriority(interrupt) ? WIREBOND_WHY_TICK_BELOW_UART : WIREBOND_WHY_NOTHING;
}

wirebond_line_errors_t wirebond_stm32_hal_take_line_errors(void* uart) {
  UART_HandleTypeDef* const handle = handle_of(uart);
  wirebond_line_errors_t errors;
  uint32_t flags;
#ifdef UART_CLEAR_FEF  // families that clear flags by writing them: F0, F3, F7, G0, G4, H7, L4
  flags = handle->Instance->ISR;
  handle->Instance->ICR = UART_CLEAR_PEF | UART_CLEAR_FEF | UART_CLEAR_NEF | UART_CLEAR_OREF;
#else
  const uint32_t left = __HAL_DMA_GET_COUNTER(handle->hdmarx);  // F1, F2, F4
  flags = wirebond_new_flags(&((wirebond_stm32_hal_t*)uart)->look, handle->Instance->SR, left);
#endif
  errors.framing = (flags & UART_FLAG_FE) != 0;
  errors.noise = (flags & UART_FLAG_NE) != 0;
  errors.overrun = (flags & UART_FLAG_ORE) != 0;
  errors.parity = (flags & UART_FLAG_PE) != 0;
  return errors;
}
