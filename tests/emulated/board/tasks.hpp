// Tasks of FreeRTOS without a heap, and how a UART's events reach its link. No protocol, no register.
#pragma once

#include <cstddef>
#include <cstdint>

#include "FreeRTOS.h"
#include "software_dma.hpp"
#include "task.h"

namespace board {

/// A task with its memory. Make it an object that lives for ever.
class Task {
 public:
  void start(TaskFunction_t function, const char* name, UBaseType_t priority, void* argument = nullptr) {
    handle_ = xTaskCreateStatic(function, name, stack_words, argument, priority, stack_, &task_);
  }
  TaskHandle_t handle() const { return handle_; }

 private:
  static constexpr std::size_t stack_words = 512;

  StaticTask_t task_;
  StackType_t stack_[stack_words];
  TaskHandle_t handle_ = nullptr;
};

/// For the handler of the event interrupt: tells the link what happened, and wakes the task that polls it.
template <class Link>
void forward_events(SoftwareDma& dma, Link& link, const Task& polling) {
  const std::uint32_t events = dma.take_events();
  if ((events & Events::transmitted) != 0) link.on_transmitted();
  if ((events & Events::pended) != 0) link.on_pended();
  if ((events & Events::received) == 0) return;
  link.on_received();
  BaseType_t woken = pdFALSE;
  vTaskNotifyGiveFromISR(polling.handle(), &woken);
  portYIELD_FROM_ISR(woken);
}

/// For a task: polls the link when bytes came, and each millisecond.
template <class Link>
void poll_once(Link& link) {
  ulTaskNotifyTake(pdTRUE, pdMS_TO_TICKS(1));
  link.poll(timer2.count);
}

/// Priorities of interrupts: that of the UART and its DMA may call the kernel.
constexpr std::uint8_t uart_priority = 6;

/// The tasks run, and the clock. Does not return.
inline void run_tasks() {
  start_clock(timer2);
  vTaskStartScheduler();
}

}  // namespace board
