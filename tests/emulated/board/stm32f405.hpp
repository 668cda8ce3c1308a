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

/// 0 is the most urgent, 15 the least.
inline void set_priority(Interrupt interrupt, std::uint8_t priority) {
  reinterpret_cast<volatile std::uint8_t*>(0xE000E400)[static_cast<std::uint32_t>(interrupt)] =
      static_cast<std::uint8_t>(priority << 4);
}

inline std::uint8_t priority(Interrupt interrupt) {
  return static_cast<std::uint8_t>(
      reinterpret_cast<volatile std::uint8_t*>(0xE000E400)[static_cast<std::uint32_t>(interrupt)] >> 4);
}

/// With a bit for each interrupt: is it enabled?
inline const Register* const enabled = reinterpret_cast<const Register*>(0xE000E100);

namespace detail {

/// Of registers with a bit for each interrupt, where writing 1 does something and 0 nothing.
inline void write_bit(std::uintptr_t registers, Interrupt interrupt) {
  const auto number = static_cast<std::uint32_t>(interrupt);
  reinterpret_cast<Register*>(registers)[number / 32] = 1U << (number % 32);
}

}  // namespace detail

inline void enable(Interrupt interrupt) { detail::write_bit(0xE000E100, interrupt); }
inline void disable(Interrupt interrupt) { detail::write_bit(0xE000E180, interrupt); }

/// Ask for `interrupt` to run. Any context.
inline void pend(Interrupt interrupt) { detail::write_bit(0xE000E200, interrupt); }
inline void forget(Interrupt interrupt) { detail::write_bit(0xE000E280, interrupt); }

}  // namespace nvic

// ---- time: programs see a processor of 170 MHz that makes one instruction in each cycle

constexpr std::uint32_t instructions_per_us = 170;

/// From here on `timer.count` has microseconds, and wraps as 32 bits do.
inline void start_clock(Timer& timer) {
  timer.prescaler = instructions_per_us - 1;
  timer.reload = 0xFFFFFFFF;
  timer.control1 = Timer::enable;
}

/// From here on the timer's interrupt comes every `period_us`; its handler clears `timer.status`.
inline void start_ticks(Timer& timer, std::uint32_t period_us) {
  timer.interrupts = Timer::update;
  timer.control1 = Timer::enable;
  timer.reload = period_us * instructions_per_us;  // in the emulated machine this is what starts a stopped timer again
}

}  // namespace board
