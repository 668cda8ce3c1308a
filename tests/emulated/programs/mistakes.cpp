// A board whose project has a mistake, one after the other: USART1 has a link in C++, USART2 one in C. Frames come all
// the time, and each is answered. After some seconds each link says what is wrong: first as its port's answer about the
// settings has it, then as what happened has it, for a port that knows no setting.
#include "mistakes.h"

#include <optional>

#include "board.hpp"
#include "echo.hpp"
#include "wirebond/mcu/dma_uart.h"
#include "wirebond/mcu/why.hpp"

namespace {

using board::Interrupt;
using wirebond::Why;

constexpr std::uint32_t uart_clock_hz = 84'000'000;
constexpr Interrupt hal_tick = Interrupt::timer2;  // a timer stands for SysTick beside an RTOS; its priority counts

enum class Mistake {
  none,
  interrupt_off,
  no_line_for_pends,
  normal_mode,
  no_receive_dma,
  no_transmit_dma,
  wrong_baud,
  tick_below_uart,
  uart_not_set_up,
};
constexpr const char* names[] = {
    "none",
    "interrupt off",
    "no line for pends",
    "DMA in normal mode",
    "no receive DMA",
    "no transmit DMA",
    "wrong baud rate",
    "tick below the UART",
    "UART not initialised",
};
Mistake mistake = Mistake::none;

/// What the machine's registers and the software DMA say of the settings.
class KnowingUart : public board::EmulatedUart {
 public:
  KnowingUart(board::Usart& usart, board::SoftwareDma& dma, Interrupt events)
      : EmulatedUart(dma), usart_(usart), dma_(dma), events_(events) {}

  Why check(std::uint32_t baud) const {
    if (!answers) return Why::nothing;
    if ((usart_.control1 & board::Usart::enable) == 0) return Why::uart_not_set_up;
    if (!dma_.settings.has_receive) return Why::no_receive_dma;
    if (!dma_.settings.has_transmit) return Why::no_transmit_dma;
    if (!dma_.settings.is_circular) return Why::receive_dma_not_circular;
    if (uart_clock_hz / usart_.baud != baud) return Why::baud_differs;
    const auto number = static_cast<std::uint32_t>(events_);
    if (!wirebond_interrupt_enabled(board::nvic::enabled, number)) return Why::interrupt_off;
    const bool tick_waits = board::nvic::priority(hal_tick) >= board::nvic::priority(events_);
    return tick_waits ? Why::tick_below_uart : Why::nothing;
  }

  bool answers = true;

 private:
  board::Usart& usart_;
  board::SoftwareDma& dma_;
  Interrupt events_;
};

/// One UART of the board, set up as the project with its mistake does it.
struct Line {
  Line(board::Usart& registers, Interrupt usart_interrupt, Interrupt events, board::Timer& pace,
       Interrupt pace_interrupt)
      : usart(registers), dma(registers, usart_interrupt, events, pace, pace_interrupt), uart(registers, dma, events) {
    dma.settings.has_receive = mistake != Mistake::no_receive_dma;
    dma.settings.has_transmit = mistake != Mistake::no_transmit_dma;
    dma.settings.is_circular = mistake != Mistake::normal_mode;
    usart.baud = uart_clock_hz / (mistake == Mistake::wrong_baud ? enterprize::baud / 2 : enterprize::baud);
    if (mistake == Mistake::uart_not_set_up) usart.control1 = 0;
    board::nvic::set_priority(events, board::uart_priority);
    mistake == Mistake::interrupt_off ? board::nvic::disable(events) : board::nvic::enable(events);
  }

  /// What the UART makes of a byte that the other end sends at the right rate: it samples each of its own bits in the
  /// middle, counted from the start bit's edge. Behind the byte the line is silent.
  void hear(std::uint8_t byte) {
    if ((usart.control1 & board::Usart::enable) == 0) return;
    const std::uint32_t own_baud = uart_clock_hz / usart.baud;
    const std::uint32_t levels = 0xFFFF'FE00U | std::uint32_t{byte} << 1;
    std::uint32_t heard = 0;
    for (std::uint32_t bit = 0; bit < 8; ++bit) {
      const std::uint32_t at = (2 * bit + 3) * (enterprize::baud / 1000) / (2 * (own_baud / 1000));
      heard |= (levels >> at & 1U) << bit;  // of the slowest rate here `at` is 17
    }
    dma.hear(static_cast<std::uint8_t>(heard));
  }

  board::Usart& usart;
  board::SoftwareDma dma;
  KnowingUart uart;
};

struct NoLight {
  void blink() {}
};

struct InCpp {
  Line line{board::usart1, Interrupt::usart1, Interrupt::dma2_stream7, board::timer3, Interrupt::timer3};
  echo::Buffers buffers;
  NoLight light;
  echo::Echo<NoLight, KnowingUart> echo{light, line.uart, buffers};

  void poll(std::uint32_t now_us) { echo.poll(now_us); }
  const char* why() { return text_of(echo.link().why()); }
  void on_received() { echo.link().on_received(); }
  void on_transmitted() { echo.link().on_transmitted(); }
  void on_pended() { echo.link().on_pended(); }
};

/// The table that a firmware in C has, for a port that is C++ here.
constexpr wirebond_port_t table_of(Line& line) {
  wirebond_port_t table{};
  table.context = &line;
  table.start_receive = [](void* context, std::uint8_t* ring, std::size_t size) {
    return static_cast<Line*>(context)->uart.start_receive(ring, size);
  };
  table.receiving = [](void* context) { return static_cast<Line*>(context)->uart.receiving(); };
  table.receive_position = [](void* context) { return static_cast<Line*>(context)->uart.receive_position(); };
  table.start_transmit = [](void* context, const std::uint8_t* bytes, std::size_t size) {
    return static_cast<Line*>(context)->uart.start_transmit(bytes, size);
  };
  table.stop_transmit = [](void* context) { static_cast<Line*>(context)->uart.stop_transmit(); };
  table.pend = [](void* context) { static_cast<Line*>(context)->uart.pend(); };
  table.reaches = [](void* context, const void* bytes, std::size_t size) {
    return static_cast<Line*>(context)->uart.reaches(bytes, size);
  };
  table.tells_every_lap = true;
  table.check = [](void* context, std::uint32_t baud) {
    return static_cast<wirebond_why_t>(static_cast<Line*>(context)->uart.check(baud));
  };
  return table;
}

struct InC {
  Line line{board::usart2, Interrupt::usart2, Interrupt::dma2_stream2, board::timer4, Interrupt::timer4};
  const wirebond_port_t port = table_of(line);

  InC() {
    if (!c_link_open(&port)) board::fail("no link in C is left");
  }
  void poll(std::uint32_t now_us) { c_link_poll(now_us); }
  const char* why() { return c_link_why(); }
  void on_received() { c_link_on_received(); }
  void on_transmitted() { c_link_on_transmitted(); }
  void on_pended() { c_link_on_pended(); }
};

std::optional<InCpp> in_cpp;
std::optional<InC> in_c;
wirebond::freertos::StaticTask<board::stack_words> task;

constexpr Interrupt of_both[] = {
    Interrupt::timer5, Interrupt::timer3,       Interrupt::timer4,       Interrupt::usart1,
    Interrupt::usart2, Interrupt::dma2_stream7, Interrupt::dma2_stream2,
};

void begin(Mistake next) {
  for (const Interrupt interrupt : of_both) {
    board::nvic::disable(interrupt);
    board::nvic::forget(interrupt);
  }
  mistake = next;
  board::nvic::set_priority(hal_tick, mistake == Mistake::tick_below_uart ? 15 : 0);
  in_cpp.emplace();
  in_c.emplace();
  board::nvic::set_priority(Interrupt::timer5, board::SoftwareDma::hardware_priority);
  board::nvic::enable(Interrupt::timer5);
}

template <class End>
void say(const char* language, End& end) {
  board::print(names[static_cast<int>(mistake)]);
  board::print(language);
  board::print(end.why());
  board::print(" | ");
  end.line.uart.answers = false;
  board::print(end.why());
  board::print("\n");
}

void try_all(void*) {
  board::start_ticks(board::timer5, 10'000);
  TickType_t woken = xTaskGetTickCount();
  for (int number = 0; number <= static_cast<int>(Mistake::uart_not_set_up); ++number) {
    begin(static_cast<Mistake>(number));
    for (int i = 0; i < 1'300; ++i) {
      in_cpp->poll(board::clock_us());
      in_c->poll(board::clock_us());
      xTaskDelayUntil(&woken, 1);
    }
    say(" | C++ | ", *in_cpp);
    say(" | C | ", *in_c);
  }
  board::end(0);
}

template <class End>
void serve(End& end) {
  const std::uint32_t events = end.line.dma.take_events();
  if ((events & board::Events::transmitted) != 0) end.on_transmitted();
  if ((events & board::Events::pended) != 0 && mistake != Mistake::no_line_for_pends) end.on_pended();
  if ((events & board::Events::received) != 0) end.on_received();
}

}  // namespace

/// The other end of both lines.
extern "C" void timer5_interrupt() {
  board::timer5.status = 0;
  static float count = 0;
  std::uint8_t frame[enterprize::ChassisCmd::Info::max_frame_bytes];
  std::size_t size = 0;
  const enterprize::ChassisCmd command{count += 1, 0, 0};
  if (enterprize::encode(command, frame, sizeof frame, size) != wirebond::Status::ok) board::fail("no frame");
  for (std::size_t i = 0; i < size; ++i) {
    in_cpp->line.hear(frame[i]);
    in_c->line.hear(frame[i]);
  }
}
extern "C" void usart1_interrupt() { in_cpp->line.dma.on_byte(); }
extern "C" void usart2_interrupt() { in_c->line.dma.on_byte(); }
extern "C" void timer3_interrupt() { in_cpp->line.dma.on_tick(); }
extern "C" void timer4_interrupt() { in_c->line.dma.on_tick(); }
extern "C" void dma2_stream7_interrupt() { serve(*in_cpp); }
extern "C" void dma2_stream2_interrupt() { serve(*in_c); }

int main() {
  task.create(try_all, "mistakes", nullptr, 3);
  board::run_tasks();
}
