// The rover as a process: its firmware and a simulated body. On stdin it takes: estop on, estop off, charge on, charge
// off, pose (reports the body's pose: x, y, heading). With --lockstep it runs under virtual time: see
// wirebond/posix/lockstep.hpp.
#include <cstdio>
#include <cstring>
#include <string>

#include "host/process.hpp"
#include "plant.hpp"
#include "rover.hpp"
#include "wirebond/posix/lockstep.hpp"

namespace {

/// `Reporter` has `report(const char*)`.
template <class Reporter>
class SimulatedBoard {
 public:
  SimulatedBoard(rover::Plant& plant, Reporter& reporter) : plant_(plant), reporter_(reporter) {}

  void set_wheel_speeds(float left_m_s, float right_m_s) {
    plant_.left.set_speed(static_cast<double>(left_m_s));
    plant_.right.set_speed(static_cast<double>(right_m_s));
  }
  std::int16_t take_left_ticks() { return plant_.left.take_ticks(); }
  std::int16_t take_right_ticks() { return plant_.right.take_ticks(); }
  float battery_v() const { return plant_.battery_v(); }
  bool estop_pressed() const { return plant_.estop_pressed; }
  bool charging() const { return plant_.charging; }
  void report(const char* event) { reporter_.report(event); }

 private:
  rover::Plant& plant_;
  Reporter& reporter_;
};

template <class Reporter>
bool obey(const std::string& line, rover::Plant& plant, Reporter& reporter) {
  if (line == "estop on" || line == "estop off") {
    plant.estop_pressed = line == "estop on";
  } else if (line == "charge on" || line == "charge off") {
    plant.charging = line == "charge on";
  } else if (line == "pose") {
    char text[100];
    std::snprintf(text, sizeof text, "pose %.6f %.6f %.6f", plant.x_m(), plant.y_m(), plant.heading_rad());
    reporter.report(text);
  } else {
    return false;
  }
  return true;
}

void step(rover::Plant& plant) { plant.step(1e-3, static_cast<double>(rover::track_m)); }

/// Run until stdin ends.
int run_in_lockstep() {
  using Port = wirebond::posix::Lockstep;
  Port uart(STDIN_FILENO, STDOUT_FILENO, diffdrive::baud, 10);  // 8N1
  rover::Plant plant;
  SimulatedBoard<Port> board(plant, uart);
  rover::Buffers buffers{};
  rover::Rover<SimulatedBoard<Port>, Port> rover(board, uart, buffers);
  for (;;) {
    rover.poll(uart.now_us());
    const bool goes_on =
        uart.wait(uart.time_us() + 1000, rover.link(), [&](const std::string& line) { obey(line, plant, uart); });
    if (!goes_on) return 0;
    step(plant);
  }
}

}  // namespace

int main(int argument_count, char** arguments) {
  if (argument_count == 2 && std::strcmp(arguments[1], "--lockstep") == 0) return run_in_lockstep();
  host::Process process;
  if (const int failure = process.open(argument_count, arguments); failure != 0) return failure;
  rover::Plant plant;
  SimulatedBoard<host::Process> board(plant, process);
  rover::Buffers buffers{};
  wirebond::posix::Port uart(process.uart());
  rover::Rover<SimulatedBoard<host::Process>, wirebond::posix::Port> rover(board, uart, buffers);
  return process.run(
      uart, rover.link(), "estop on, estop off, charge on, charge off, pose",
      [&](const std::string& line) { return obey(line, plant, process); }, [&](std::uint32_t) { step(plant); },
      [&](std::uint32_t now_us) { rover.poll(now_us); });
}
