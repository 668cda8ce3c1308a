// The firmware gimbal on the emulated board: its four sending tasks at 1 kHz for FRAMES milliseconds, then a report.
#include "gimbal.hpp"

#include <array>
#include <atomic>

#include "board.hpp"
#include "heads.hpp"

// FRAMES: that each sender offers, from the build.
namespace {

class AimedHeads : public gimbal::Heads {
 public:
  float bullet_speed_m_s() const { return 25.0F; }
  void aim(const gimbal::Pose& left, const gimbal::Pose&, const gimbal::Pose& main) {
    Heads::aim(left, main);
    is_aimed = true;
  }
  void shoot(std::uint8_t, std::uint8_t) {}

  std::atomic<bool> is_aimed{false};
};

using Gimbal = gimbal::Gimbal<AimedHeads, board::EmulatedUart>;

AimedHeads heads;
board::SoftwareDma dma(board::usart1, board::Interrupt::usart1, board::Interrupt::dma2_stream7, board::timer3,
                       board::Interrupt::timer3);
board::EmulatedUart uart(dma);
gimbal::Buffers buffers;
Gimbal firmware(heads, uart, buffers);
Gimbal::Link& link = firmware.link();
board::ReceiveTask<Gimbal::Link> link_task{link};
std::array<wirebond::freertos::StaticTask<board::stack_words>, gimbal::senders> sender_tasks;
wirebond::freertos::StaticTask<board::stack_words> report_task;
std::atomic<std::uint32_t> ended{0};

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
