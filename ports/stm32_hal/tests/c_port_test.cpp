// The port in C on the double of the HAL: its additions to the port in C++, whose tests drive the same calls.
#include "stm32f4xx_hal.h"

#if USE_HAL_UART_REGISTER_CALLBACKS != 1  // its calls are the same then

#include <doctest/doctest.h>

#include <array>
#include <cstdint>
#include <string>

#include "../c/wirebond_stm32_hal.h"
#include "board.hpp"

namespace fake = wirebond::fake;

namespace {

std::string pin_log;

void drive(bool on) { pin_log += on ? '+' : '-'; }

}  // namespace

TEST_CASE("in C the driver of RS-485 is on from before a run until nothing follows it, where there is one") {
  fake::Line in{1'000'000, 10};
  fake::Line out{1'000'000, 10};
  fake::Uart hardware{in, out};
  Board board{hardware};
  wirebond_stm32_hal_t uart{};
  uart.handle = &huart3;
  uart.interrupt = USART3_IRQn;
#pragma GCC diagnostic push
#pragma GCC diagnostic ignored "-Wmissing-field-initializers"  // C leaves them out without a word
  const wirebond_port_t port = WIREBOND_STM32_HAL_PORT(uart, nullptr);
#pragma GCC diagnostic pop
  std::array<std::uint8_t, 3> bytes{1, 2, 3};
  REQUIRE(port.start_transmit(port.context, bytes.data(), bytes.size()));
  board.run(100'000);
  port.line_free(port.context);
  CHECK(pin_log.empty());
  uart.drive = drive;
  REQUIRE(port.start_transmit(port.context, bytes.data(), bytes.size()));
  CHECK(pin_log == "+");
  board.run(200'000);
  CHECK(pin_log == "+");
  port.line_free(port.context);
  CHECK(pin_log == "+-");
  hardware.refuse_transmits(1);
  CHECK_FALSE(port.start_transmit(port.context, bytes.data(), bytes.size()));
  CHECK(pin_log == "+-+-");
}

#endif
