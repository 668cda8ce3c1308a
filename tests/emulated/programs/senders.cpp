// Four tasks of different priorities and one interrupt send through one link, far more than the line takes; the host
// sends at the same time. Each sender counts its accepted messages in the messages, which have four sizes.
#include <array>
#include <atomic>

#include "board.hpp"
#include "enterprize_link.hpp"

// FRAMES: that each sender sends, from the build.
namespace {

constexpr std::size_t task_count = 4;
constexpr std::size_t sender_count = task_count + 1;  // the last one is the interrupt
constexpr std::uint8_t interrupt_sender = task_count;
constexpr std::uint32_t interrupt_period_us = 307;  // no multiple of the tick of the kernel or of the line
constexpr std::uint8_t above_the_kernel = 2;        // priority of the interrupt that sends: the kernel never masks it
constexpr float last_command = -1.0F;               // in x_vel: the host has all that it expects

/// Something that follows from sender and count, so that the host sees a mixture of two messages.
constexpr std::uint16_t pattern(std::uint32_t sender, std::uint32_t count, std::uint32_t place) {
  std::uint32_t x = count * 2654435761U + sender * 40503U + place * 977U;
  x ^= x >> 15;
  return static_cast<std::uint16_t>(x);
}

class Host {
 public:
  void on(const enterprize::ChassisCmd& command) {
    has_begun = true;
    if (command.x_vel == last_command) {
      has_ended = true;
    } else if (command.x_vel == static_cast<float>(commands) && command.y_vel == 2.0F * command.x_vel) {
      ++commands;
    } else {
      ++out_of_order;
    }
  }

  std::uint32_t commands = 0;
  std::uint32_t out_of_order = 0;
  std::atomic<bool> has_begun{false};  // what is sent before that goes nowhere
  std::atomic<bool> has_ended{false};
};

Host host;
board::SoftwareDma dma(board::usart1, board::Interrupt::usart1, board::Interrupt::dma2_stream7, board::timer3,
                       board::Interrupt::timer3);
board::EmulatedUart uart(dma);
wirebond::Buffers<enterprize::AtMcu, 512, 512> buffers;
enterprize::McuLink link{host, uart, buffers};
board::ReceiveTask link_task{link};
wirebond::freertos::StaticTask<board::stack_words> report_task;

struct Sender {
  std::atomic<std::uint32_t> accepted{0};
  std::uint32_t refused = 0;
};
std::array<Sender, sender_count> senders;
std::array<wirebond::freertos::StaticTask<board::stack_words>, task_count> sender_tasks;

/// The sender's next message. Refused messages are offered again as they are.
wirebond::Status send(std::uint8_t sender, std::uint32_t count) {
  switch ((count + sender) % 4) {
    case 0: {
      enterprize::FieldMsg message;
      message.game_state = sender;
      message.remain_time = static_cast<std::uint16_t>(count);
      message.bullet_remain = static_cast<std::uint16_t>(count >> 16);
      message.team = 0;
      for (std::uint32_t i = 0; i < 8; ++i) message.red_hp[i] = pattern(sender, count, i);
      for (std::uint32_t i = 0; i < 8; ++i) message.blue_hp[i] = pattern(sender, count, 8 + i);
      message.in_combat = message.bullet_supply_available = message.shooter_locked = count % 2 != 0;
      return link.send(message);
    }
    case 1: {
      enterprize::SentryGimbalMsg message;
      message.cur_cv_mode = sender;
      message.target_color = 0;
      message.bullet_speed = static_cast<float>(count);
      for (std::uint32_t i = 0; i < 4; ++i) message.small_q[i] = pattern(sender, count, i);
      for (std::uint32_t i = 0; i < 4; ++i) message.big_q[i] = pattern(sender, count, 4 + i);
      return link.send(message);
    }
    case 2: {
      enterprize::GimbalMsg message;
      message.cur_cv_mode = sender;
      message.target_color = 0;
      message.bullet_speed = static_cast<float>(count);
      for (std::uint32_t i = 0; i < 4; ++i) message.q[i] = pattern(sender, count, i);
      return link.send(message);
    }
    default:
      return link.send(enterprize::ChassisMsg{static_cast<float>(sender), static_cast<float>(count),
                                              static_cast<float>(pattern(sender, count, 0))});
  }
}

/// One attempt. False: the sender has nothing more to send.
bool attempt(std::uint8_t number) {
  Sender& sender = senders[number];
  const std::uint32_t count = sender.accepted;
  if (count == FRAMES) return false;
  if (send(number, count) == wirebond::Status::ok) {
    sender.accepted = count + 1;
  } else {
    ++sender.refused;
  }
  return true;
}

/// Tasks 1 to 3 send a burst and sleep; task 0, which all others interrupt, takes what is left of the processor.
void send_all(void* argument) {
  const auto number = static_cast<std::uint8_t>(reinterpret_cast<std::uintptr_t>(argument));
  for (;;) {
    for (std::uint8_t burst = 0; burst < 4; ++burst) {
      if (host.has_begun && !attempt(number)) vTaskDelay(portMAX_DELAY);
    }
    if (number != 0) vTaskDelay(number);
  }
}

void report() {
  const wirebond::SendAccount sent = link.send_account();
  std::uint32_t accepted = 0;
  std::uint32_t refused = 0;
  for (const Sender& sender : senders) {
    accepted += sender.accepted;
    refused += sender.refused;
  }
  board::print("accepted by the senders' count", accepted);
  board::print("refused by the senders' count", refused);
  board::print("offered", sent.offered);
  board::print("accepted", sent.accepted);
  board::print("refused", sent.refused());
  board::print("sent", sent.sent);
  board::print("queued", sent.queued);
  board::print("aborted", sent.aborted);
  board::print("commands", host.commands);
  board::print("commands out of order", host.out_of_order);
  board::print("bytes", link.receiver().bytes());
  board::print("bytes in frames", link.receiver().account().frame_bytes);
  board::print("bytes lapped", link.receive_account().lapped);
  board::print("bytes dropped", link.receive_account().dropped);
  board::print("laps unknown", link.receive_account().laps_unknown);
  board::print("nested polls", link.counters().nested_polls);
  board::print("end\n");
}

bool all_sent() {
  for (const Sender& sender : senders) {
    if (sender.accepted != FRAMES) return false;
  }
  return link.send_account().queued == 0;
}

void wait_and_report(void*) {
  while (!host.has_ended || !all_sent()) vTaskDelay(1);
  report();
  vTaskDelay(portMAX_DELAY);
}

}  // namespace

extern "C" void usart1_interrupt() { dma.on_byte(); }
extern "C" void timer3_interrupt() { dma.on_tick(); }
extern "C" void timer4_interrupt() {
  board::timer4.status = 0;
  if (host.has_begun) attempt(interrupt_sender);
}

extern "C" void dma2_stream7_interrupt() { board::forward_events(dma, link, link_task); }

int main() {
  board::enable_uart(board::Interrupt::dma2_stream7);
  link_task.start("link", 6);
  report_task.create(wait_and_report, "report", nullptr, 7);
  for (std::uintptr_t i = 0; i < task_count; ++i) {
    sender_tasks[i].create(send_all, "sender", reinterpret_cast<void*>(i), i + 1);
  }
  board::nvic::set_priority(board::Interrupt::timer4, above_the_kernel);
  board::nvic::enable(board::Interrupt::timer4);
  board::start_ticks(board::timer4, interrupt_period_us);
  board::run_tasks();
}
