// The part of the double that FreeRTOS declares in this header.
#pragma once

#include "FreeRTOS.h"

#ifdef __cplusplus
extern "C" {
#endif

typedef enum { eSetBits } eNotifyAction;

TaskHandle_t xTaskCreateStatic(TaskFunction_t run, const char* name, uint32_t stack_words, void* parameters,
                               UBaseType_t priority, StackType_t* stack, StaticTask_t* memory);
BaseType_t xTaskNotify(TaskHandle_t task, uint32_t value, eNotifyAction action);
BaseType_t xTaskNotifyFromISR(TaskHandle_t task, uint32_t value, eNotifyAction action, BaseType_t* woken);
BaseType_t xTaskNotifyWait(uint32_t clear_on_entry, uint32_t clear_on_exit, uint32_t* value, TickType_t ticks);
TickType_t xTaskGetTickCount(void);

#ifdef __cplusplus
}
#endif
