// The port on the double of the HAL: it keeps the contract of a port, whatever the hardware and the HAL answer.
#include "wirebond/stm32_hal/uart.hpp"

#include <doctest/doctest.h>

#include <array>
#include <cstdint>

#include "board.hpp"
#include "stm32f4xx_hal.h"
#include "wirebond/fake/port_contract.hpp"

namespace fake = wirebond::fake;
using contract::Bytes;

namespace {

contract::Events<wirebond::stm32_hal::Uart> events{huart3, USART3_IRQn};

struct Bench : contract::Bench<Board, wirebond::stm32_hal::Uart> {
  Bench() : contract::Bench<Board, wirebond::stm32_hal::Uart>(::events) {
#if USE_HAL_UART_REGISTER_CALLBACKS == 1
    REQUIRE(wirebond::stm32_hal::register_events<::events>(huart3));
#endif
  }
};

}  // namespace

// What a user writes, as docs/firmware.md says.
extern "C" {
#if USE_HAL_UART_REGISTER_CALLBACKS != 1
void HAL_UARTEx_RxEventCallback(UART_HandleTypeDef* handle, uint16_t) {
  if (handle == &huart3) events.on_received();
}
void HAL_UART_TxCpltCallback(UART_HandleTypeDef* handle) {
  if (handle == &huart3) events.on_transmitted();
}
void HAL_UART_ErrorCallback(UART_HandleTypeDef* handle) {
  if (handle == &huart3) events.on_error();
}
#endif
void USART3_IRQHandler(void) { events.on_pended(); }
}

PORT_KEEPS_ITS_CONTRACT(Bench);

TEST_CASE("after an error of the DMA the ring starts again, and bytes come again") {
  Bench bench;
  REQUIRE(bench.start());
  bench.in.put(Bytes{1, 2}, 0);
  bench.uart.raise_now(fake::Event::dma_error);
  bench.board.run(20'000);
  CHECK(bench.events.log.front() == 'e');
  CHECK(bench.events.is_started);
  bench.board.run(50'000);
  const std::size_t place = bench.port.receive_position();
  bench.in.put(7, 50'000);
  bench.board.run(60'000);
  CHECK(bench.events.ring[place] == 7);
}

TEST_CASE("a start is refused while the HAL still stops DMA, and works afterwards") {
  Bench bench;
  bench.uart.behaviour.abort_time = 50'000;
  REQUIRE(bench.start());
  bench.uart.raise_now(fake::Event::dma_error);
  CHECK(bench.port.receiving());
  bench.board.run(0);
  REQUIRE_FALSE(bench.uart.receiving());
  CHECK_FALSE(bench.start());
  bench.board.run(70'000);
  CHECK(bench.events.is_started);
}

TEST_CASE("an error ends reception, and a start begins it") {
  Bench bench;
  CHECK_FALSE(bench.port.receiving());
  bench.uart.refuse_receives(2);
  CHECK_FALSE(bench.start());
  CHECK_FALSE(bench.port.receiving());
  CHECK_FALSE(bench.start());
  REQUIRE(bench.start());
  CHECK(bench.port.receiving());
}

TEST_CASE("HAL_ERROR at a start is an answer, and the next start works") {
  Bench bench;
  bench.uart.refuse_transmits(1);
  const Bytes bytes{1};
  CHECK_FALSE(bench.port.start_transmit(bytes.data(), bytes.size()));
  CHECK(bench.port.start_transmit(bytes.data(), bytes.size()));
}

TEST_CASE("a run whose DMA dies is reported as an error; reception and sending go on after it") {
  Bench bench;
  REQUIRE(bench.start());
  const Bytes bytes{1, 2, 3};
  REQUIRE(bench.port.start_transmit(bytes.data(), bytes.size()));
  bench.board.run(5'000);
  bench.uart.kill_transmit();
  bench.board.run(50'000);
  CHECK(bench.events.log == "e");
  CHECK(bench.events.is_started);
  CHECK(bench.port.start_transmit(bytes.data(), bytes.size()));
}

TEST_CASE("each family has memory that DMA cannot reach, and a buffer that only touches it is refused") {
  static_assert(WIREBOND_STM32_FAMILY == WIREBOND_STM32_F4);
  constexpr auto reaches = wirebond_stm32_dma_reaches;
  CHECK(reaches(WIREBOND_STM32_F4, 0x2000'0000, 1024));
  CHECK_FALSE(reaches(WIREBOND_STM32_F4, 0x1000'0000, 1));
  CHECK_FALSE(reaches(WIREBOND_STM32_F4, 0x1000'FFFF, 2));
  CHECK(reaches(WIREBOND_STM32_F4, 0x1001'0000, 2));
  CHECK_FALSE(reaches(WIREBOND_STM32_G4, 0x1000'7FFF, 1));
  CHECK(reaches(WIREBOND_STM32_G4, 0x2001'8000, 64));  // the same memory, where DMA finds it
  CHECK_FALSE(reaches(WIREBOND_STM32_H7, 0x2001'FFFF, 64));
  CHECK_FALSE(reaches(WIREBOND_STM32_H7, 0x0000'0000, 64));
  CHECK(reaches(WIREBOND_STM32_H7, 0x2400'0000, 64));
  CHECK(reaches(WIREBOND_STM32_OTHER, 0x1000'0000, 64));
  CHECK_FALSE(reaches(WIREBOND_STM32_OTHER, 0x1000'0000, 0x1'0000));  // more than DMA can count
}

TEST_CASE("each mistake in the settings is reported by its name") {
  using wirebond::Why;
  Bench bench;
  const auto check = [&] { return bench.port.check(115'200); };
  CHECK(check() == Why::nothing);
  uwTickPrio = 5;  // the UART's own: the tick cannot interrupt it
  CHECK(check() == Why::tick_below_uart);
  nvic_registers = {};
  CHECK(check() == Why::interrupt_off);
  CHECK(bench.port.check(921'600) == Why::baud_differs);
  huart3.hdmarx->Init.Mode = DMA_NORMAL;
  CHECK(check() == Why::receive_dma_not_circular);
  huart3.hdmatx = nullptr;
  CHECK(check() == Why::no_transmit_dma);
  const Bytes bytes{1};
  CHECK_FALSE(bench.port.start_transmit(bytes.data(), bytes.size()));
  huart3.hdmarx = nullptr;
  CHECK(check() == Why::no_receive_dma);
  CHECK_FALSE(bench.start());
  huart3.gState = HAL_UART_STATE_RESET;
  CHECK(check() == Why::uart_not_set_up);
}
