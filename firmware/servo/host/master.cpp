// A host in C++ for a bus of servos: turns each of them and waits until it has arrived.
//
//   master TTY NUMBER=ANGLE...     angles in radians
//
// Prints a line for each servo that has arrived. Exit code 1: one of them does not answer, or does not reach its angle.
#include <chrono>
#include <cmath>
#include <cstdint>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <thread>
#include <vector>

#include "servo_bus_link.hpp"
#include "wirebond/posix/port.hpp"
#include "wirebond/posix/serial.hpp"
#include "wirebond/posix/stream.hpp"

namespace {

namespace posix = wirebond::posix;

struct Target {
  std::uint8_t servo;
  float angle_rad;
};

/// Keeps the newest pose, and the number of its servo.
struct Master {
  void on(const servo_bus::Pose& pose, const servo_bus::Header& header) {
    angle_rad = pose.angle;
    servo = header.servo;
    moves = (header.state & servo_bus::Header::State::moving) != 0;
    has_pose = true;
  }

  float angle_rad = 0.0F;
  std::uint8_t servo = 0;
  bool moves = false;
  bool has_pose = false;
};

using Buffers = servo_bus::HostBuffers<4096, 1024>;
using Link = servo_bus::HostLink<Master, posix::Port, Buffers>;

constexpr auto tick = std::chrono::milliseconds(1);
constexpr int answer_ms = 500, turn_ms = 10'000;
constexpr float near_rad = 0.002F;
constexpr float turn_s = 0.3F;

/// Ask a servo for its pose. Returns false if it did not answer in time; another servo's answer does not count.
bool ask(Link& link, Master& master, std::uint8_t servo) {
  servo_bus::Header header = link.header();
  header.servo = servo;
  master.has_pose = false;
  if (link.send(servo_bus::Read{}, header) != wirebond::Status::ok) return false;
  for (int waited = 0; waited < answer_ms; ++waited) {
    link.poll(posix::now_us());
    if (master.has_pose && master.servo == servo) return true;
    std::this_thread::sleep_for(tick);
  }
  return false;
}

bool turn(Link& link, Master& master, const Target& target) {
  servo_bus::Header header = link.header();
  header.servo = target.servo;
  if (link.send(servo_bus::Move{target.angle_rad, turn_s}, header) != wirebond::Status::ok) return false;
  for (int waited = 0; waited < turn_ms; ++waited) {
    if (!ask(link, master, target.servo)) return false;
    if (!master.moves && std::fabs(master.angle_rad - target.angle_rad) < near_rad) return true;
    std::this_thread::sleep_for(tick);
  }
  return false;
}

}  // namespace

int main(int argument_count, char** arguments) {
  std::vector<Target> targets;
  for (int i = 2; i < argument_count; ++i) {
    char* end = nullptr;
    const long servo = std::strtol(arguments[i], &end, 10);
    if (*end != '=' || servo < 1 || servo > 253) break;
    targets.push_back({static_cast<std::uint8_t>(servo), std::strtof(end + 1, nullptr)});
  }
  if (targets.empty()) return std::fprintf(stderr, "usage: %s TTY NUMBER=ANGLE...\n", arguments[0]), 2;

  posix::SerialError error;
  const posix::Descriptor tty = posix::open_serial(arguments[1], {servo_bus::baud}, error);
  if (!tty.is_open()) return std::fprintf(stderr, "cannot open the tty: %s\n", std::strerror(error.code)), 1;
  Master master;
  Buffers buffers{};
  posix::Port port(tty.get());
  Link link(master, port, buffers);
  if (!port.start(link)) return std::fprintf(stderr, "the system has no descriptor left\n"), 1;
  while (link.state() == wirebond::LinkState::down) link.poll(posix::now_us());

  int failures = 0;
  for (const Target& target : targets) {
    if (turn(link, master, target)) {
      std::printf("servo %u is at %.3f rad\n", unsigned{target.servo}, static_cast<double>(master.angle_rad));
    } else {
      std::printf("servo %u does not answer, or does not turn\n", unsigned{target.servo});
      ++failures;
    }
  }
  port.stop();  // its thread uses the link, which is destroyed first
  return failures == 0 ? 0 : 1;
}
