// The battery's voltage, at PC0 after a divider.
#pragma once

namespace board {

/// Start the measurement. Once, after `start`. Calls `fail` if the HAL refuses.
void start_battery();

/// Return the voltage at the pin, 0 to 3.3 V. Takes some microseconds.
float battery_pin_v();

}  // namespace board
