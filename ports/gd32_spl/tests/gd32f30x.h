// A test double of the vendor's library: the names that the port uses, as the vendor's user guide describes them.
// They control the UART of fake/.
#pragma once

#include <cstdint>

#define USART0 0x40013800u
#define DMA0 0x40020000u

#define DMA_INTF_FTFIF 2u
#define DMA_INTF_HTFIF 4u
#define DMA_INT_FLAG_FTF DMA_INTF_FTFIF
#define DMA_INT_FLAG_HTF DMA_INTF_HTFIF
#define DMA_CHXCTL_CHEN 1u
#define DMA_CHXCTL_FTFIE 2u
#define DMA_CHXCTL_HTFIE 4u
#define DMA_CHXCTL_CMEN 32u
#define DMA_CHXCTL_MNAGA 128u
#define USART_CTL0_UEN 8192u
#define USART_STAT0_PERR 1u
#define USART_STAT0_FERR 2u
#define USART_STAT0_NERR 4u
#define USART_STAT0_ORERR 8u
#define USART_STAT0_IDLEF 16u
#define USART_CTL2_ERRIE 1u
#define USART_CTL2_DENR 64u
#define USART_CTL2_DENT 128u

enum IRQn_Type { USART0_IRQn = 37 };
enum FlagStatus { RESET, SET };
enum dma_channel_enum { DMA_CH3 = 3, DMA_CH4 };
enum usart_interrupt_enum { USART_INT_IDLE };
enum usart_interrupt_flag_enum { USART_INT_FLAG_IDLE };

std::uint32_t& DMA_CHCTL(std::uint32_t dma, dma_channel_enum channel);  // registers, macros in the vendor's
std::uint32_t& USART_CTL0(std::uint32_t usart);
std::uint32_t& USART_CTL2(std::uint32_t usart);
std::uint32_t& USART_STAT0(std::uint32_t usart);

void dma_channel_enable(std::uint32_t dma, dma_channel_enum channel);
void dma_channel_disable(std::uint32_t dma, dma_channel_enum channel);
void dma_memory_address_config(std::uint32_t dma, dma_channel_enum channel, std::uint32_t address);
void dma_transfer_number_config(std::uint32_t dma, dma_channel_enum channel, std::uint32_t number);
std::uint32_t dma_transfer_number_get(std::uint32_t dma, dma_channel_enum channel);
void dma_interrupt_enable(std::uint32_t dma, dma_channel_enum channel, std::uint32_t source);
FlagStatus dma_interrupt_flag_get(std::uint32_t dma, dma_channel_enum channel, std::uint32_t flag);
void dma_interrupt_flag_clear(std::uint32_t dma, dma_channel_enum channel, std::uint32_t flag);
std::uint16_t usart_data_receive(std::uint32_t usart);
void usart_interrupt_enable(std::uint32_t usart, usart_interrupt_enum interrupt);
void usart_interrupt_disable(std::uint32_t usart, usart_interrupt_enum interrupt);
FlagStatus usart_interrupt_flag_get(std::uint32_t usart, usart_interrupt_flag_enum flag);
void NVIC_SetPendingIRQ(IRQn_Type interrupt);

struct NVIC_Type {
  std::uint32_t ISER[8];
};
inline NVIC_Type nvic_registers{};
#define NVIC (&nvic_registers)
