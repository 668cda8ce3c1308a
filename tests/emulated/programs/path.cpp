// The way of a byte through the emulated board, without a link: what the host commands comes back, as long as it asks.
// A task of FreeRTOS waits for the events of reception, decodes, encodes, and waits for the end of each transmission.
#include "FreeRTOS.h"
#include "emulated_uart.hpp"
#include "enterprize.hpp"
#include "report.hpp"
#include "task.h"

namespace {

constexpr std::uint32_t tick_ns = 5000;
constexpr std::size_t bytes_a_tick = 8;
constexpr float last = -1.0F;  // in x_vel: the host has sent its last command

board::SoftwareDma dma(board::usart1, board::Interrupt::usart1, board::Interrupt::dma2_stream7, bytes_a_tick);
board::EmulatedUart uart(dma);
std::uint8_t ring[256];
TaskHandle_t echo_task;

class Echo {
 public:
  void on(const enterprize::ChassisCmd& command) {
    std::size_t size = 0;
    if (encode(enterprize::ChassisMsg{command.x_vel, command.y_vel, command.w_vel}, frame_, sizeof frame_, size) !=
        wirebond::Status::ok) {
      board::fail("a command does not fit into its answer");
    }
    if (!uart.start_transmit(frame_, size)) board::fail("the UART is busy");
    while ((events_ & board::Events::transmitted) == 0) wait();
    events_ &= ~board::Events::transmitted;
    ++echoed;
    ended = command.x_vel == last;
  }

  void wait() {
    std::uint32_t found = 0;
    xTaskNotifyWait(0, ~0U, &found, portMAX_DELAY);
    events_ |= found;
  }

  std::uint32_t echoed = 0;
  bool ended = false;

 private:
  std::uint32_t events_ = 0;
  std::uint8_t frame_[enterprize::ChassisMsg::Info::max_frame_bytes];
};

void run(void*) {
  static Echo echo;
  static enterprize::Receiver<enterprize::FromHost> receiver;
  std::size_t read = 0;
  uart.start_receive(ring, sizeof ring);
  board::print("ready\n");
  while (!echo.ended) {
    echo.wait();
    while (read != uart.receive_position()) {
      const std::size_t written = uart.receive_position();
      const std::size_t end = written > read ? written : sizeof ring;
      receiver.feed(ring + read, end - read, board::timer2.count, echo);
      read = end % sizeof ring;
    }
  }
  board::print("bytes", receiver.bytes());
  board::print("in frames", receiver.account().frame_bytes);
  board::print("echoed", echo.echoed);
  board::print("words of stack left", uxTaskGetStackHighWaterMark(nullptr));
  board::print("end\n");
  for (;;) vTaskDelay(portMAX_DELAY);
}

}  // namespace

extern "C" void usart1_interrupt() { dma.on_byte(); }

extern "C" void timer3_interrupt() {
  board::timer3.status = 0;
  dma.on_tick();
}

extern "C" void dma2_stream7_interrupt() {
  BaseType_t woken = pdFALSE;
  xTaskNotifyFromISR(echo_task, dma.take_events(), eSetBits, &woken);
  portYIELD_FROM_ISR(woken);
}

int main() {
  static StaticTask_t task;
  static StackType_t stack[512];
  board::start_clock(board::timer2);
  board::nvic::enable(board::Interrupt::dma2_stream7, 6);
  echo_task = xTaskCreateStatic(run, "echo", 512, nullptr, 2, stack, &task);
  board::start_ticks(board::timer3, board::Interrupt::timer3, tick_ns, board::SoftwareDma::hardware_priority);
  vTaskStartScheduler();
}
