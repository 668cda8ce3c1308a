// Common computations of ports with a UART and DMA: where in the ring DMA writes, which errors of a status are new,
// whether an interrupt is enabled. Numbers only: no register, no vendor's name. C99 and C++.
#ifndef WIREBOND_DMA_UART_H
#define WIREBOND_DMA_UART_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#endif

/// Return where DMA writes next in a ring of `size` bytes, if it counts down and `left` are left of this round.
static inline size_t wirebond_ring_position(size_t size, uint32_t left) {
  const size_t position = size - left;
  return position == size ? 0 : position;  // the counter may be read at 0, before it starts the next round
}

/// A UART's status at the last query. Initially zeros.
typedef struct wirebond_status_look {
  uint32_t status;
  uint32_t left;  ///< of the DMA's round
} wirebond_status_look_t;

/// Return the flags of `status` that were not set at the last query, for a UART whose error flags are cleared by two
/// reads: of the status, and of the next byte by DMA. Reading the byte here could take it away from DMA. So flags count
/// as old until a byte comes. The UART's interrupt.
static inline uint32_t wirebond_new_flags(wirebond_status_look_t* look, uint32_t status, uint32_t left) {
  const uint32_t flags = left == look->left ? status & ~look->status : status;
  look->status = status;
  look->left = left;
  return flags;
}

/// Check an interrupt's bit in registers such as `NVIC->ISER`.
static inline bool wirebond_interrupt_enabled(const volatile uint32_t* registers, uint32_t interrupt) {
  return (registers[interrupt / 32] >> interrupt % 32 & 1u) != 0;
}

#ifdef __cplusplus
}
#endif

#endif
