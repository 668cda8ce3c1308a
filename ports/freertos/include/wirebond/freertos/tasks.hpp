// FreeRTOS tasks that serve a link: one that polls it, and one for drivers that no interrupt may call. No heap.
#pragma once

#include <cstddef>
#include <cstdint>

#include "FreeRTOS.h"
#include "task.h"

namespace wirebond::freertos {

static_assert(configSUPPORT_STATIC_ALLOCATION == 1, "set configSUPPORT_STATIC_ALLOCATION to 1 in FreeRTOSConfig.h");
static_assert(sizeof(TickType_t) == 4,
              "set configTICK_TYPE_WIDTH_IN_BITS to TICK_TYPE_WIDTH_32_BITS: the clock of a"
              " link wraps at 32 bits");
static_assert(1'000'000 % configTICK_RATE_HZ == 0, "a tick must be whole microseconds");

/// Returns microseconds, modulo 2^32. A timer that counts them is a better clock than ticks if clocks are synchronised.
using Clock = std::uint32_t (*)();

inline std::uint32_t tick_clock_us() {
  return static_cast<std::uint32_t>(xTaskGetTickCount()) * static_cast<std::uint32_t>(1'000'000 / configTICK_RATE_HZ);
}

/// A task's stack and control block, inside the object.
template <std::size_t stack_words>
class StaticTask {
 public:
  /// Create the task. Once, before or after the scheduler started. `self` is passed to `run`.
  void create(TaskFunction_t run, const char* name, void* self, UBaseType_t priority) {
    handle_ = xTaskCreateStatic(run, name, static_cast<configSTACK_DEPTH_TYPE>(stack_words), self, priority, stack_,
                                &control_);
  }

  /// Set these bits of the task's notification. Any task, and interrupts that may call the RTOS. Does nothing before
  /// `create`.
  void notify(std::uint32_t bits) {
    if (handle_ == nullptr) return;
    if (xPortIsInsideInterrupt() != pdFALSE) {
      BaseType_t woken = pdFALSE;
      static_cast<void>(xTaskNotifyFromISR(handle_, bits, eSetBits, &woken));
      portYIELD_FROM_ISR(woken);
    } else {
      static_cast<void>(xTaskNotify(handle_, bits, eSetBits));
    }
  }

  /// Return the bits that were set since the last wait; 0 after `ticks` without one. Called by the task itself.
  static std::uint32_t wait(TickType_t ticks) {
    std::uint32_t bits = 0;
    static_cast<void>(xTaskNotifyWait(0, ~std::uint32_t{0}, &bits, ticks));
    return bits;
  }

 private:
  TaskHandle_t handle_ = nullptr;
  StaticTask_t control_{};
  StackType_t stack_[stack_words]{};
};

/// Polls a link: at once when it is woken, and at least every `period`. Handlers run in this task.
template <class Link, std::size_t stack_words>
class ReceiveTask {
 public:
  explicit ReceiveTask(Link& link, TickType_t period = 1, Clock clock = tick_clock_us)
      : link_(link), period_(period), clock_(clock) {}

  void start(const char* name, UBaseType_t priority) { task_.create(run, name, this, priority); }

  /// Wake the task after `link.on_received()` and `link.on_error()`, so that a frame does not wait a whole period for
  /// its handler. Not from interrupts above the RTOS's priority limit: without it the task polls every `period`.
  void wake() { task_.notify(1); }

 private:
  static void run(void* self) {
    auto& task = *static_cast<ReceiveTask*>(self);
    for (;;) {
      task.link_.poll(task.clock_());
      static_cast<void>(StaticTask<stack_words>::wait(task.period_));
    }
  }

  Link& link_;
  TickType_t period_;
  Clock clock_;
  StaticTask<stack_words> task_;
};

/// A port around `Port`, and the task that replaces the UART's interrupt: only this task calls `Port`, except
/// `receive_position`, `reaches`, and the first `start_receive`. For drivers that wait, lock, or cannot be called by an
/// interrupt for another reason. Its priority must be above that of the `ReceiveTask`, as an interrupt's is. If the
/// UART's interrupt can start DMA, do not use this: it costs a task switch for each run, and interrupts above the
/// RTOS's priority limit cannot send.
template <class Port, std::size_t stack_words>
class SendTask {
 public:
  explicit SendTask(Port& port) : port_(port) {}

  template <class Link>
  void start(Link& link, const char* name, UBaseType_t priority) {
    link_ = &link;
    task_.create(run<Link>, name, this, priority);
  }

  // Called by the driver, instead of the link's events of these names.
  void on_received() { task_.notify(received); }
  void on_transmitted() { task_.notify(transmitted); }
  void on_error() { task_.notify(error); }

  // The port.
  bool start_receive(std::uint8_t* ring, std::size_t size) { return port_.start_receive(ring, size); }
  bool receiving() const { return port_.receiving(); }
  std::size_t receive_position() const { return port_.receive_position(); }
  bool start_transmit(const std::uint8_t* bytes, std::size_t size) { return port_.start_transmit(bytes, size); }
  void stop_transmit() { port_.stop_transmit(); }
  void pend() { task_.notify(pended); }
  bool reaches(const void* bytes, std::size_t size) const { return port_.reaches(bytes, size); }

 private:
  enum Bit : std::uint32_t { received = 1, transmitted = 2, error = 4, pended = 8 };

  template <class Link>
  static void run(void* self) {
    auto& task = *static_cast<SendTask*>(self);
    auto& link = *static_cast<Link*>(task.link_);
    // A pend before this task was created has left no bit.
    for (std::uint32_t bits = pended;; bits = StaticTask<stack_words>::wait(portMAX_DELAY)) {
      if ((bits & received) != 0) link.on_received();
      if ((bits & error) != 0) link.on_error();
      if ((bits & transmitted) != 0) link.on_transmitted();
      if ((bits & pended) != 0) link.on_pended();
    }
  }

  Port& port_;
  void* link_ = nullptr;
  StaticTask<stack_words> task_;
};

}  // namespace wirebond::freertos
