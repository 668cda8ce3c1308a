// The gimbal as a process: four threads send at 1 kHz, and the heads are always at their commanded pose. Events: it
// shoots, it holds fire.
#include <algorithm>
#include <array>
#include <atomic>
#include <chrono>
#include <string>
#include <thread>

#include "gimbal.hpp"
#include "heads.hpp"
#include "host/line_clock.hpp"
#include "host/process.hpp"

namespace {

class SimulatedBoard : public gimbal::Heads {
 public:
  explicit SimulatedBoard(const host::Process& process) : process_(process) {}

  float bullet_speed_m_s() const { return 25.0F; }
  void aim(const gimbal::Pose& left, const gimbal::Pose&, const gimbal::Pose& main) { Heads::aim(left, main); }
  void shoot(std::uint8_t left_mode, std::uint8_t right_mode) {
    const bool shoots = left_mode != 0 || right_mode != 0;
    if (shoots != shoots_) process_.report(shoots ? "shoots" : "holds fire");
    shoots_ = shoots;
  }

 private:
  const host::Process& process_;
  bool shoots_ = false;
};

using Gimbal = gimbal::Gimbal<SimulatedBoard, wirebond::posix::Port>;

/// A board's line takes a byte every 5.5 us, a pty only those that fit into its reader's buffer: senders wait here
/// while half of the queue is in use. One more frame of each sender fits into the other half.
///
/// Bytes, not frames that wait: a computer may suspend a sender inside `send` for many milliseconds. Frames of others
/// leave meanwhile, but their memory is in use until that sender goes on.
constexpr std::size_t most_bytes = sizeof(gimbal::Buffers::send) / 2;

void send_at_rhythm(Gimbal& firmware, std::size_t sender, const std::atomic<bool>& ends) {
  using Clock = std::chrono::steady_clock;
  constexpr std::chrono::microseconds period(gimbal::period_us);
  const auto waits = [&] {
    return firmware.link().state() == wirebond::LinkState::down || firmware.link().send_bytes_in_use() > most_bytes;
  };
  for (Clock::time_point next = Clock::now(); !ends; next = std::max(next + period, Clock::now())) {
    std::this_thread::sleep_until(next);
    while (waits() && !ends) std::this_thread::sleep_for(period);
    if (!ends) static_cast<void>(firmware.report(sender));
  }
}

}  // namespace

int main(int argument_count, char** arguments) {
  host::Process process;
  if (const int failure = process.open(argument_count, arguments); failure != 0) return failure;
  SimulatedBoard board(process);
  gimbal::Buffers buffers{};
  wirebond::posix::Port uart(process.uart());
  Gimbal gimbal(board, uart, buffers);
  std::atomic<bool> ends{false};
  std::array<std::thread, gimbal::senders> senders;
  for (std::size_t i = 0; i < senders.size(); ++i) {
    senders[i] = std::thread([&, i] { send_at_rhythm(gimbal, i, ends); });
  }
  host::LineClock clock(gimbal.link());
  const int code = process.run(
      uart, gimbal.link(), "nothing", [](const std::string&) { return false; },
      [&](std::uint32_t) {
        clock.advance();
        gimbal.poll(clock.now_us());
      },
      [](std::uint32_t) {});
  ends = true;
  for (std::thread& sender : senders) sender.join();
  return code;
}
