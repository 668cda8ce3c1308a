// How a UART's events reach its link, and how the tasks begin. No protocol, no register.
#pragma once

#include <cstddef>
#include <cstdint>

#include "report.hpp"
#include "software_dma.hpp"
#include "stm32f405.hpp"
#include "wirebond/freertos/tasks.hpp"

namespace board {

constexpr std::size_t stack_words = 512;  ///< of each task

/// Of the UART's interrupt, which stands for that of its DMA too: the kernel may be called.
constexpr std::uint8_t uart_priority = 6;

inline std::uint32_t clock_us() { return timer2.count; }

/// Polls a link when bytes came, and each millisecond.
template <class Link>
class ReceiveTask : public wirebond::freertos::ReceiveTask<Link, stack_words> {
 public:
  explicit ReceiveTask(Link& link) : wirebond::freertos::ReceiveTask<Link, stack_words>(link, 1, clock_us) {}
};

/// The UART's interrupt may run from here on.
inline void enable_uart(Interrupt events) {
  nvic::set_priority(events, uart_priority);
  nvic::enable(events);
}

/// For the handler of the UART's interrupt: tells the link what happened. Did bytes come?
template <class Link>
bool forward_events(SoftwareDma& dma, Link& link) {
  const std::uint32_t events = dma.take_events();
  if ((events & Events::transmitted) != 0) link.on_transmitted();
  if ((events & Events::pended) != 0) link.on_pended();
  if ((events & Events::received) != 0) link.on_received();
  return (events & Events::received) != 0;
}

/// The same, and wakes the task that polls the link.
template <class Link>
void forward_events(SoftwareDma& dma, Link& link, ReceiveTask<Link>& task) {
  if (forward_events(dma, link)) task.wake();
}

/// The tasks run, and the clock; the test may send from here on. Does not return.
inline void run_tasks() {
  print("ready\n");
  start_clock(timer2);
  vTaskStartScheduler();
}

}  // namespace board
