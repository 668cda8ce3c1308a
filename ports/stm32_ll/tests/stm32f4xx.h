// A test double of the vendor's device header: the registers and bits that the port uses, as RM0090 (chapters 10 and
// 30) describes them. They control the UART of fake/. In C there are only the names, for a user's code: the port's own
// file in C is compiled as C++ here, so that the double sees each access.
#pragma once

#include <stdint.h>

#define STM32F4

#ifdef __cplusplus
/// Writing 0 clears a flag, writing 1 changes none.
class FlagRegister {
 public:
  operator uint32_t() const { return bits; }
  void operator=(uint32_t written) { bits &= written; }

  uint32_t bits = 0;
};

/// A read of it after the status clears the errors in the status, and may take a byte away from the DMA.
class DataRegister {
 public:
  operator uint32_t() const {
    ++reads;
    return 0;
  }
  mutable int reads = 0;
};

extern "C" {
#else
typedef volatile uint32_t FlagRegister, DataRegister;
#endif

typedef struct {
  FlagRegister SR;
  DataRegister DR;
  volatile uint32_t BRR, CR1, CR2, CR3, GTPR;
} USART_TypeDef;
typedef struct {
  volatile uint32_t LISR, HISR, LIFCR, HIFCR;
} DMA_TypeDef;
typedef struct {
  volatile uint32_t CR, NDTR, PAR, M0AR, M1AR, FCR;
} DMA_Stream_TypeDef;

#define USART_SR_PE 1u
#define USART_SR_FE 2u
#define USART_SR_NE 4u
#define USART_SR_ORE 8u
#define USART_SR_IDLE 16u
#define USART_SR_TC 64u
#define USART_CR1_IDLEIE 16u
#define USART_CR1_TCIE 64u
#define USART_CR1_PEIE 256u
#define USART_CR1_UE 8192u
#define USART_CR3_EIE 1u
#define USART_CR3_DMAR 64u
#define USART_CR3_DMAT 128u
#define DMA_SxCR_EN 1u
#define DMA_SxCR_TEIE 4u
#define DMA_SxCR_HTIE 8u
#define DMA_SxCR_TCIE 16u
#define DMA_SxCR_CIRC 256u
#define DMA_SxCR_MINC 1024u

extern USART_TypeDef usart3_registers;
extern DMA_TypeDef dma1_registers;
extern DMA_Stream_TypeDef dma1_streams[8];
#define USART3 (&usart3_registers)
#define DMA1 (&dma1_registers)
#define DMA1_Stream1 (&dma1_streams[1])
#define DMA1_Stream3 (&dma1_streams[3])

typedef enum { USART3_IRQn = 39 } IRQn_Type;
typedef struct {
  uint32_t ISER[8];
} NVIC_Type;
extern NVIC_Type nvic_registers;
#define NVIC (&nvic_registers)
void NVIC_SetPendingIRQ(IRQn_Type interrupt);

// The handlers of the vector table, which a user writes.
void USART3_IRQHandler(void);
void DMA1_Stream1_IRQHandler(void);

#ifdef __cplusplus
}
#endif
