// Start, UART and time of a board, common to all families; family.hpp has the rest.
#include "board.hpp"

#include <initializer_list>

#include "pin.hpp"

namespace board {

namespace {

UART_HandleTypeDef uart_handle;
TIM_HandleTypeDef clock_timer;
UartEvents uart_events;

void start_clock() {
  __HAL_RCC_TIM5_CLK_ENABLE();
  clock_timer.Instance = TIM5;  // it has 32 bits
  clock_timer.Init.Prescaler = slow_timer_hz / 1'000'000 - 1;
  clock_timer.Init.Period = 0xFFFF'FFFF;
  if (HAL_TIM_Base_Init(&clock_timer) != HAL_OK || HAL_TIM_Base_Start(&clock_timer) != HAL_OK) fail();
}

void start_uart(std::uint32_t baud, float stop_bits) {
  __HAL_RCC_USART3_CLK_ENABLE();
  configure_alternate({GPIOD, GPIO_PIN_8}, alternate::usart3);
  configure_alternate({GPIOD, GPIO_PIN_9}, alternate::usart3, GPIO_PULLUP);  // an unplugged pin sends no noise
  uart_handle.Instance = USART3;
  uart_handle.Init.BaudRate = baud;
  uart_handle.Init.WordLength = UART_WORDLENGTH_8B;
  uart_handle.Init.StopBits = stop_bits == 2.0F ? UART_STOPBITS_2 : UART_STOPBITS_1;
  uart_handle.Init.Parity = UART_PARITY_NONE;
  uart_handle.Init.Mode = UART_MODE_TX_RX;
  uart_handle.Init.HwFlowCtl = UART_HWCONTROL_NONE;
  uart_handle.Init.OverSampling = UART_OVERSAMPLING_16;
  if (!start_family_uart(uart_handle)) fail();
  for (const IRQn_Type interrupt : {USART3_IRQn, receive_dma_interrupt, transmit_dma_interrupt}) {
    HAL_NVIC_SetPriority(interrupt, uart_priority, 0);
    HAL_NVIC_EnableIRQ(interrupt);
  }
}

}  // namespace

void start(std::uint32_t baud, float stop_bits) {
  if (HAL_Init() != HAL_OK) fail();
  __HAL_RCC_GPIOA_CLK_ENABLE();
  __HAL_RCC_GPIOC_CLK_ENABLE();
  __HAL_RCC_GPIOD_CLK_ENABLE();
  __HAL_RCC_GPIOE_CLK_ENABLE();
  configure_output(light);
  if (!start_clocks()) fail();
  start_clock();
  start_uart(baud, stop_bits);
}

wirebond::stm32_hal::Uart& uart() {
  static wirebond::stm32_hal::Uart port(uart_handle, USART3_IRQn);
  return port;
}

std::uint32_t now_us() { return TIM5->CNT; }

void fail() {
  __disable_irq();
  light.write(true);
  for (;;) {
  }
}

void set_uart_events(const UartEvents& events) {
  __disable_irq();
  uart_events = events;
  __enable_irq();
}

}  // namespace board

// ---- called by the start-up code and the HAL

extern "C" {

void _init() {}  // of newlib; there is nothing to do

void SysTick_Handler() { HAL_IncTick(); }

void USART3_IRQHandler() {
  if (board::uart_events.link != nullptr) board::uart_events.pended(board::uart_events.link);
  HAL_UART_IRQHandler(&board::uart_handle);
}

void HAL_UARTEx_RxEventCallback(UART_HandleTypeDef*, std::uint16_t) {
  board::uart_events.received(board::uart_events.link);
}
void HAL_UART_TxCpltCallback(UART_HandleTypeDef*) { board::uart_events.transmitted(board::uart_events.link); }
void HAL_UART_ErrorCallback(UART_HandleTypeDef*) { board::uart_events.error(board::uart_events.link); }

}  // extern "C"
