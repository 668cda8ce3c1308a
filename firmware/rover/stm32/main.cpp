// The rover on a board with an STM32: motors, encoders and battery at the pins in boards/stm32, and here an e-stop and
// a charger. The light is on while silence has stopped it, and in safe mode.
#include "battery.hpp"
#include "board.hpp"
#include "encoders.hpp"
#include "motors.hpp"
#include "rover.hpp"

namespace {

constexpr float full_speed_m_s = 2.0F;   // speed at full voltage
constexpr float battery_divider = 5.7F;  // 47 kOhm above, 10 kOhm below
const board::Pin estop_opened = {GPIOE, GPIO_PIN_2};
const board::Pin not_charging = {GPIOE, GPIO_PIN_3};

rover::Buffers buffers;

/// The wheels' speed is not controlled: their voltage follows the command, and the encoders' ticks go to the host.
class Base {
 public:
  Base() {
    // The switch connects its pin to ground until it is pressed: a broken wire stops the rover, too.
    board::configure_input(estop_opened, GPIO_PULLUP);
    board::configure_input(not_charging, GPIO_PULLUP);  // chargers pull it down
    board::start_battery();
  }

  void set_wheel_speeds(float left_m_s, float right_m_s) {
    motors_.set(left_m_s / full_speed_m_s, right_m_s / full_speed_m_s);
  }
  std::int16_t take_left_ticks() { return encoders_.left.take_ticks(); }
  std::int16_t take_right_ticks() { return encoders_.right.take_ticks(); }
  float battery_v() const { return board::battery_pin_v() * battery_divider; }
  bool estop_pressed() const { return estop_opened.read(); }
  bool charging() const { return !not_charging.read(); }
  void report(const char*) const {}  // diffdrive has no log

 private:
  board::Motors motors_;
  board::Encoders encoders_;
};

}  // namespace

int main() {
  board::start(diffdrive::baud, diffdrive::stop_bits);
  static Base base;
  static rover::Rover<Base, wirebond::stm32_hal::Uart> firmware(base, board::uart(), buffers);
  board::serve(firmware.link());
  for (;;) {
    firmware.poll(board::now_us());
    board::light.write(firmware.in_safe_mode() || firmware.stopped_by_silence());
    board::rest();
  }
}
