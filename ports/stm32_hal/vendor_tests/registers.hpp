// Registers of USART3 and DMA1 in this machine's memory: the vendor's HAL writes them as those of an STM32F407, and
// they control the simulated UART of fake/. Interrupts are calls of the HAL's handlers.
#pragma once

#include <cstdint>

#include "stm32f4xx_hal.h"
#include "wirebond/fake/uart.hpp"

extern UART_HandleTypeDef huart3;

/// What a project's handler of the UART does before the HAL's. The test defines it.
void usart3_pended();

/// One at a time. The HAL keeps addresses in 32 bits: the program must be linked below 4 GiB, and the memory
/// that it sends and receives must be static.
class Board {
 public:
  /// 2 Mbaud 8N2, as CubeMX initialises it. Line errors are left to the HAL and the port, which are tested here.
  explicit Board(wirebond::fake::Uart& uart);
  ~Board();
  Board(const Board&) = delete;
  Board& operator=(const Board&) = delete;

  /// Let time pass. The hardware does what the HAL wrote before.
  void run(wirebond::fake::Time until) {
    obey();
    uart_.run(until, *this);
  }

  /// After a call of the HAL outside `run`: the hardware sees its registers.
  void obey();

  /// The stream of reception stops at a bus error.
  void fail_receive_dma();

  void pend() { uart_.pend(); }
  std::uint32_t baud_divider() const;

  // the hardware's interrupts
  void on_received();
  void on_transmitted();
  void on_error();
  void on_pended();

 private:
  void clear_flags();
  void show_errors();
  void serve_uart();
  void serve_receive_dma(std::uint32_t flags);

  wirebond::fake::Uart& uart_;
  std::size_t told_place_ = 0;      // of reception, when it last raised something
  std::uint32_t errors_ = 0;        // of the status
  std::uint64_t written_ = 0;       // bytes in memory when the UART's interrupt last ran
  std::uint32_t receive_left_ = 0;  // as this class last wrote it; another value: the HAL has started again
  std::uint32_t send_left_ = 0;
};
