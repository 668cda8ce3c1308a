// The firmware balance on the emulated board, with its simulated body in somebody's hand.
#include "balance.hpp"

#include "board.hpp"
#include "body.hpp"

namespace {

balance::HeldBody body;
board::SoftwareDma dma(board::usart1, board::Interrupt::usart1, board::Interrupt::dma2_stream7, board::timer3,
                       board::Interrupt::timer3);
board::EmulatedUart uart(dma);
balance::Buffers buffers;
balance::Balance<balance::HeldBody, board::EmulatedUart> firmware(body, uart, buffers);
wirebond::freertos::StaticTask<board::stack_words> control_task;

void control(void*) {
  TickType_t woken = xTaskGetTickCount();
  for (;;) {
    xTaskDelayUntil(&woken, 1);
    body.step(1e-3F);
    firmware.poll(board::clock_us());
  }
}

}  // namespace

extern "C" void usart1_interrupt() { dma.on_byte(); }
extern "C" void timer3_interrupt() { dma.on_tick(); }
extern "C" void dma2_stream7_interrupt() { board::forward_events(dma, firmware.link()); }

int main() {
  board::enable_uart(board::Interrupt::dma2_stream7);
  control_task.create(control, "control", nullptr, 3);
  board::run_tasks();
}
