// The firmware echo on both UARTs, each with a mistake of its project: the first one's interrupt is off, the second
// one's handler has no line for pends. After two seconds of silence each link says what is wrong with it.
#include "board.hpp"
#include "echo.hpp"

namespace {

struct NoLight {
  void blink() {}
};

struct Line {
  using Echo = echo::Echo<NoLight, board::EmulatedUart>;

  Line(board::Usart& usart, board::Interrupt usart_interrupt, board::Interrupt events, board::Timer& pace,
       board::Interrupt pace_interrupt)
      : dma(usart, usart_interrupt, events, pace, pace_interrupt) {}

  board::SoftwareDma dma;
  board::EmulatedUart uart{dma};
  echo::Buffers buffers;
  NoLight light;
  Echo echo{light, uart, buffers};

  void say(const char* mistake) {
    board::print(mistake);
    board::print(": ");
    board::print(text_of(echo.link().why()));
    board::print("\n");
    board::print("unserved_pends", echo.link().counters().unserved_pends);
  }
};

Line first(board::usart1, board::Interrupt::usart1, board::Interrupt::dma2_stream7, board::timer3,
           board::Interrupt::timer3);
Line second(board::usart2, board::Interrupt::usart2, board::Interrupt::dma2_stream2, board::timer4,
            board::Interrupt::timer4);
wirebond::freertos::StaticTask<board::stack_words> task;

void poll(void*) {
  TickType_t woken = xTaskGetTickCount();
  for (int i = 0; i < 2000; ++i) {
    first.echo.poll(board::clock_us());
    second.echo.poll(board::clock_us());
    xTaskDelayUntil(&woken, 1);
  }
  first.say("interrupt off");
  second.say("no line for pends");
  board::end(0);
}

}  // namespace

extern "C" void usart1_interrupt() { first.dma.on_byte(); }
extern "C" void usart2_interrupt() { second.dma.on_byte(); }
extern "C" void timer3_interrupt() { first.dma.on_tick(); }
extern "C" void timer4_interrupt() { second.dma.on_tick(); }
extern "C" void dma2_stream7_interrupt() { board::forward_events(first.dma, first.echo.link()); }
extern "C" void dma2_stream2_interrupt() {
  const std::uint32_t events = second.dma.take_events();
  if ((events & board::Events::transmitted) != 0) second.echo.link().on_transmitted();
  if ((events & board::Events::received) != 0) second.echo.link().on_received();
}

int main() {
  board::enable_uart(board::Interrupt::dma2_stream2);  // and the other one is forgotten
  task.create(poll, "poll", nullptr, 3);
  board::run_tasks();
}
