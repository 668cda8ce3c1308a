// Differences of the STM32G473 from other families: its HAL, the rates of its clocks, names of pins' functions, DMA,
// timers.
#pragma once

#include <cstdint>

#include "stm32g4xx_hal.h"

namespace board {

// ---- after `start_clocks`: all timers count at the core's clock

constexpr std::uint32_t slow_timer_hz = 170'000'000;  ///< TIM2 to TIM7
constexpr std::uint32_t fast_timer_hz = 170'000'000;  ///< TIM1, TIM8, TIM15 to TIM17, TIM20

/// Set 170 MHz from the crystal or, if that does not start, from the internal oscillator, whose 1 % is within a UART's
/// tolerance. Returns false if the HAL refuses both.
bool start_clocks();

// ---- the UART

constexpr IRQn_Type receive_dma_interrupt = DMA1_Channel1_IRQn;
constexpr IRQn_Type transmit_dma_interrupt = DMA1_Channel7_IRQn;

/// Start USART3 with the settings in `Init`, one sample per bit, circular DMA in and normal DMA out. Returns false if
/// the HAL refuses.
bool start_family_uart(UART_HandleTypeDef& uart);

// ---- pins

namespace alternate {
constexpr std::uint8_t usart3 = GPIO_AF7_USART3;
constexpr std::uint8_t timer1 = GPIO_AF2_TIM1;
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
    {TIM7, TIM7_DAC_IRQn, slow_timer_hz, [] { __HAL_RCC_TIM7_CLK_ENABLE(); }},
    {TIM16, TIM1_UP_TIM16_IRQn, fast_timer_hz, [] { __HAL_RCC_TIM16_CLK_ENABLE(); }},
    {TIM17, TIM1_TRG_COM_TIM17_IRQn, fast_timer_hz, [] { __HAL_RCC_TIM17_CLK_ENABLE(); }},
};

}  // namespace board
