// Opening the port of a link, again and again: a tty or a TCP connection, and what to say where that fails.
#pragma once

#include <sys/types.h>

#include <atomic>
#include <cstddef>
#include <cstdint>
#include <functional>
#include <memory>
#include <optional>
#include <string>

#include "wirebond/posix/descriptor.hpp"
#include "wirebond/posix/latency.hpp"
#include "wirebond/posix/serial.hpp"

namespace wirebond::engine {

/// Why a port cannot be opened, or went away.
struct PortProblem {
  std::string sentence;
  int code = 0;  ///< the system's error number; 0 where it gave none
};

/// What was asked of a serial port's driver, and what came of it.
struct LineReport {
  std::uint32_t asked_baud = 0;
  posix::SerialReport serial;
  posix::LatencyTimer timer;
};

/// One thread at a time.
class Opener {
 public:
  virtual ~Opener() = default;

  /// The port as its user wrote it.
  virtual std::string name() const = 0;

  /// A non-blocking descriptor; or an empty one, and `problem`. May wait for seconds, without locks and without the
  /// interpreter; `cancelled` ends that within a moment.
  virtual posix::Descriptor open(const std::atomic<bool>& cancelled, PortProblem& problem) = 0;

  /// As the system's `write`, and never a SIGPIPE.
  virtual ssize_t write(int descriptor, const std::uint8_t* bytes, std::size_t size) const = 0;

  /// Why an open port is not there any more: `code` of a read or write, 0 for the end of its bytes.
  virtual std::string why_gone(int code) const = 0;

  /// Of the port that `open` gave last; none: it has no settings.
  virtual std::optional<LineReport> line() const { return std::nullopt; }

  /// The file whose appearance says that opening is worth a try; empty: there is none.
  virtual std::string path() const { return {}; }
};

/// `root`: where `sys` is: "/", and a folder of their own for tests.
std::unique_ptr<Opener> serial_opener(std::string path, const posix::SerialSettings& settings, std::string root);

/// Where the name leads at the moment; empty, and `problem`, where it leads nowhere. Called as `Opener::open` is.
using Resolve = std::function<std::string(PortProblem& problem)>;

/// A tty whose path may be another one each time, as that of a USB device with a name such as usb:1a86:55d3.
std::unique_ptr<Opener> moving_serial_opener(std::string name, Resolve resolve, const posix::SerialSettings& settings,
                                             std::string root);

/// `name`: the port as the user wrote it, for sentences.
std::unique_ptr<Opener> tcp_opener(std::string name, std::string host, std::string port);

}  // namespace wirebond::engine
