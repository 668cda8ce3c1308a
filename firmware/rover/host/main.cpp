// The rover as a process: its firmware, a simulated body, and a pty in place of the UART. Prints the pty's path, then a
// line for each event with its time in seconds. On stdin it takes: estop on, estop off, charge on, charge off.
#include <fcntl.h>
#include <poll.h>
#include <time.h>
#include <unistd.h>

#include <cerrno>
#include <cstdio>
#include <cstring>
#include <string>

#include "plant.hpp"
#include "rover.hpp"
#include "wirebond/posix/port.hpp"
#include "wirebond/posix/pty.hpp"

namespace {

constexpr int tick_ms = 1;

std::uint64_t monotonic_us() {
  timespec now{};
  ::clock_gettime(CLOCK_MONOTONIC, &now);
  return static_cast<std::uint64_t>(now.tv_sec) * 1'000'000U + static_cast<std::uint64_t>(now.tv_nsec) / 1000U;
}

class SimulatedBoard {
 public:
  SimulatedBoard(rover::Plant& plant, std::uint64_t start_us) : plant_(plant), start_us_(start_us) {}

  void set_wheel_speeds(float left_m_s, float right_m_s) {
    plant_.left.set_speed(static_cast<double>(left_m_s));
    plant_.right.set_speed(static_cast<double>(right_m_s));
  }
  std::int16_t take_left_ticks() { return plant_.left.take_ticks(); }
  std::int16_t take_right_ticks() { return plant_.right.take_ticks(); }
  float battery_v() const { return plant_.battery_v(); }
  bool estop_pressed() const { return plant_.estop_pressed; }
  bool charging() const { return plant_.charging; }
  void report(const char* event) const {
    std::printf("%.3f %s\n", static_cast<double>(monotonic_us() - start_us_) * 1e-6, event);
  }

 private:
  rover::Plant& plant_;
  std::uint64_t start_us_;
};

/// Lines of the operator. False when stdin has ended.
class Operator {
 public:
  bool read(rover::Plant& plant) {
    char chunk[256];
    const ssize_t got = ::read(STDIN_FILENO, chunk, sizeof chunk);
    if (got == 0) return false;
    if (got < 0) return errno == EAGAIN || errno == EINTR;
    line_.append(chunk, static_cast<std::size_t>(got));
    for (std::size_t end; (end = line_.find('\n')) != std::string::npos; line_.erase(0, end + 1)) {
      obey(line_.substr(0, end), plant);
    }
    if (line_.size() > 1000) line_.clear();
    return true;
  }

 private:
  static void obey(const std::string& line, rover::Plant& plant) {
    if (line == "estop on" || line == "estop off") {
      plant.estop_pressed = line == "estop on";
    } else if (line == "charge on" || line == "charge off") {
      plant.charging = line == "charge on";
    } else {
      std::fprintf(stderr, "unknown line '%.40s'; expected: estop on, estop off, charge on, charge off\n",
                   line.c_str());
    }
  }

  std::string line_;
};

}  // namespace

int main(int argument_count, char** arguments) {
  const bool ends_with_stdin = argument_count > 1 && std::strcmp(arguments[1], "--end-with-stdin") == 0;
  if (argument_count > 1 && !ends_with_stdin) {
    std::fprintf(stderr, "usage: %s [--end-with-stdin]\n", arguments[0]);
    return 2;
  }
  std::setvbuf(stdout, nullptr, _IOLBF, BUFSIZ);
  wirebond::posix::Pty pty;
  if (!wirebond::posix::open_pty(pty)) {
    std::fprintf(stderr, "cannot open a pty: %s\n", std::strerror(errno));
    return 3;
  }
  std::printf("%s\n", pty.path.c_str());
  ::fcntl(STDIN_FILENO, F_SETFL, ::fcntl(STDIN_FILENO, F_GETFL) | O_NONBLOCK);

  const std::uint64_t start_us = monotonic_us();
  rover::Plant plant;
  SimulatedBoard board(plant, start_us);
  rover::Buffers buffers{};
  wirebond::posix::Port uart(pty.controller.get());
  rover::Rover<SimulatedBoard, wirebond::posix::Port> rover(board, uart, buffers);
  if (!uart.start(rover.link())) {
    std::fprintf(stderr, "the system has no descriptor left: %s\n", std::strerror(errno));
    return 3;
  }
  Operator person;
  bool has_stdin = true;
  std::uint64_t before_us = start_us;
  for (;;) {
    pollfd watched = {has_stdin ? STDIN_FILENO : -1, POLLIN, 0};
    ::poll(&watched, 1, tick_ms);
    if (has_stdin && watched.revents != 0 && !person.read(plant)) {
      if (ends_with_stdin) return 0;
      has_stdin = false;
    }
    const std::uint64_t now_us = monotonic_us();
    for (; before_us + 1000 <= now_us; before_us += 1000) plant.step(1e-3, static_cast<double>(rover::track_m));
    rover.poll(static_cast<std::uint32_t>(now_us));
  }
}
