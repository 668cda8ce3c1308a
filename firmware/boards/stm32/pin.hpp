// Pins. The clocks of their ports are enabled by `start`.
#pragma once

#include <cstdint>

#include "family.hpp"

namespace board {

struct Pin {
  GPIO_TypeDef* port;
  std::uint16_t mask;

  void write(bool high) const { HAL_GPIO_WritePin(port, mask, high ? GPIO_PIN_SET : GPIO_PIN_RESET); }
  void toggle() const { HAL_GPIO_TogglePin(port, mask); }
  bool read() const { return HAL_GPIO_ReadPin(port, mask) == GPIO_PIN_SET; }
};

inline void configure(const Pin& pin, std::uint32_t mode, std::uint32_t pull, std::uint8_t alternate = 0) {
  GPIO_InitTypeDef init{};
  init.Pin = pin.mask;
  init.Mode = mode;
  init.Pull = pull;
  init.Speed = GPIO_SPEED_FREQ_HIGH;
  init.Alternate = alternate;
  HAL_GPIO_Init(pin.port, &init);
}

/// Configure an output, low from now on.
inline void configure_output(const Pin& pin) {
  pin.write(false);
  configure(pin, GPIO_MODE_OUTPUT_PP, GPIO_NOPULL);
}
inline void configure_input(const Pin& pin, std::uint32_t pull) { configure(pin, GPIO_MODE_INPUT, pull); }
inline void configure_alternate(const Pin& pin, std::uint8_t alternate, std::uint32_t pull = GPIO_NOPULL) {
  configure(pin, GPIO_MODE_AF_PP, pull, alternate);
}

inline const Pin light = {GPIOD, GPIO_PIN_14};  ///< the red one of an STM32F4 Discovery board

}  // namespace board
