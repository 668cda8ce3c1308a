// What the firmwares' programs ask of a board with an STM32: its start, one UART with DMA, time. No protocol.
#pragma once

#include <cstdint>

#include "family.hpp"
#include "wirebond/stm32_hal/uart.hpp"

namespace board {

/// Priorities of interrupts, 0 the most urgent. Inside the UART's the HAL waits by its tick, so the tick comes first.
/// The UART's interrupt and those of its DMA have one priority: they never interrupt each other.
constexpr std::uint32_t tick_priority = 0;
constexpr std::uint32_t uart_priority = 1;

/// Clocks, pins, the clock of `now_us`, and USART3 on PD8 (TX) and PD9 (RX) with its DMA. First of all. What the HAL
/// refuses ends in `fail`.
void start(std::uint32_t baud, float stop_bits);

/// USART3, after `start`.
wirebond::stm32_hal::Uart& uart();

/// Microseconds since `start`, modulo 2^32. Any context.
std::uint32_t now_us();

/// Sleep until the next interrupt, which is a millisecond away at most.
inline void rest() { __WFI(); }

/// Nothing can go on: the light is on, interrupts are off. Motors stay as they are: it is for the start only.
[[noreturn]] void fail();

/// Who hears of the UART. Filled in by `serve`.
struct UartEvents {
  void* link;
  void (*received)(void* link);
  void (*transmitted)(void* link);
  void (*error)(void* link);
  void (*pended)(void* link);
};
void set_uart_events(const UartEvents& events);

/// The UART's interrupts tell `link` from here on; it lives as long as the program.
template <class Link>
void serve(Link& link) {
  set_uart_events({&link, [](void* it) { static_cast<Link*>(it)->on_received(); },
                   [](void* it) { static_cast<Link*>(it)->on_transmitted(); },
                   [](void* it) { static_cast<Link*>(it)->on_error(); },
                   [](void* it) { static_cast<Link*>(it)->on_pended(); }});
}

}  // namespace board
