// The linear axis on a board with an STM32: the left motor and the left encoder at the pins in boards/stm32. The slide
// is at the lower end when the board starts. The light is on while silence has stopped it. Parameters are lost when the
// power goes off.
#include <cstddef>

#include "axis.hpp"
#include "board.hpp"
#include "encoders.hpp"
#include "motors.hpp"

namespace {

constexpr float full_speed_m_s = 1.0F;                  // speed at full voltage
constexpr float m_per_tick = 0.008F / (4.0F * 256.0F);  // a spindle of 8 mm per turn; 256 lines, four edges each

axis::Buffers buffers;

/// The slide's speed is not controlled: the motor's voltage follows the command.
class Slide {
 public:
  float position_m() {
    ticks_ += encoders_.left.take_ticks();
    return static_cast<float>(ticks_) * m_per_tick;
  }
  void set_speed(float speed_m_s) { motors_.set(speed_m_s / full_speed_m_s, 0.0F); }
  void store(std::size_t, float) const {}  // a board with an EEPROM writes it there

 private:
  board::Motors motors_;
  board::Encoders encoders_;
  int ticks_ = 0;
};

}  // namespace

int main() {
  board::start(linear_axis::baud, linear_axis::stop_bits);
  static Slide slide;
  static axis::Axis<Slide, wirebond::stm32_hal::Uart> firmware(slide, board::uart(), buffers);
  board::serve(firmware.link());
  for (;;) {
    firmware.poll(board::now_us());
    board::light.write(firmware.is_stopped_by_silence());
    board::rest();
  }
}
