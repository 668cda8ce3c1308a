// A timer's channels as PWM outputs, for any load.
#pragma once

#include <cstdint>

#include "board.hpp"

namespace board {

/// A timer of 16 bits, whose counter wraps every `period` counts. Configure its clock and pins first.
class Pwm {
 public:
  /// `count_hz` divides `timer_hz`. All `channels` are low until `set`.
  Pwm(TIM_TypeDef* timer, std::uint32_t timer_hz, std::uint32_t count_hz, std::uint32_t period, int channels) {
    handle_.Instance = timer;
    handle_.Init.Prescaler = timer_hz / count_hz - 1;
    handle_.Init.Period = period - 1;
    handle_.Init.AutoReloadPreload = TIM_AUTORELOAD_PRELOAD_ENABLE;
    if (HAL_TIM_PWM_Init(&handle_) != HAL_OK) fail();
    TIM_OC_InitTypeDef output{};
    output.OCMode = TIM_OCMODE_PWM1;
    for (int i = 0; i < channels; ++i) {
      const std::uint32_t channel = names[i];
      if (HAL_TIM_PWM_ConfigChannel(&handle_, &output, channel) != HAL_OK) fail();
      if (HAL_TIM_PWM_Start(&handle_, channel) != HAL_OK) fail();
    }
  }

  /// Set the output high for this many counts of each period. `channel`: 0 to 3.
  void set(int channel, std::uint32_t counts) { __HAL_TIM_SET_COMPARE(&handle_, names[channel], counts); }

 private:
  static constexpr std::uint32_t names[] = {TIM_CHANNEL_1, TIM_CHANNEL_2, TIM_CHANNEL_3, TIM_CHANNEL_4};

  TIM_HandleTypeDef handle_{};
};

}  // namespace board
