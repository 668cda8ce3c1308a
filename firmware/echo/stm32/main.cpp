// The echo on a board with an STM32: it needs only a USB adapter at PD8 and PD9. Its light changes with each echo.
#include "board.hpp"
#include "echo.hpp"
#include "pin.hpp"

namespace {

echo::Buffers buffers;

struct Light {
  void blink() { board::light.toggle(); }
};

}  // namespace

int main() {
  board::start(enterprize::baud, enterprize::stop_bits);
  static Light light;
  static echo::Echo<Light, wirebond::stm32_hal::Uart> firmware(light, board::uart(), buffers);
  board::serve(firmware.link());
  for (;;) {
    firmware.poll(board::now_us());
    board::rest();
  }
}
