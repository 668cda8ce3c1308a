// The way of a byte through the emulated board, without a link: what the host commands comes back, as long as it asks.
// A task of FreeRTOS waits for the events of reception, decodes, encodes, and waits for the end of each transmission.
#include "board.hpp"
#include "enterprize.hpp"

namespace {

constexpr float last = -1.0F;  // in x_vel: the host has sent its last command

board::SoftwareDma dma(board::usart1, board::Interrupt::usart1, board::Interrupt::dma2_stream7, board::timer3,
                       board::Interrupt::timer3);
board::EmulatedUart uart(dma);
std::uint8_t ring[256];
board::Task echo_task;

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
extern "C" void timer3_interrupt() { dma.on_tick(); }

extern "C" void dma2_stream7_interrupt() {
  BaseType_t woken = pdFALSE;
  xTaskNotifyFromISR(echo_task.handle(), dma.take_events(), eSetBits, &woken);
  portYIELD_FROM_ISR(woken);
}

int main() {
  board::nvic::set_priority(board::Interrupt::dma2_stream7, board::uart_priority);
  board::nvic::enable(board::Interrupt::dma2_stream7);
  echo_task.start(run, "echo", 2);
  board::run_tasks();
}
