// Registers of the STM32F405 that the emulated machine has and the tests use. No driver, no state.
#pragma once

#include <cstdint>

namespace board {

using Register = volatile std::uint32_t;

/// RM0090, chapter 30. In the emulated machine a byte leaves at once, and the other side waits until `data` is read.
struct Usart {
  Register status;
  Register data;
  Register baud;
  Register control1;

  static constexpr std::uint32_t transmit_empty = 1U << 7;
  static constexpr std::uint32_t received = 1U << 5;
  static constexpr std::uint32_t enable = 1U << 13;
  static constexpr std::uint32_t receive_interrupt = 1U << 5;
  static constexpr std::uint32_t transmitter = 1U << 3;
  static constexpr std::uint32_t receiver = 1U << 2;
};

/// RM0090, chapter 18. In the emulated machine its clock is 1 GHz: one tick an instruction with `-icount shift=0`.
struct Timer {
  Register control1;
  Register control2;
  Register slave_mode;
  Register interrupts;
  Register status;
  Register events;
  Register capture_mode1;
  Register capture_mode2;
  Register capture_enable;
  Register count;
  Register prescaler;
  Register reload;

  static constexpr std::uint32_t enable = 1U << 0;
  static constexpr std::uint32_t update = 1U << 0;  ///< in `interrupts`, `status` and `events`
};

/// Numbers of interrupts. Those of DMA2 stand for the DMA that the machine lacks; only software raises them.
enum class Interrupt : std::uint32_t {
  timer2 = 28,
  timer3 = 29,
  timer4 = 30,
  usart1 = 37,
  usart2 = 38,
  timer5 = 50,
  dma2_stream2 = 58,
  dma2_stream7 = 70,
};
constexpr std::uint32_t interrupt_count = 82;

inline Usart& usart1 = *reinterpret_cast<Usart*>(0x40011000);
inline Usart& usart2 = *reinterpret_cast<Usart*>(0x40004400);
inline Timer& timer2 = *reinterpret_cast<Timer*>(0x40000000);
inline Timer& timer3 = *reinterpret_cast<Timer*>(0x40000400);
inline Timer& timer4 = *reinterpret_cast<Timer*>(0x40000800);
inline Timer& timer5 = *reinterpret_cast<Timer*>(0x40000C00);

namespace nvic {

/// Let `interrupt` run from here on. `priority`: 0 is the most urgent, 15 the least.
inline void enable(Interrupt interrupt, std::uint8_t priority) {
  const auto number = static_cast<std::uint32_t>(interrupt);
  reinterpret_cast<volatile std::uint8_t*>(0xE000E400)[number] = static_cast<std::uint8_t>(priority << 4);
  reinterpret_cast<Register*>(0xE000E100)[number / 32] = 1U << (number % 32);
}

/// Ask for `interrupt` to run. Any context.
inline void pend(Interrupt interrupt) {
  const auto number = static_cast<std::uint32_t>(interrupt);
  reinterpret_cast<Register*>(0xE000E200)[number / 32] = 1U << (number % 32);
}

}  // namespace nvic

/// From here on `timer.count` has microseconds, and wraps as 32 bits do.
inline void start_clock(Timer& timer) {
  timer.prescaler = 1000 - 1;
  timer.reload = 0xFFFFFFFF;
  timer.control1 = Timer::enable;
}

/// From here on `interrupt` comes every `period_ns` and a little; its handler clears `timer.status`.
inline void start_ticks(Timer& timer, Interrupt interrupt, std::uint32_t period_ns, std::uint8_t priority) {
  nvic::enable(interrupt, priority);
  timer.reload = period_ns;
  timer.interrupts = Timer::update;
  timer.control1 = Timer::enable;
}

}  // namespace board
