// Vector table, start-up and faults of the emulated STM32F405. No clock set-up: the machine's ready bits never rise.
#include <cstdint>
#include <cstring>

#include "report.hpp"
#include "stm32f405.hpp"

extern "C" {

extern std::uint32_t stack_top[], data_in_flash[], data_begin[], data_end[], bss_begin[], bss_end[];
void __libc_init_array();
int main();

void reset();
void fault();
void unexpected();

// FreeRTOS has these three.
void SVC_Handler();
void PendSV_Handler();
void SysTick_Handler();

// A program defines those that it enables; the others end it.
#define WEAK_HANDLER __attribute__((weak, alias("unexpected")))
void timer2_interrupt() WEAK_HANDLER;
void timer3_interrupt() WEAK_HANDLER;
void timer4_interrupt() WEAK_HANDLER;
void timer5_interrupt() WEAK_HANDLER;
void usart1_interrupt() WEAK_HANDLER;
void usart2_interrupt() WEAK_HANDLER;
void dma2_stream2_interrupt() WEAK_HANDLER;
void dma2_stream7_interrupt() WEAK_HANDLER;

void _init() {}  // of newlib; there is nothing to do

}  // extern "C"

namespace {

using Handler = void (*)();

struct Vectors {
  std::uint32_t* stack = stack_top;
  Handler reset_handler = reset;
  Handler faults[5] = {fault, fault, fault, fault, fault};  // NMI, hard fault, memory, bus, usage
  Handler reserved1[4] = {};
  Handler supervisor_call = SVC_Handler;
  Handler debug_monitor = fault;
  Handler reserved2 = nullptr;
  Handler pend_supervisor = PendSV_Handler;
  Handler system_tick = SysTick_Handler;
  Handler interrupts[board::interrupt_count] = {};

  constexpr Vectors() {
    for (Handler& handler : interrupts) handler = unexpected;
    set(board::Interrupt::timer2, timer2_interrupt);
    set(board::Interrupt::timer3, timer3_interrupt);
    set(board::Interrupt::timer4, timer4_interrupt);
    set(board::Interrupt::timer5, timer5_interrupt);
    set(board::Interrupt::usart1, usart1_interrupt);
    set(board::Interrupt::usart2, usart2_interrupt);
    set(board::Interrupt::dma2_stream2, dma2_stream2_interrupt);
    set(board::Interrupt::dma2_stream7, dma2_stream7_interrupt);
  }

  constexpr void set(board::Interrupt interrupt, Handler handler) {
    interrupts[static_cast<std::uint32_t>(interrupt)] = handler;
  }
};

__attribute__((section(".vectors"), used)) constexpr Vectors vectors;

}  // namespace

extern "C" void reset() {
  *reinterpret_cast<board::Register*>(0xE000ED88) |= 0xFU << 20;  // CPACR: the FPU is on
  std::memcpy(data_begin, data_in_flash,
              reinterpret_cast<std::uintptr_t>(data_end) - reinterpret_cast<std::uintptr_t>(data_begin));
  std::memset(bss_begin, 0, reinterpret_cast<std::uintptr_t>(bss_end) - reinterpret_cast<std::uintptr_t>(bss_begin));
  __libc_init_array();
  main();
  board::fail("main has returned");
}

extern "C" void fault() { board::fail("a fault of the processor"); }

extern "C" void unexpected() { board::fail("an interrupt without a handler"); }
