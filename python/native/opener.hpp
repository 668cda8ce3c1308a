// Opens the port of a link, again and again: a tty or a TCP connection, with a sentence for each failure.
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

/// Why a port cannot be opened, or was lost.
struct PortProblem {
  std::string sentence;
  int code = 0;  ///< the system's error number; 0 if it gave none
};

/// Settings requested from a serial port's driver, and the actual ones.
struct LineReport {
  std::uint32_t asked_baud = 0;
  posix::SerialReport serial;
  posix::LatencyTimer timer;
};

/// One thread at a time.
class Opener {
 public:
  virtual ~Opener() = default;

  /// Return the port as its user wrote it.
  virtual std::string name() const = 0;

  /// Return a non-blocking descriptor, or an empty one and `problem`. May wait for seconds, without locks and without
  /// the interpreter; `cancelled` ends that within a moment.
  virtual posix::Descriptor open(const std::atomic<bool>& cancelled, PortProblem& problem) = 0;

  /// Write as the system's `write` does, but without a SIGPIPE.
  virtual ssize_t write(int descriptor, const std::uint8_t* bytes, std::size_t size) const = 0;

  /// Return why an open port was lost: `code` of a read or write, 0 for the end of its bytes.
  virtual std::string why_gone(int code) const = 0;

  /// Return the settings of the port that `open` returned last; none: it has no settings.
  virtual std::optional<LineReport> line() const { return std::nullopt; }

  /// Put the settings of the open port back if another program has changed them. Returns whether one had.
  virtual bool restore_settings(int /*descriptor*/) const { return false; }

  /// Return the file whose appearance means that opening may succeed; empty: there is none.
  virtual std::string path() const { return {}; }
};

/// `root`: folder with the system's `sys`: "/", or a test's own folder.
std::unique_ptr<Opener> serial_opener(std::string path, const posix::SerialSettings& settings, std::string root);

/// Returns the path that the name currently means; empty, and `problem`, if there is none. Called as `Opener::open` is.
using Resolve = std::function<std::string(PortProblem& problem)>;

/// Open a tty whose path may change, such as that of a USB device with a name like usb:1a86:55d3.
std::unique_ptr<Opener> moving_serial_opener(std::string name, Resolve resolve, const posix::SerialSettings& settings,
                                             std::string root);

/// `name`: the port as the user wrote it, for sentences.
std::unique_ptr<Opener> tcp_opener(std::string name, std::string host, std::string port);

}  // namespace wirebond::engine
