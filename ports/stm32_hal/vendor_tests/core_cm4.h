/* In the place of CMSIS's header of this name, so that the vendor's HAL compiles for this machine: what its UART and
 * DMA drivers use of the processor. One thread: exclusive access is plain access. */
#ifndef CORE_CM4_H
#define CORE_CM4_H

#include <stdint.h>

#ifdef __cplusplus
#define __I volatile
extern "C" {
#else
#define __I volatile const
#endif
#define __O volatile
#define __IO volatile
#define __STATIC_INLINE static inline
#define __CLZ(value) ((uint8_t)__builtin_clz(value))
#define __NOP() ((void)0)
#define __DSB() ((void)0)

#define __LDREXW(address) (*(address))
#define __LDREXH(address) (*(address))
static inline uint32_t store_word(uint32_t value, volatile uint32_t* address) { return *address = value, 0; }
static inline uint32_t store_half(uint16_t value, volatile uint16_t* address) { return *address = value, 0; }
#define __STREXW(value, address) store_word(value, address)
#define __STREXH(value, address) store_half(value, address)

/* registers.cpp has them. */
void NVIC_SetPendingIRQ(IRQn_Type interrupt);
uint32_t NVIC_GetPriority(IRQn_Type interrupt);
typedef struct {
  __IO uint32_t ISER[8];
} NVIC_Type;
extern NVIC_Type nvic_registers;
#define NVIC (&nvic_registers)

#ifdef __cplusplus
}
#endif

#endif
