// The echo as a process.
#include <string>

#include "echo.hpp"
#include "host/line_clock.hpp"
#include "host/process.hpp"

namespace {

struct NoLight {
  void blink() {}
};

}  // namespace

int main(int argument_count, char** arguments) {
  host::Process process;
  if (const int failure = process.open(argument_count, arguments); failure != 0) return failure;
  NoLight light;
  echo::Buffers buffers{};
  wirebond::posix::Port uart(process.uart());
  echo::Echo<NoLight, wirebond::posix::Port> echo(light, uart, buffers);
  host::LineClock clock(echo.link());
  return process.run(
      uart, echo.link(), "nothing", [](const std::string&) { return false; },
      [&](std::uint32_t) {
        clock.advance();
        echo.poll(clock.now_us());
      },
      [](std::uint32_t) {});
}
