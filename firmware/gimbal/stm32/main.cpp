// The gimbal on a board with an STM32: six hobby servos, two triggers, and four timers instead of four tasks, so that
// it needs no RTOS. Servos cannot report an angle: the heads are reported at their commanded pose.
#include <cstdint>
#include <initializer_list>

#include "board.hpp"
#include "gimbal.hpp"
#include "heads.hpp"
#include "pin.hpp"
#include "pwm.hpp"
#include "rhythms.hpp"

namespace {

gimbal::Buffers buffers;

const board::Pin left_trigger = {GPIOE, GPIO_PIN_4};
const board::Pin right_trigger = {GPIOE, GPIO_PIN_5};

/// Left yaw and pitch: PC6, PC7. Right: PC8, PC9. Main: PD12, PD13. A pulse every 20 ms, of 1.5 ms for 0 rad, 1 ms more
/// for a turn by pi; no pulse before the first command, so that the heads stay in place.
class Turret : public gimbal::Heads {
 public:
  Turret() {
    board::configure_output(left_trigger);
    board::configure_output(right_trigger);
  }

  float bullet_speed_m_s() const { return 0.0F; }  // nothing measures it
  void aim(const gimbal::Pose& left, const gimbal::Pose& right, const gimbal::Pose& main) {
    Heads::aim(left, main);
    heads_.set(0, pulse_us(left.yaw_rad));
    heads_.set(1, pulse_us(left.pitch_rad));
    heads_.set(2, pulse_us(right.yaw_rad));
    heads_.set(3, pulse_us(right.pitch_rad));
    main_.set(0, pulse_us(main.yaw_rad));
    main_.set(1, pulse_us(main.pitch_rad));
  }
  void shoot(std::uint8_t left_mode, std::uint8_t right_mode) {
    left_trigger.write(left_mode != 0);
    right_trigger.write(right_mode != 0);
  }

 private:
  static constexpr std::uint32_t count_hz = 1'000'000, period_us = 20'000;

  /// Return the pulse of an angle. Servos turn by a quarter to either side; NaN turns none.
  static std::uint32_t pulse_us(float angle_rad) {
    constexpr float quarter_rad = 1.5707963F;
    const float turn = angle_rad > quarter_rad ? 1.0F : angle_rad < -quarter_rad ? -1.0F : angle_rad / quarter_rad;
    return turn == turn ? static_cast<std::uint32_t>(1500.0F + 500.0F * turn) : 1500;
  }

  static TIM_TypeDef* connect_heads() {
    __HAL_RCC_TIM3_CLK_ENABLE();
    for (const std::uint16_t mask : {GPIO_PIN_6, GPIO_PIN_7, GPIO_PIN_8, GPIO_PIN_9}) {
      board::configure_alternate({GPIOC, mask}, board::alternate::timer3);
    }
    return TIM3;
  }
  static TIM_TypeDef* connect_main() {
    __HAL_RCC_TIM4_CLK_ENABLE();
    for (const std::uint16_t mask : {GPIO_PIN_12, GPIO_PIN_13}) {
      board::configure_alternate({GPIOD, mask}, board::alternate::timer4);
    }
    return TIM4;
  }

  board::Pwm heads_{connect_heads(), board::slow_timer_hz, count_hz, period_us, 4};
  board::Pwm main_{connect_main(), board::slow_timer_hz, count_hz, period_us, 2};
};

static_assert(gimbal::senders == board::rhythms, "each sender has a rhythm");

}  // namespace

int main() {
  board::start(enterprize::baud, enterprize::stop_bits);
  static Turret turret;
  static gimbal::Gimbal<Turret, wirebond::stm32_hal::Uart> firmware(turret, board::uart(), buffers);
  board::serve(firmware.link());
  board::start_rhythms([](std::size_t sender) { static_cast<void>(firmware.report(sender)); }, gimbal::period_us);
  for (;;) {
    firmware.poll(board::now_us());
    board::rest();
  }
}
