// The servo as a process: its number is the first argument. Events: the angle that it is commanded to, and its release.
#include <algorithm>
#include <cstdint>
#include <cstdio>
#include <cstdlib>
#include <string>

#include "host/process.hpp"
#include "servo.hpp"

namespace {

/// A motor that turns steadily to its target, and stays in place when it is released.
class SimulatedBoard {
 public:
  explicit SimulatedBoard(const host::Process& process) : process_(process) {}

  void turn(float angle_rad, float time_s) {
    target_rad_ = angle_rad;
    left_s_ = std::max(time_s, 0.001F);
    char event[40];
    std::snprintf(event, sizeof event, "turns to %.3f", static_cast<double>(angle_rad));
    process_.report(event);
  }
  void release() {
    left_s_ = 0.0F;
    process_.report("released");
  }
  float angle_rad() const { return angle_rad_; }
  bool moves() const { return left_s_ > 0.0F; }

  void step(float step_s) {
    if (!moves()) return;
    angle_rad_ += (target_rad_ - angle_rad_) * std::min(step_s / left_s_, 1.0F);
    left_s_ -= step_s;
  }

 private:
  const host::Process& process_;
  float angle_rad_ = 0.0F;
  float target_rad_ = 0.0F;
  float left_s_ = 0.0F;
};

/// Return the number in this text; 0 if it is not a number of a servo.
std::uint8_t address_of(const char* text) {
  char* end = nullptr;
  const long number = std::strtol(text, &end, 10);
  const bool is_one = end != text && *end == '\0' && number >= 1 && number <= 253;
  return is_one ? static_cast<std::uint8_t>(number) : std::uint8_t{0};
}

}  // namespace

int main(int argument_count, char** arguments) {
  const std::uint8_t address = argument_count > 1 ? address_of(arguments[1]) : std::uint8_t{0};
  if (address == 0) {
    std::fprintf(stderr, "usage: %s NUMBER [--end-with-stdin], with a number from 1 to 253\n", arguments[0]);
    return 2;
  }
  arguments[1] = arguments[0];
  host::Process process;
  if (const int failure = process.open(argument_count - 1, arguments + 1); failure != 0) return failure;
  SimulatedBoard board(process);
  servo::Buffers buffers{};
  wirebond::posix::Port uart(process.uart());
  servo::Servo<SimulatedBoard, wirebond::posix::Port> servo(board, uart, buffers, address);
  return process.run(
      uart, servo.link(), "nothing", [](const std::string&) { return false; },
      [&](std::uint32_t) { board.step(0.001F); }, [&](std::uint32_t now_us) { servo.poll(now_us); });
}
