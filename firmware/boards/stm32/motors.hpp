// Two brushed motors, each at an H bridge with two inputs (DRV8833, DRV8871, TB6612 and the like), at TIM1.
#pragma once

#include <cstdint>
#include <initializer_list>

#include "pin.hpp"
#include "pwm.hpp"

namespace board {

/// Left: PE9 forwards, PE11 backwards. Right: PE13 forwards, PE14 backwards. 20 kHz, which is inaudible. Put a resistor
/// to ground at each bridge's inputs, so that motors rest before this is constructed, too.
class Motors {
 public:
  /// The motors rest from now on.
  Motors() : pwm_(connect(), fast_timer_hz, fast_timer_hz, period, 4) {}

  /// Set -1 to 1 of full voltage; values beyond count as full.
  void set(float left, float right) {
    set_bridge(0, left);
    set_bridge(2, right);
  }

 private:
  static constexpr std::uint32_t period = fast_timer_hz / 20'000;

  static TIM_TypeDef* connect() {
    __HAL_RCC_TIM1_CLK_ENABLE();
    for (const std::uint16_t mask : {GPIO_PIN_9, GPIO_PIN_11, GPIO_PIN_13, GPIO_PIN_14}) {
      configure_alternate({GPIOE, mask}, alternate::timer1);
    }
    return TIM1;
  }

  void set_bridge(int forwards, float part) {
    const float amount = part < 0.0F ? -part : part;
    const auto counts = static_cast<std::uint32_t>((amount > 1.0F ? 1.0F : amount) * static_cast<float>(period));
    pwm_.set(forwards, part > 0.0F ? counts : 0);
    pwm_.set(forwards + 1, part < 0.0F ? counts : 0);
  }

  Pwm pwm_;
};

}  // namespace board
