// How long a port may hold received bytes back: from the system's device tree, and its latency timer. Opens no port.
#pragma once

#include <fcntl.h>
#include <unistd.h>

#include <cerrno>
#include <climits>
#include <cstdint>
#include <cstdlib>
#include <string>

#include "wirebond/posix/descriptor.hpp"

namespace wirebond::posix {

/// How long a USB adapter may hold bytes back (the FTDI default).
inline constexpr std::uint32_t adapter_latency_us = 16'000;

/// A UART delivers bytes once this many wait, or a few byte times after the last one (the 16550's FIFO has 16).
inline constexpr std::uint32_t uart_buffer_bytes = 16;

/// Return how long the port at `path` may hold bytes back, in microseconds: a host adds it to a protocol's `idle_us`.
/// - a device on USB: adapter_latency_us;
/// - another tty of the system: the time of a UART's buffer, at `bytes_per_second` of the line;
/// - a path without a device in the system (a pty, a socket): 0.
/// `ttys`: the folder in which the system lists them; tests have their own.
inline std::uint32_t port_latency_us(const std::string& path, double bytes_per_second,
                                     const std::string& ttys = "/sys/class/tty") {
  char real[PATH_MAX];
  const std::string name = ::realpath(path.c_str(), real) != nullptr ? real : path;  // /dev/serial/by-id/… is a link
  const std::string entry = ttys + "/" + name.substr(name.rfind('/') + 1) + "/device";
  if (::realpath(entry.c_str(), real) == nullptr) return 0;
  if (std::string(real).find("/usb") != std::string::npos) return adapter_latency_us;
  return static_cast<std::uint32_t>(1e6 * uart_buffer_bytes / bytes_per_second);
}

/// The latency timer of an FTDI adapter: how long it holds received bytes back, from one report over USB to the next.
/// The driver ftdi_sio shows it as a file in sysfs (1 to 255 ms, 16 by default); ports of other drivers have none.
struct LatencyTimer {
  std::string path;    ///< of the timer's file
  int before_ms = -1;  ///< before the port was opened; -1: there is no such file
  int now_ms = -1;
  int code = 0;  ///< errno of a failed write
};

/// Read the number in a small file of sysfs; -1 if there is none.
inline int small_number(const std::string& path) {
  const Descriptor file(::open(path.c_str(), O_RDONLY | O_CLOEXEC));
  char text[16] = {};
  if (!file.is_open() || ::read(file.get(), text, sizeof text - 1) <= 0) return -1;
  char* end = text;
  const long number = std::strtol(text, &end, 10);
  return end == text || number < 0 || number > INT_MAX ? -1 : static_cast<int>(number);
}

/// Read the timer's current value. `root`: folder with the system's `sys`; tests have their own.
inline LatencyTimer latency_timer(const std::string& port, const std::string& root = "/") {
  char real[PATH_MAX];
  const std::string name = ::realpath(port.c_str(), real) != nullptr ? real : port;
  LatencyTimer timer;
  timer.path = root + (root.empty() || root.back() != '/' ? "/" : "") + "sys/bus/usb-serial/devices/" +
               name.substr(name.rfind('/') + 1) + "/latency_timer";
  timer.before_ms = timer.now_ms = small_number(timer.path);
  return timer;
}

/// Set the timer of an open port to 1 ms, if it is longer and its file is writable.
inline void set_latency_timer(LatencyTimer& timer) {
  constexpr int best_ms = 1;
  if (timer.before_ms < 0) return;
  timer.now_ms = small_number(timer.path);
  if (timer.now_ms <= best_ms) return;
  const Descriptor file(::open(timer.path.c_str(), O_WRONLY | O_CLOEXEC));
  if (!file.is_open() || ::write(file.get(), "1\n", 2) != 2) timer.code = errno;
  timer.now_ms = small_number(timer.path);
}

}  // namespace wirebond::posix
