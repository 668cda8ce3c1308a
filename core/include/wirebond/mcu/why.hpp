// The reasons of why.h in C++, and the question that a port may answer. No link, no register.
#pragma once

#include <cstdint>
#include <type_traits>
#include <utility>

#include "wirebond/mcu/why.h"

namespace wirebond {

/// Why a link does not work as it should: see wirebond_why_t for each.
enum class Why : std::uint8_t {
  nothing = WIREBOND_WHY_NOTHING,
  not_polled = WIREBOND_WHY_NOT_POLLED,
  buffers_unreachable = WIREBOND_WHY_BUFFERS_UNREACHABLE,
  uart_not_set_up = WIREBOND_WHY_UART_NOT_SET_UP,
  no_receive_dma = WIREBOND_WHY_NO_RECEIVE_DMA,
  no_transmit_dma = WIREBOND_WHY_NO_TRANSMIT_DMA,
  receive_dma_not_circular = WIREBOND_WHY_RECEIVE_DMA_NOT_CIRCULAR,
  baud_differs = WIREBOND_WHY_BAUD_DIFFERS,
  interrupt_off = WIREBOND_WHY_INTERRUPT_OFF,
  not_connected = WIREBOND_WHY_NOT_CONNECTED,
  port_refuses = WIREBOND_WHY_PORT_REFUSES,
  pends_unserved = WIREBOND_WHY_PENDS_UNSERVED,
  reception_stops = WIREBOND_WHY_RECEPTION_STOPS,
  runs_not_completed = WIREBOND_WHY_RUNS_NOT_COMPLETED,
  no_echo = WIREBOND_WHY_NO_ECHO,
  wrong_time_base = WIREBOND_WHY_WRONG_TIME_BASE,
  hears_itself = WIREBOND_WHY_HEARS_ITSELF,
  nothing_understood = WIREBOND_WHY_NOTHING_UNDERSTOOD,
  nothing_heard = WIREBOND_WHY_NOTHING_HEARD,
  protocol_differs = WIREBOND_WHY_PROTOCOL_DIFFERS,
  many_line_errors = WIREBOND_WHY_MANY_LINE_ERRORS,
  many_collisions = WIREBOND_WHY_MANY_COLLISIONS,
  slow_without_clock = WIREBOND_WHY_SLOW_WITHOUT_CLOCK,
  polled_too_seldom = WIREBOND_WHY_POLLED_TOO_SELDOM,
  clock_steps_back = WIREBOND_WHY_CLOCK_STEPS_BACK,
  tick_below_uart = WIREBOND_WHY_TICK_BELOW_UART,
};

/// Return a sentence that says what is wrong and what to do. Takes flash only if it is called.
inline const char* text_of(Why why) { return wirebond_why_text(static_cast<wirebond_why_t>(why)); }

namespace detail {

/// Check whether the port is set up as the link needs it. A port may have `Why check(std::uint32_t baud) const`.
template <class Port>
auto check_port(const Port& port, std::uint32_t baud, int) -> decltype(static_cast<Why>(port.check(baud))) {
  return port.check(baud);
}
template <class Port>
Why check_port(const Port&, std::uint32_t, long) {
  return Why::nothing;
}

}  // namespace detail

}  // namespace wirebond
