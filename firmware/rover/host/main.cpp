// The rover as a process: its firmware and a simulated body. On stdin it takes: estop on, estop off, charge on, charge
// off.
#include <string>

#include "host/process.hpp"
#include "plant.hpp"
#include "rover.hpp"

namespace {

class SimulatedBoard {
 public:
  SimulatedBoard(rover::Plant& plant, const host::Process& process) : plant_(plant), process_(process) {}

  void set_wheel_speeds(float left_m_s, float right_m_s) {
    plant_.left.set_speed(static_cast<double>(left_m_s));
    plant_.right.set_speed(static_cast<double>(right_m_s));
  }
  std::int16_t take_left_ticks() { return plant_.left.take_ticks(); }
  std::int16_t take_right_ticks() { return plant_.right.take_ticks(); }
  float battery_v() const { return plant_.battery_v(); }
  bool estop_pressed() const { return plant_.estop_pressed; }
  bool charging() const { return plant_.charging; }
  void report(const char* event) const { process_.report(event); }

 private:
  rover::Plant& plant_;
  const host::Process& process_;
};

bool obey(const std::string& line, rover::Plant& plant) {
  if (line == "estop on" || line == "estop off") {
    plant.estop_pressed = line == "estop on";
  } else if (line == "charge on" || line == "charge off") {
    plant.charging = line == "charge on";
  } else {
    return false;
  }
  return true;
}

}  // namespace

int main(int argument_count, char** arguments) {
  host::Process process;
  if (const int failure = process.open(argument_count, arguments); failure != 0) return failure;
  rover::Plant plant;
  SimulatedBoard board(plant, process);
  rover::Buffers buffers{};
  wirebond::posix::Port uart(process.uart());
  rover::Rover<SimulatedBoard, wirebond::posix::Port> rover(board, uart, buffers);
  return process.run(
      uart, rover.link(), "estop on, estop off, charge on, charge off",
      [&](const std::string& line) { return obey(line, plant); },
      [&](std::uint32_t) { plant.step(1e-3, static_cast<double>(rover::track_m)); },
      [&](std::uint32_t now_us) { rover.poll(now_us); });
}
