// The firmware balance on the emulated board, with its simulated body, which a hand holds while the motors rest.
#include "balance.hpp"

#include "board.hpp"
#include "body.hpp"
#include "pid_tuner_link.hpp"

namespace {

class Bot {
 public:
  float pitch_rad() const { return body_.pitch_rad(); }
  float pitch_rate_rad_s() const { return body_.pitch_rate_rad_s(); }
  float speed_m_s() const { return body_.speed_m_s(); }
  void set_motors(float left, float right) {
    if (left == 0.0F && right == 0.0F) body_.put_up();
    body_.set_motors(left, right);
  }
  template <class Message>
  wirebond::Status send(const Message& message);

  void pass_time() {
    for (std::uint32_t ms = 0; ms < balance::step_us / 1000; ++ms) body_.step(1e-3F);
  }

 private:
  balance::Body body_;
};

Bot bot;
balance::Balance<Bot> firmware(bot);
board::SoftwareDma dma(board::usart1, board::Interrupt::usart1, board::Interrupt::dma2_stream7, board::timer3,
                       board::Interrupt::timer3);
board::EmulatedUart uart(dma);
wirebond::Buffers<pid_tuner::AtMcu, 512, 256> buffers;
pid_tuner::McuLink link{firmware, uart, buffers};
wirebond::freertos::StaticTask<board::stack_words> control_task;

template <class Message>
wirebond::Status Bot::send(const Message& message) {
  return link.send(message);
}

void control(void*) {
  TickType_t woken = xTaskGetTickCount();
  for (;;) {
    xTaskDelayUntil(&woken, pdMS_TO_TICKS(balance::step_us / 1000));
    bot.pass_time();
    firmware.step();
    link.poll(board::clock_us());
  }
}

}  // namespace

extern "C" void usart1_interrupt() { dma.on_byte(); }
extern "C" void timer3_interrupt() { dma.on_tick(); }
extern "C" void dma2_stream7_interrupt() { board::forward_events(dma, link); }

int main() {
  board::enable_uart(board::Interrupt::dma2_stream7);
  control_task.create(control, "control", nullptr, 3);
  board::run_tasks();
}
