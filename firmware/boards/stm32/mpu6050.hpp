// Lean and its rate from an MPU-6050 at I2C3. Mounted flat, its x axis forwards and its z axis up.
#pragma once

#include <cmath>
#include <cstdint>

#include "i2c.hpp"

namespace board {

struct Lean {
  float pitch_rad = 0.0F;  ///< positive: forwards
  float pitch_rate_rad_s = 0.0F;
};

/// One context. A reading takes half a millisecond on the bus, for which the caller waits.
class Mpu6050 {
 public:
  /// Read into `lean`, `seconds` after the last reading. Returns false, and leaves `lean` unchanged, if the sensor does
  /// not answer.
  bool read(float seconds, Lean& lean) {
    if (!is_awake_ && !wake()) return false;
    std::uint8_t bytes[14];  // acceleration x y z, temperature, rate x y z: each 16 bits, the high byte first
    if (HAL_I2C_Mem_Read(&i2c(), address, first_data, I2C_MEMADD_SIZE_8BIT, bytes, sizeof bytes, timeout_ms) !=
        HAL_OK) {
      is_awake_ = false;
      return false;
    }
    const float forwards = number(bytes), up = number(bytes + 4);
    lean.pitch_rate_rad_s = number(bytes + 10) * (500.0F / 32768.0F) * radians_of_a_degree;
    // The rate follows quickly but drifts; gravity does not drift, but includes each push. So gravity corrects slowly.
    const float by_gravity = std::atan2(-forwards, up);
    const float by_rate = lean.pitch_rad + lean.pitch_rate_rad_s * seconds;
    lean.pitch_rad = has_pitch_ ? by_rate + gravity_share * (by_gravity - by_rate) : by_gravity;
    has_pitch_ = true;
    return true;
  }

 private:
  static constexpr std::uint16_t address = 0x68 << 1;
  static constexpr std::uint16_t power = 0x6B, filter = 0x1A, rate_range = 0x1B, first_data = 0x3B;
  static constexpr std::uint32_t timeout_ms = 2;
  static constexpr float radians_of_a_degree = 0.01745329F;
  static constexpr float gravity_share = 0.01F;  // with 5 ms a time constant of half a second

  static float number(const std::uint8_t* bytes) {
    return static_cast<float>(static_cast<std::int16_t>(static_cast<std::uint16_t>(bytes[0] << 8 | bytes[1])));
  }

  bool wake() {
    has_pitch_ = false;
    // Wake it, with the gyroscope's clock; 94 Hz; up to 500 degrees per second. Acceleration up to 2 g is its default.
    is_awake_ = start_i2c() && write(power, 1) && write(filter, 2) && write(rate_range, 1 << 3);
    return is_awake_;
  }
  bool write(std::uint16_t where, std::uint8_t value) {
    return HAL_I2C_Mem_Write(&i2c(), address, where, I2C_MEMADD_SIZE_8BIT, &value, 1, timeout_ms) == HAL_OK;
  }

  bool is_awake_ = false;
  bool has_pitch_ = false;
};

}  // namespace board
