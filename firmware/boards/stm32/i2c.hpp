// I2C3 at 400 kHz.
#pragma once

#include "family.hpp"

namespace board {

/// Start I2C3; the family has its pins. Call it again after an error: it frees the peripheral. Returns false if the HAL
/// refuses.
bool start_i2c();

/// Return I2C3, after `start_i2c`.
I2C_HandleTypeDef& i2c();

}  // namespace board
