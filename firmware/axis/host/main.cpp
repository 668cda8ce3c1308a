// The linear axis as a process, with a simulated slide. Events: a parameter was set. On stdin it takes log lines for
// the host, LEVEL TEXT, which wait here while the send queue has no room for them.
#include <array>
#include <cstddef>
#include <cstdint>
#include <cstdio>
#include <deque>
#include <string>

#include "axis.hpp"
#include "host/process.hpp"

namespace {

class SimulatedBoard {
 public:
  explicit SimulatedBoard(const host::Process& process) : process_(process) {}

  float position_m() const { return position_m_; }
  void set_speed(float speed_m_s) { speed_m_s_ = speed_m_s; }
  void store(std::size_t index, float value) {
    char event[48];
    std::snprintf(event, sizeof event, "parameter %zu is %.3f", index, static_cast<double>(value));
    process_.report(event);
  }

  void step(float step_s) { position_m_ += speed_m_s_ * step_s; }

 private:
  const host::Process& process_;
  float position_m_ = 0.0F;
  float speed_m_s_ = 0.0F;
};

struct LogLine {
  wirebond::Level level{};
  std::string text;
};

/// Split a line into its level and the text after it. Returns false where it has none.
bool split(const std::string& line, LogLine& read) {
  static constexpr std::array<const char*, 4> names = {"debug ", "info ", "warning ", "error "};
  for (std::size_t i = 0; i < names.size(); ++i) {
    const std::string name = names[i];
    if (line.compare(0, name.size(), name) != 0) continue;
    read = {static_cast<wirebond::Level>(i), line.substr(name.size())};
    return true;
  }
  return false;
}

}  // namespace

int main(int argument_count, char** arguments) {
  host::Process process;
  if (const int failure = process.open(argument_count, arguments); failure != 0) return failure;
  SimulatedBoard board(process);
  axis::Buffers buffers{};
  wirebond::posix::Port uart(process.uart());
  axis::Axis<SimulatedBoard, wirebond::posix::Port> axis(board, uart, buffers);
  std::deque<LogLine> waiting;
  const auto obey = [&](const std::string& line) {
    LogLine read;
    if (!split(line, read)) return false;
    waiting.push_back(read);
    return true;
  };
  const auto poll = [&](std::uint32_t now_us) {
    axis.poll(now_us);
    while (!waiting.empty() && axis.link().log(waiting.front().level, waiting.front().text) == wirebond::Status::ok)
      waiting.pop_front();
  };
  return process.run(
      uart, axis.link(), "LEVEL TEXT, with debug, info, warning or error", obey,
      [&](std::uint32_t) { board.step(0.001F); }, poll);
}
