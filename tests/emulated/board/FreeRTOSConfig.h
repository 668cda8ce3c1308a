/* The FreeRTOS kernel's settings for the emulated board: everything static, pre-emption at every tick. */
#ifndef FREERTOS_CONFIG_H
#define FREERTOS_CONFIG_H

/* The emulated SysTick counts 168 times while the processor makes 1000 instructions, which are 1000/170 us to programs.
 */
#define configCPU_CLOCK_HZ (168000 * 170)
#define configTICK_RATE_HZ 1000
#define configTICK_TYPE_WIDTH_IN_BITS TICK_TYPE_WIDTH_32_BITS
#define configUSE_PREEMPTION 1
#define configUSE_TIME_SLICING 1
#define configMAX_PRIORITIES 8
#define configMINIMAL_STACK_SIZE 128
#define configMAX_TASK_NAME_LEN 16
#define configSUPPORT_STATIC_ALLOCATION 1
#define configSUPPORT_DYNAMIC_ALLOCATION 0
#define configKERNEL_PROVIDED_STATIC_MEMORY 1
#define configUSE_IDLE_HOOK 1
#define configUSE_TICK_HOOK 0
#define configUSE_TIMERS 0
#define configUSE_TASK_NOTIFICATIONS 1
#define configCHECK_FOR_STACK_OVERFLOW 2

#define INCLUDE_vTaskDelay 1
#define INCLUDE_xTaskDelayUntil 1
#define INCLUDE_uxTaskGetStackHighWaterMark 1

/* Interrupts of priority 0 to 4 are never masked by the kernel and must not call it. */
#define configPRIO_BITS 4
#define configKERNEL_INTERRUPT_PRIORITY (15 << (8 - configPRIO_BITS))
#define configMAX_SYSCALL_INTERRUPT_PRIORITY (5 << (8 - configPRIO_BITS))

#define vPortSVCHandler SVC_Handler
#define xPortPendSVHandler PendSV_Handler
#define xPortSysTickHandler SysTick_Handler

#ifdef __cplusplus
extern "C" {
#endif
void assertion_failed(const char* file, int line);
#ifdef __cplusplus
}
#endif
#define configASSERT(condition) \
  if (!(condition)) assertion_failed(__FILE__, __LINE__)

#endif
