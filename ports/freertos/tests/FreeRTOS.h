// A test double of FreeRTOS: the types and functions that the port uses, as the kernel's reference describes them. One
// task runs at a time, by `run_task`, until it would wait for ever. C99 and C++.
#pragma once

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#endif

#define configSUPPORT_STATIC_ALLOCATION 1
#define configTICK_RATE_HZ 1000
#define configSTACK_DEPTH_TYPE uint16_t
#define pdFALSE 0
#define pdTRUE 1
#define portMAX_DELAY 0xFFFFFFFFu
#define portYIELD_FROM_ISR(woken) double_yield(woken)

typedef long BaseType_t;
typedef unsigned long UBaseType_t;
typedef uint32_t TickType_t;
typedef uint32_t StackType_t;
typedef void (*TaskFunction_t)(void*);
typedef struct {
  TaskFunction_t run;
  void* parameters;
  const char* name;
  UBaseType_t priority;
  uint32_t stack_words;
  uint32_t bits;
  bool notified;
} StaticTask_t;
typedef StaticTask_t* TaskHandle_t;

void double_yield(BaseType_t woken);
BaseType_t xPortIsInsideInterrupt(void);

#ifdef __cplusplus
}
#endif
