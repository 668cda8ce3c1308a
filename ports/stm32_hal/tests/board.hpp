// A board with one UART for the tests: the double of the HAL, and the interrupts that it serves.
#pragma once

#include <cstdint>

#include "stm32f4xx_hal.h"
#include "wirebond/fake/uart.hpp"

extern UART_HandleTypeDef huart3;

/// What CubeMX generates, with the line that the guide adds. The test defines it.
extern "C" void USART3_IRQHandler(void);

/// Gives `huart3` a simulated UART to stand for; its `run` lets time pass.
class Board {
 public:
  explicit Board(wirebond::fake::Uart& uart);
  ~Board();
  Board(const Board&) = delete;
  Board& operator=(const Board&) = delete;

  /// The port's setting in the UART's control register decides whether a line error ends reception.
  void run(wirebond::fake::Time until);

  // the actions of the vendor's interrupt handlers on the hardware's events
  void on_received();
  void on_transmitted();
  void on_error();
  void on_pended();

 private:
  void show_errors();

  wirebond::fake::Uart& uart_;
  std::uint64_t written_ = 0;  // bytes in memory when an interrupt last ran
};
