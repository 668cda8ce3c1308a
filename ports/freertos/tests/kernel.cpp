// The double's functions.
#include "kernel.hpp"

#include <cstdint>

namespace {

struct Waits {};  // leaves a task that waits for longer than the test lets it

struct State {
  StaticTask_t* created = nullptr;
  StaticTask_t* running = nullptr;
  TickType_t ticks = 0;
  TickType_t until = 0;
  bool inside_interrupt = false;
  int yields = 0;
};
State state;

BaseType_t set_bits(TaskHandle_t task, std::uint32_t bits) {
  task->bits |= bits;
  task->notified = true;
  return pdTRUE;
}

}  // namespace

namespace kernel {

void reset() { state = {}; }

void run_task(StaticTask_t& task, TickType_t ticks) {
  state.running = &task;
  state.until = state.ticks + ticks;
  try {
    task.run(task.parameters);
  } catch (const Waits&) {
  }
  state.running = nullptr;
}

StaticTask_t& last_created() { return *state.created; }
void set_interrupt(bool inside) { state.inside_interrupt = inside; }
void set_ticks(TickType_t ticks) { state.ticks = ticks; }
int yields() { return state.yields; }

}  // namespace kernel

void double_yield(BaseType_t woken) { state.yields += woken != pdFALSE ? 1 : 0; }
BaseType_t xPortIsInsideInterrupt() { return state.inside_interrupt ? pdTRUE : pdFALSE; }
TickType_t xTaskGetTickCount() { return state.ticks; }

TaskHandle_t xTaskCreateStatic(TaskFunction_t run, const char* name, std::uint32_t stack_words, void* parameters,
                               UBaseType_t priority, StackType_t*, StaticTask_t* memory) {
  *memory = {run, parameters, name, priority, stack_words, 0, false};
  state.created = memory;
  return memory;
}

BaseType_t xTaskNotify(TaskHandle_t task, std::uint32_t value, eNotifyAction) { return set_bits(task, value); }

BaseType_t xTaskNotifyFromISR(TaskHandle_t task, std::uint32_t value, eNotifyAction, BaseType_t* woken) {
  *woken = pdTRUE;
  return set_bits(task, value);
}

BaseType_t xTaskNotifyWait(std::uint32_t, std::uint32_t, std::uint32_t* value, TickType_t ticks) {
  StaticTask_t& task = *state.running;
  if (!task.notified) {
    if (ticks > state.until - state.ticks) throw Waits{};
    state.ticks += ticks;
  }
  if (value != nullptr) *value = task.bits;
  task.bits = 0;
  return task.notified ? (task.notified = false, pdTRUE) : pdFALSE;
}
