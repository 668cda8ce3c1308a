// Two quadrature encoders, at TIM3 and TIM4, which count all four edges of a line.
#pragma once

#include <cstdint>

#include "board.hpp"
#include "pin.hpp"

namespace board {

/// The counter of one encoder, which wraps; configure its timer's clock and pins first.
class Encoder {
 public:
  explicit Encoder(TIM_TypeDef* timer) {
    handle_.Instance = timer;
    handle_.Init.Period = 0xFFFF;
    TIM_Encoder_InitTypeDef init{};
    init.EncoderMode = TIM_ENCODERMODE_TI12;
    init.IC1Polarity = init.IC2Polarity = TIM_ICPOLARITY_RISING;
    init.IC1Selection = init.IC2Selection = TIM_ICSELECTION_DIRECTTI;
    init.IC1Prescaler = init.IC2Prescaler = TIM_ICPSC_DIV1;
    init.IC1Filter = init.IC2Filter = 6;  // a spike of less than 0.1 us is not an edge
    if (HAL_TIM_Encoder_Init(&handle_, &init) != HAL_OK) fail();
    if (HAL_TIM_Encoder_Start(&handle_, TIM_CHANNEL_ALL) != HAL_OK) fail();
  }

  /// Return the ticks since the last call, forwards positive. Call it at least once in 32767 ticks.
  std::int16_t take_ticks() {
    const auto now = static_cast<std::uint16_t>(__HAL_TIM_GET_COUNTER(&handle_));
    const auto ticks = static_cast<std::int16_t>(static_cast<std::uint16_t>(now - taken_));
    taken_ = now;
    return ticks;
  }

 private:
  TIM_HandleTypeDef handle_{};
  std::uint16_t taken_ = 0;
};

/// Left: PC6 and PC7. Right: PD12 and PD13; it is mounted the other way round, so its two lines are swapped.
struct Encoders {
  Encoder left{connect_left()};
  Encoder right{connect_right()};

 private:
  static TIM_TypeDef* connect_left() {
    __HAL_RCC_TIM3_CLK_ENABLE();
    configure_alternate({GPIOC, GPIO_PIN_6}, alternate::timer3, GPIO_PULLUP);
    configure_alternate({GPIOC, GPIO_PIN_7}, alternate::timer3, GPIO_PULLUP);
    return TIM3;
  }
  static TIM_TypeDef* connect_right() {
    __HAL_RCC_TIM4_CLK_ENABLE();
    configure_alternate({GPIOD, GPIO_PIN_12}, alternate::timer4, GPIO_PULLUP);
    configure_alternate({GPIOD, GPIO_PIN_13}, alternate::timer4, GPIO_PULLUP);
    return TIM4;
  }
};

}  // namespace board
