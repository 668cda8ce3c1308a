// I2C3 at 400 kHz.
#pragma once

#include "family.hpp"

namespace board {

/// The family has its pins. Again after an error: it frees the peripheral. False: the HAL refuses.
bool start_i2c();

/// After `start_i2c`.
I2C_HandleTypeDef& i2c();

}  // namespace board
