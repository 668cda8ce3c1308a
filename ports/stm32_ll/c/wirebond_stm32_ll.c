// See wirebond_stm32_ll.h.
#include "wirebond_stm32_ll.h"

static wirebond_stm32_ll_t* port_of(void* uart) { return (wirebond_stm32_ll_t*)uart; }

static wirebond_stm32_registers_t* registers_of(void* uart) { return &port_of(uart)->registers; }

static void drive(void* uart, bool on) {
  if (port_of(uart)->drive != NULL) port_of(uart)->drive(on);
}

wirebond_stm32_events_t wirebond_stm32_ll_usart_events(wirebond_stm32_ll_t* uart) {
  return wirebond_stm32_usart_events(&uart->registers);
}

bool wirebond_stm32_ll_receive_event(wirebond_stm32_ll_t* uart) {
  return wirebond_stm32_receive_event(&uart->registers);
}

bool wirebond_stm32_ll_start_receive(void* uart, uint8_t* ring, size_t size) {
  return wirebond_stm32_start_receive(registers_of(uart), ring, size);
}

bool wirebond_stm32_ll_receiving(void* uart) { return wirebond_stm32_receiving(registers_of(uart)); }

size_t wirebond_stm32_ll_receive_position(void* uart) { return wirebond_stm32_receive_position(registers_of(uart)); }

void wirebond_stm32_ll_stop_receive(void* uart) { wirebond_stm32_stop_receive(registers_of(uart)); }

bool wirebond_stm32_ll_start_transmit(void* uart, const uint8_t* bytes, size_t size) {
  drive(uart, true);
  if (wirebond_stm32_start_transmit(registers_of(uart), bytes, size)) return true;
  drive(uart, false);
  return false;
}

void wirebond_stm32_ll_stop_transmit(void* uart) { wirebond_stm32_stop_transmit(registers_of(uart)); }

void wirebond_stm32_ll_line_free(void* uart) { drive(uart, false); }

void wirebond_stm32_ll_pend(void* uart) { NVIC_SetPendingIRQ(registers_of(uart)->wiring.interrupt); }

bool wirebond_stm32_ll_reaches(void* uart, const void* bytes, size_t size) {
  (void)uart;
  return wirebond_stm32_dma_reaches(WIREBOND_STM32_FAMILY, (uintptr_t)bytes, size);
}

wirebond_why_t wirebond_stm32_ll_check(void* uart, uint32_t baud) {
  (void)baud;
  return wirebond_stm32_check(registers_of(uart));
}

wirebond_line_errors_t wirebond_stm32_ll_take_line_errors(void* uart) {
  const uint32_t flags = wirebond_stm32_take_errors(registers_of(uart));
  wirebond_line_errors_t errors;
  errors.framing = (flags & WIREBOND_STM32_FRAMING) != 0;
  errors.noise = (flags & WIREBOND_STM32_NOISE) != 0;
  errors.overrun = (flags & WIREBOND_STM32_OVERRUN) != 0;
  errors.parity = (flags & WIREBOND_STM32_PARITY) != 0;
  return errors;
}
