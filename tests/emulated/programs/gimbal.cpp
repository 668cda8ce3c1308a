// The firmware gimbal on the emulated board: its four sending tasks at 1 kHz for FRAMES milliseconds, then a report.
#include "gimbal.hpp"

#include <array>
#include <atomic>

#include "board.hpp"

// FRAMES: that each sender offers, from the build.
namespace {

/// Heads that are where they are told to be.
class Heads {
 public:
  gimbal::Pose small_head() const { return {small_yaw_, small_pitch_}; }
  gimbal::Pose big_head() const { return {big_yaw_, big_pitch_}; }
  float bullet_speed_m_s() const { return 25.0F; }
  void aim(const gimbal::Pose& left, const gimbal::Pose&, const gimbal::Pose& main) {
    small_yaw_ = left.yaw_rad;
    small_pitch_ = left.pitch_rad;
    big_yaw_ = main.yaw_rad;
    big_pitch_ = main.pitch_rad;
    is_aimed = true;
  }
  void shoot(std::uint8_t, std::uint8_t) {}
  template <class Message>
  wirebond::Status send(const Message& message);

  std::atomic<bool> is_aimed{false};

 private:
  std::atomic<float> small_yaw_{0.0F}, small_pitch_{0.0F}, big_yaw_{0.0F}, big_pitch_{0.0F};
};

Heads heads;
gimbal::Gimbal<Heads> firmware(heads);
board::SoftwareDma dma(board::usart1, board::Interrupt::usart1, board::Interrupt::dma2_stream7, board::timer3,
                       board::Interrupt::timer3);
board::EmulatedUart uart(dma);
wirebond::Buffers<enterprize::AtMcu, 512, 1024> buffers;
enterprize::McuLink link{firmware, uart, buffers};
board::ReceiveTask link_task{link};
std::array<wirebond::freertos::StaticTask<board::stack_words>, gimbal::senders> sender_tasks;
wirebond::freertos::StaticTask<board::stack_words> report_task;
std::atomic<std::uint32_t> ended{0};

template <class Message>
wirebond::Status Heads::send(const Message& message) {
  return link.send(message);
}

void send_at_rhythm(void* argument) {
  while (!heads.is_aimed) vTaskDelay(1);  // what is sent before the host is there goes nowhere
  TickType_t woken = xTaskGetTickCount();
  for (std::uint32_t i = 0; i < FRAMES; ++i) {
    xTaskDelayUntil(&woken, pdMS_TO_TICKS(gimbal::period_us / 1000));
    static_cast<void>(firmware.report(reinterpret_cast<std::uintptr_t>(argument)));
  }
  ++ended;
  vTaskDelay(portMAX_DELAY);
}

void wait_and_report(void*) {
  while (ended != gimbal::senders || link.send_account().queued != 0) vTaskDelay(1);
  const wirebond::SendAccount sent = link.send_account();
  board::print("offered", sent.offered);
  board::print("accepted", sent.accepted);
  board::print("refused", sent.refused());
  board::print("sent", sent.sent);
  board::print("end\n");
  vTaskDelay(portMAX_DELAY);
}

}  // namespace

extern "C" void usart1_interrupt() { dma.on_byte(); }
extern "C" void timer3_interrupt() { dma.on_tick(); }
extern "C" void dma2_stream7_interrupt() { board::forward_events(dma, link, link_task); }

int main() {
  board::enable_uart(board::Interrupt::dma2_stream7);
  link_task.start("link", 6);
  for (std::uintptr_t i = 0; i < gimbal::senders; ++i) {
    sender_tasks[i].create(send_at_rhythm, "sender", reinterpret_cast<void*>(i), i + 1);
  }
  report_task.create(wait_and_report, "report", nullptr, 7);
  board::run_tasks();
}
