// A firmware with every service of protocols/native.yaml, as a process: two parameters, and a log line for each line of
// its operator, `LEVEL text`.
#include <array>
#include <cstdint>
#include <string>

#include "host/process.hpp"
#include "native_link.hpp"

namespace {

struct Arm {
  void stop() {}
  auto& parameters() { return table; }

  static constexpr std::array<wirebond::ParameterRule, 2> rules = {{{0.0F, 10.0F, 1.0F}, {-1.0F, 1.0F, 0.5F}}};
  wirebond::Parameters<2> table{rules};
};

/// The level that a line begins with, and the text behind it.
bool log_line(const std::string& line, wirebond::Level& level, std::string& text) {
  static constexpr std::array<const char*, 4> names = {"debug ", "info ", "warning ", "error "};
  for (std::size_t i = 0; i < names.size(); ++i) {
    const std::string name = names[i];
    if (line.compare(0, name.size(), name) != 0) continue;
    level = static_cast<wirebond::Level>(i);
    text = line.substr(name.size());
    return true;
  }
  return false;
}

}  // namespace

int main(int argument_count, char** arguments) {
  host::Process process;
  if (const int failure = process.open(argument_count, arguments); failure != 0) return failure;
  Arm arm;
  native::McuBuffers<512, 1024> buffers{};
  wirebond::posix::Port uart(process.uart());
  native::McuLink<Arm, wirebond::posix::Port, decltype(buffers)> link{arm, uart, buffers};
  const auto obey = [&](const std::string& line) {
    wirebond::Level level{};
    std::string text;
    return log_line(line, level, text) && link.log(level, text) == wirebond::Status::ok;
  };
  return process.run(
      uart, link, "LEVEL text", obey, [](std::uint32_t) {}, [&](std::uint32_t now_us) { link.poll(now_us); });
}
