// The balance bot on a board with an STM32: motors and encoders at the pins in boards/stm32, an MPU-6050 at I2C3.
#include "balance.hpp"
#include "board.hpp"
#include "encoders.hpp"
#include "motors.hpp"
#include "mpu6050.hpp"

namespace {

constexpr float ticks_per_m = 1024.0F / (3.14159265F * 0.065F);  // 256 lines, four edges each; wheels of 65 mm

balance::Buffers buffers;

/// `Balance` reads the pitch first in each of its steps: everything is measured then.
class Body {
 public:
  /// A silent sensor counts as a fallen bot: its motors rest.
  float pitch_rad() {
    const std::uint32_t now_us = board::now_us();
    const float seconds = static_cast<float>(now_us - measured_us_) * 1e-6F;
    measured_us_ = now_us;
    const int ticks = encoders_.left.take_ticks() + encoders_.right.take_ticks();
    speed_m_s_ = static_cast<float>(ticks) / 2.0F / ticks_per_m / seconds;
    return sensor_.read(seconds, lean_) ? lean_.pitch_rad : 2.0F * balance::fallen_rad;
  }
  float pitch_rate_rad_s() const { return lean_.pitch_rate_rad_s; }
  float speed_m_s() const { return speed_m_s_; }
  void set_motors(float left, float right) { motors_.set(left, right); }

 private:
  board::Motors motors_;
  board::Encoders encoders_;
  board::Mpu6050 sensor_;
  board::Lean lean_;
  float speed_m_s_ = 0.0F;
  std::uint32_t measured_us_ = 0;
};

}  // namespace

int main() {
  board::start(pid_tuner::baud, pid_tuner::stop_bits);
  static Body body;
  static balance::Balance<Body, wirebond::stm32_hal::Uart> firmware(body, board::uart(), buffers);
  board::serve(firmware.link());
  for (;;) {
    firmware.poll(board::now_us());
    board::rest();
  }
}
