// A test double of FreeRTOS: the types and functions that the port uses, as the kernel's reference describes them. One
// task runs at a time, by `run_task`, until it would wait for ever.
#pragma once

#include <cstddef>
#include <cstdint>

#define configSUPPORT_STATIC_ALLOCATION 1
#define configTICK_RATE_HZ 1000
#define configSTACK_DEPTH_TYPE std::uint16_t
#define pdFALSE 0
#define pdTRUE 1
#define portMAX_DELAY 0xFFFFFFFFu
#define portYIELD_FROM_ISR(woken) double_yield(woken)

using BaseType_t = long;
using UBaseType_t = unsigned long;
using TickType_t = std::uint32_t;
using StackType_t = std::uint32_t;
using TaskFunction_t = void (*)(void*);
struct StaticTask_t {
  TaskFunction_t run;
  void* parameters;
  const char* name;
  UBaseType_t priority;
  std::uint32_t stack_words;
  std::uint32_t bits;
  bool notified;
};
using TaskHandle_t = StaticTask_t*;

void double_yield(BaseType_t woken);
BaseType_t xPortIsInsideInterrupt();
