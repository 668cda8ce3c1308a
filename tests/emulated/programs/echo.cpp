// The firmware echo on both UARTs of the emulated board: two links, one task for each.
#include "echo.hpp"

#include "board.hpp"

namespace {

struct NoLight {
  void blink() {}
};

struct Line {
  using Echo = echo::Echo<NoLight, board::EmulatedUart>;

  Line(board::Usart& usart, board::Interrupt usart_interrupt, board::Interrupt events, board::Timer& pace,
       board::Interrupt pace_interrupt)
      : dma(usart, usart_interrupt, events, pace, pace_interrupt) {
    board::enable_uart(events);
  }

  board::SoftwareDma dma;
  board::EmulatedUart uart{dma};
  echo::Buffers buffers;
  NoLight light;
  Echo echo{light, uart, buffers};
  board::ReceiveTask<Echo::Link> task{echo.link()};
};

Line first(board::usart1, board::Interrupt::usart1, board::Interrupt::dma2_stream7, board::timer3,
           board::Interrupt::timer3);
Line second(board::usart2, board::Interrupt::usart2, board::Interrupt::dma2_stream2, board::timer4,
            board::Interrupt::timer4);

}  // namespace

extern "C" void usart1_interrupt() { first.dma.on_byte(); }
extern "C" void timer3_interrupt() { first.dma.on_tick(); }
extern "C" void timer4_interrupt() { second.dma.on_tick(); }
extern "C" void usart2_interrupt() { second.dma.on_byte(); }
extern "C" void dma2_stream7_interrupt() { board::forward_events(first.dma, first.echo.link(), first.task); }
extern "C" void dma2_stream2_interrupt() { board::forward_events(second.dma, second.echo.link(), second.task); }

int main() {
  first.task.start("first", 2);
  second.task.start("second", 3);
  board::run_tasks();
}
