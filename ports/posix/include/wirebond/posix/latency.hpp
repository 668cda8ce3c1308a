// How long a port may hold received bytes back: what the system's device tree says. Opens no port.
#pragma once

#include <unistd.h>

#include <climits>
#include <cstdint>
#include <cstdlib>
#include <string>

namespace wirebond::posix {

/// How long a USB adapter may hold bytes back (the FTDI default).
inline constexpr std::uint32_t adapter_latency_us = 16'000;

/// A UART hands bytes over once this many wait, or a few byte times after the last one (the 16550's FIFO has 16).
inline constexpr std::uint32_t uart_buffer_bytes = 16;

/// How long the port at `path` may hold bytes back, in microseconds: what a host adds to a protocol's `idle_us`.
/// - a device behind USB: adapter_latency_us;
/// - another tty of the system: the time of a UART's buffer, at `bytes_per_second` of the line;
/// - what the system knows no device of (a pty, a socket): 0.
/// `ttys`: the folder in which the system lists them; tests have one of their own.
inline std::uint32_t port_latency_us(const std::string& path, double bytes_per_second,
                                     const std::string& ttys = "/sys/class/tty") {
  char real[PATH_MAX];
  const std::string name = ::realpath(path.c_str(), real) != nullptr ? real : path;  // /dev/serial/by-id/… is a link
  const std::string entry = ttys + "/" + name.substr(name.rfind('/') + 1) + "/device";
  if (::realpath(entry.c_str(), real) == nullptr) return 0;
  if (std::string(real).find("/usb") != std::string::npos) return adapter_latency_us;
  return static_cast<std::uint32_t>(1e6 * uart_buffer_bytes / bytes_per_second);
}

}  // namespace wirebond::posix
