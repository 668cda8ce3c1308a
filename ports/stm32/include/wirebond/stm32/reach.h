// Memory that the DMA of a UART cannot reach, by STM32 family: for all ports of that vendor. Addresses only. C99 and
// C++.
#ifndef WIREBOND_STM32_REACH_H
#define WIREBOND_STM32_REACH_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#endif

typedef enum wirebond_stm32_family {
  WIREBOND_STM32_F4,  ///< F3 too
  WIREBOND_STM32_G4,
  WIREBOND_STM32_H7,
  WIREBOND_STM32_OTHER  ///< no memory is refused
} wirebond_stm32_family_t;

/// The family of the vendor's headers.
#if defined(STM32F4) || defined(STM32F3)
#define WIREBOND_STM32_FAMILY WIREBOND_STM32_F4
#elif defined(STM32G4)
#define WIREBOND_STM32_FAMILY WIREBOND_STM32_G4
#elif defined(STM32H7)
#define WIREBOND_STM32_FAMILY WIREBOND_STM32_H7
#else
#define WIREBOND_STM32_FAMILY WIREBOND_STM32_OTHER
#endif

/// Check whether DMA1 and DMA2 of this family can reach all of `address .. address + size - 1`, and count it in 16
/// bits.
static inline bool wirebond_stm32_dma_reaches(wirebond_stm32_family_t family, uintptr_t address, size_t size) {
  const uintptr_t end = address + size;
  if (size > 0xFFFF) return false;
  switch (family) {
    case WIREBOND_STM32_F4:  // the core-coupled memory is on the core's data bus alone (RM0090, 2.1)
      return end <= 0x10000000 || address >= 0x10010000;
    case WIREBOND_STM32_G4:  // DMA finds the core-coupled memory at its second address, after SRAM2 (RM0440, 2.4)
      return end <= 0x10000000 || address >= 0x10008000;
    case WIREBOND_STM32_H7:  // the tightly coupled memories are for the core and MDMA (RM0433, 2.1)
      return address >= 0x10000 && (end <= 0x20000000 || address >= 0x20020000);
    case WIREBOND_STM32_OTHER: break;
  }
  return true;
}

#ifdef __cplusplus
}
#endif

#endif
