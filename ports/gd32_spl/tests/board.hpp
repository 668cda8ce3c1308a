// A board with one USART for the tests: the double of the vendor's library, and the interrupts that it serves.
#pragma once

#include "gd32f30x.h"
#include "wirebond/fake/uart.hpp"

// The handlers of the vector table. The test defines them.
extern "C" void USART0_IRQHandler();
extern "C" void DMA0_Channel3_IRQHandler();
extern "C" void DMA0_Channel4_IRQHandler();

/// Gives the library's functions a simulated UART to stand for; its `run` lets time pass. Addresses have 32 bits here
/// too: all buffers are static, and so lie near the double's registers.
class Board {
 public:
  explicit Board(wirebond::fake::Uart& uart);
  ~Board();
  Board(const Board&) = delete;
  Board& operator=(const Board&) = delete;

  /// The port's setting in the USART's control register decides whether a line error interrupts.
  void run(wirebond::fake::Time until);
  /// How often the data register was read while reception ran and the line was not idle.
  std::uint64_t taken_bytes() const;
  /// The channel does not stop on command.
  void hang(dma_channel_enum channel);

  // the interrupts that the hardware's events lead to
  void on_received();
  void on_transmitted();
  void on_error();
  void on_pended();

 private:
  void show_errors();
};
