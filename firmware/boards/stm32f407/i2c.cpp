// I2C3 of an STM32F407: PA8 is its clock, PC9 its data. See i2c.hpp.
#include "i2c.hpp"

#include "pin.hpp"

namespace board {

I2C_HandleTypeDef& i2c() {
  static I2C_HandleTypeDef handle;
  return handle;
}

bool start_i2c() {
  __HAL_RCC_I2C3_CLK_ENABLE();
  __HAL_RCC_I2C3_FORCE_RESET();  // it may wait for an end that never came
  __HAL_RCC_I2C3_RELEASE_RESET();
  configure({GPIOA, GPIO_PIN_8}, GPIO_MODE_AF_OD, GPIO_PULLUP, GPIO_AF4_I2C3);
  configure({GPIOC, GPIO_PIN_9}, GPIO_MODE_AF_OD, GPIO_PULLUP, GPIO_AF4_I2C3);
  I2C_HandleTypeDef& handle = i2c();
  handle = {};
  handle.Instance = I2C3;
  handle.Init.ClockSpeed = 400'000;
  handle.Init.DutyCycle = I2C_DUTYCYCLE_2;
  handle.Init.AddressingMode = I2C_ADDRESSINGMODE_7BIT;
  return HAL_I2C_Init(&handle) == HAL_OK;
}

}  // namespace board
