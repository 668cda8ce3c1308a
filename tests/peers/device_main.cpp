// A device of device.hpp as a process on a pty.
#include <string>

#include "device.hpp"
#include "host/process.hpp"

int main(int argument_count, char** arguments) {
  host::Process process;
  if (const int failure = process.open(argument_count, arguments); failure != 0) return failure;
  using Device = device::Device<wirebond::posix::Port>;
  static Device::Buffers buffers{};
  wirebond::posix::Port uart(process.uart());
  static Device device(uart, buffers);
  return process.run(
      uart, device.link(), "nothing", [](const std::string&) { return false; }, [](std::uint32_t) {},
      [](std::uint32_t now_us) { device.poll(now_us); });
}
