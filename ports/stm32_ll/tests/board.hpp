// A board with one UART for the tests: registers in memory, the simulated UART that they control, and the interrupts.
#pragma once

#include <cstdint>

#include "stm32f4xx.h"
#include "wirebond/fake/uart.hpp"

/// Sets the registers up as a project does; its `run` lets time pass, and the hardware obey. Addresses have 32 bits
/// here too: all buffers are static, and so lie near the registers.
class Board {
 public:
  explicit Board(wirebond::fake::Uart& uart);
  ~Board();
  Board(const Board&) = delete;
  Board& operator=(const Board&) = delete;

  void run(wirebond::fake::Time until);
  /// The stream of reception stops at a bus error.
  void fail_receive_dma();
  /// The UART runs out of bytes, because DMA is late.
  void starve_transmitter();
  /// Reads of the data register while the line was not idle.
  int taken_bytes() const { return taken_bytes_; }
  /// Idle events that the port ended, by a read of the data register.
  int idles_ended() const { return idles_ended_; }

  // the hardware's interrupts
  void on_received();
  void on_transmitted();
  void on_error();
  void on_pended();

 private:
  void obey();
  void show_progress();
  void serve_uart();

  wirebond::fake::Uart& uart_;
  std::uint32_t size_ = 0;          // of the ring
  std::uint32_t receive_left_ = 0;  // as the hardware last wrote it; another value: reception was started again
  std::uint64_t written_ = 0;       // bytes in memory when an interrupt last ran
  int taken_bytes_ = 0;
  int idles_ended_ = 0;
};
