// The servo on a board with an STM32: a hobby servo at PC6 turns as the bus commands. USART3 needs a transceiver for
// the bus that finds the direction by itself. Two pins, grounded or open, give its number. The light is on while it is
// released.
#include <cstdint>

#include "board.hpp"
#include "pin.hpp"
#include "pwm.hpp"
#include "servo.hpp"

namespace {

servo::Buffers buffers;

const board::Pin number_low = {GPIOE, GPIO_PIN_2};
const board::Pin number_high = {GPIOE, GPIO_PIN_3};

/// Return 1 to 4: both pins grounded give 1.
std::uint8_t address() {
  board::configure_input(number_low, GPIO_PULLUP);
  board::configure_input(number_high, GPIO_PULLUP);
  return static_cast<std::uint8_t>(1 + (number_low.read() ? 1 : 0) + (number_high.read() ? 2 : 0));
}

/// A pulse every 20 ms, of 1.5 ms for 0 rad and 1 ms more for a turn by pi. Without a pulse it gives way. Hobby servos
/// cannot report an angle: the commanded one is reported once the time is over.
class HobbyServo {
 public:
  void turn(float angle_rad, float time_s) {
    constexpr float quarter_rad = 1.5707963F;
    const float turn = angle_rad > quarter_rad ? 1.0F : angle_rad < -quarter_rad ? -1.0F : angle_rad / quarter_rad;
    pwm_.set(0, static_cast<std::uint32_t>(1500.0F + 500.0F * turn));
    angle_rad_ = angle_rad;
    begun_us_ = board::now_us();
    time_us_ = static_cast<std::uint32_t>(time_s * 1e6F);
  }
  void release() {
    pwm_.set(0, 0);
    time_us_ = 0;
  }
  float angle_rad() const { return angle_rad_; }
  bool moves() {
    if (board::now_us() - begun_us_ >= time_us_) time_us_ = 0;  // so that the clock may wrap
    return time_us_ != 0;
  }

 private:
  static constexpr std::uint32_t count_hz = 1'000'000, period_us = 20'000;

  static TIM_TypeDef* connect() {
    __HAL_RCC_TIM3_CLK_ENABLE();
    board::configure_alternate({GPIOC, GPIO_PIN_6}, board::alternate::timer3);
    return TIM3;
  }

  board::Pwm pwm_{connect(), board::slow_timer_hz, count_hz, period_us, 1};
  float angle_rad_ = 0.0F;
  std::uint32_t begun_us_ = 0;
  std::uint32_t time_us_ = 0;
};

}  // namespace

int main() {
  board::start(servo_bus::baud, servo_bus::stop_bits);
  static HobbyServo motor;
  static servo::Servo<HobbyServo, wirebond::stm32_hal::Uart> firmware(motor, board::uart(), buffers, address());
  board::serve(firmware.link());
  for (;;) {
    firmware.poll(board::now_us());
    board::light.write(firmware.is_released());
    board::rest();
  }
}
