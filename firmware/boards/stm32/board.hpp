// Board functions for the firmwares' programs with an STM32: start, one UART with DMA, time. No protocol.
#pragma once

#include <cstdint>

#include "family.hpp"
#include "wirebond/stm32_hal/uart.hpp"

namespace board {

/// Priorities of interrupts, 0 the most urgent. The tick is above the UART's interrupt, because the HAL waits by its
/// tick inside that. The UART's interrupt and those of its DMA have one priority: they never interrupt each other.
constexpr std::uint32_t tick_priority = 0;
constexpr std::uint32_t uart_priority = 1;

/// Start clocks, pins, the clock of `now_us`, and USART3 on PD8 (TX) and PD9 (RX) with its DMA. Call it first. Calls
/// `fail` if the HAL refuses.
void start(std::uint32_t baud, float stop_bits);

/// Return USART3, after `start`.
wirebond::stm32_hal::Uart& uart();

/// Return microseconds since `start`, modulo 2^32. Any context.
std::uint32_t now_us();

/// Sleep until the next interrupt, which is at most a millisecond away.
inline void rest() { __WFI(); }

/// Stop for good: the light is on, interrupts are off. Motors are not changed, so call it only during the start.
[[noreturn]] void fail();

/// The receiver of the UART's events. Filled in by `serve`.
struct UartEvents {
  void* link;
  void (*received)(void* link);
  void (*transmitted)(void* link);
  void (*error)(void* link);
  void (*pended)(void* link);
};
void set_uart_events(const UartEvents& events);

/// Let the UART's interrupts call `link` from now on; it lives as long as the program.
template <class Link>
void serve(Link& link) {
  set_uart_events({&link, [](void* it) { static_cast<Link*>(it)->on_received(); },
                   [](void* it) { static_cast<Link*>(it)->on_transmitted(); },
                   [](void* it) { static_cast<Link*>(it)->on_error(); },
                   [](void* it) { static_cast<Link*>(it)->on_pended(); }});
}

}  // namespace board
