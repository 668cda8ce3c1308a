// Differences of the STM32F407 from other families: its HAL, the rates of its clocks, names of pins' functions, DMA,
// timers.
#pragma once

#include <cstdint>

#include "stm32f4xx_hal.h"

namespace board {

// ---- after `start_clocks`; the timers of APB1 and APB2 count at twice their bus's clock (RM0090, 7.2)

constexpr std::uint32_t slow_timer_hz = 84'000'000;   ///< TIM2 to TIM7, TIM12 to TIM14
constexpr std::uint32_t fast_timer_hz = 168'000'000;  ///< TIM1, TIM8 to TIM11

/// Set 168 MHz from the crystal or, if that does not start, from the internal oscillator, whose 1 % is within a UART's
/// tolerance at room temperature. Returns false if the HAL refuses both.
bool start_clocks();

// ---- the UART

constexpr IRQn_Type receive_dma_interrupt = DMA1_Stream1_IRQn;
constexpr IRQn_Type transmit_dma_interrupt = DMA1_Stream3_IRQn;

/// Start USART3 with the settings in `Init`, one sample per bit, circular DMA in and normal DMA out. Returns false if
/// the HAL refuses.
bool start_family_uart(UART_HandleTypeDef& uart);

// ---- pins

namespace alternate {
constexpr std::uint8_t usart3 = GPIO_AF7_USART3;
constexpr std::uint8_t timer1 = GPIO_AF1_TIM1;
constexpr std::uint8_t timer3 = GPIO_AF2_TIM3;
constexpr std::uint8_t timer4 = GPIO_AF2_TIM4;
}  // namespace alternate

// ---- timers of rhythms.hpp

struct RhythmTimer {
  TIM_TypeDef* timer;
  IRQn_Type interrupt;
  std::uint32_t timer_hz;
  void (*enable_clock)();
};

inline const RhythmTimer rhythm_timers[] = {
    {TIM6, TIM6_DAC_IRQn, slow_timer_hz, [] { __HAL_RCC_TIM6_CLK_ENABLE(); }},
    {TIM7, TIM7_IRQn, slow_timer_hz, [] { __HAL_RCC_TIM7_CLK_ENABLE(); }},
    {TIM13, TIM8_UP_TIM13_IRQn, slow_timer_hz, [] { __HAL_RCC_TIM13_CLK_ENABLE(); }},
    {TIM14, TIM8_TRG_COM_TIM14_IRQn, slow_timer_hz, [] { __HAL_RCC_TIM14_CLK_ENABLE(); }},
};

}  // namespace board
