// I2C3 of an STM32G473: PC8 is its clock, PC9 its data. See i2c.hpp.
#include "i2c.hpp"

#include "pin.hpp"

namespace board {

namespace {

/// RM0440, I2C_TIMINGR, in steps of ten cycles of 170 MHz, 59 ns: the clock is low for 26 steps and high for 15, which
/// with its edges is 2.5 us; data changes 4 steps after the clock falls, and 7 before it rises.
constexpr std::uint32_t timing = 9U << 28 | 6U << 20 | 4U << 16 | 14U << 8 | 25U;

}  // namespace

I2C_HandleTypeDef& i2c() {
  static I2C_HandleTypeDef handle;
  return handle;
}

bool start_i2c() {
  __HAL_RCC_I2C3_CLK_ENABLE();
  __HAL_RCC_I2C3_FORCE_RESET();  // it may wait for an end that never came
  __HAL_RCC_I2C3_RELEASE_RESET();
  configure({GPIOC, GPIO_PIN_8}, GPIO_MODE_AF_OD, GPIO_PULLUP, GPIO_AF8_I2C3);
  configure({GPIOC, GPIO_PIN_9}, GPIO_MODE_AF_OD, GPIO_PULLUP, GPIO_AF8_I2C3);
  I2C_HandleTypeDef& handle = i2c();
  handle = {};
  handle.Instance = I2C3;
  handle.Init.Timing = timing;
  handle.Init.AddressingMode = I2C_ADDRESSINGMODE_7BIT;
  return HAL_I2C_Init(&handle) == HAL_OK;
}

}  // namespace board
