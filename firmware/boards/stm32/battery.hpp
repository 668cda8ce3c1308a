// The battery's voltage, at PC0 behind a divider.
#pragma once

namespace board {

/// Once, after `start`. What the HAL refuses ends in `fail`.
void start_battery();

/// At the pin, 0 to 3.3 V. Takes some microseconds.
float battery_pin_v();

}  // namespace board
