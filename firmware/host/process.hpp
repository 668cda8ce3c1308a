// Common part of all firmwares as processes: a pty instead of the UART, a clock, an operator on stdin, the main loop.
// No protocol, no simulated body.
#pragma once

#include <fcntl.h>
#include <poll.h>
#include <time.h>
#include <unistd.h>

#include <cerrno>
#include <cstdint>
#include <cstdio>
#include <cstring>
#include <string>

#include "wirebond/posix/port.hpp"
#include "wirebond/posix/pty.hpp"

namespace host {

inline std::uint64_t monotonic_us() {
  timespec now{};
  ::clock_gettime(CLOCK_MONOTONIC, &now);
  return static_cast<std::uint64_t>(now.tv_sec) * 1'000'000U + static_cast<std::uint64_t>(now.tv_nsec) / 1000U;
}

/// The operator's lines, from stdin.
class Operator {
 public:
  /// Pass each whole line that came to `obey`. Returns false when stdin has ended.
  template <class Obey>
  bool read(Obey&& obey) {
    char chunk[256];
    const ssize_t got = ::read(STDIN_FILENO, chunk, sizeof chunk);
    if (got == 0) return false;
    if (got < 0) return errno == EAGAIN || errno == EINTR;
    line_.append(chunk, static_cast<std::size_t>(got));
    for (std::size_t end; (end = line_.find('\n')) != std::string::npos; line_.erase(0, end + 1)) {
      obey(line_.substr(0, end));
    }
    if (line_.size() > 1000) line_.clear();
    return true;
  }

 private:
  std::string line_;
};

/// One firmware's process. It prints the pty's path, then a line for each event with its time in seconds.
class Process {
 public:
  /// Open the pty. On failure returns the exit code, with a sentence on stderr.
  int open(int argument_count, char** arguments) {
    ends_with_stdin_ = argument_count > 1 && std::strcmp(arguments[1], "--end-with-stdin") == 0;
    if (argument_count > 1 && !ends_with_stdin_) {
      std::fprintf(stderr, "usage: %s [--end-with-stdin]\n", arguments[0]);
      return 2;
    }
    std::setvbuf(stdout, nullptr, _IOLBF, BUFSIZ);
    if (!wirebond::posix::open_pty(pty_)) {
      std::fprintf(stderr, "cannot open a pty: %s\n", std::strerror(errno));
      return 3;
    }
    std::printf("%s\n", pty_.path.c_str());
    ::fcntl(STDIN_FILENO, F_SETFL, ::fcntl(STDIN_FILENO, F_GETFL) | O_NONBLOCK);
    start_us_ = monotonic_us();
    return 0;
  }

  /// Return the descriptor for the port, after `open`.
  int uart() const { return pty_.controller.get(); }

  void report(const char* event) const {
    std::printf("%.3f %s\n", static_cast<double>(monotonic_us() - start_us_) * 1e-6, event);
  }

  /// Run the main loop; returns the exit code, if it ends at all. `obey(line)` returns false for a line that is none of
  /// `expected`. `pass(now_us)` is called for each millisecond, including those that the machine had no time for;
  /// `poll(now_us)` about once per millisecond.
  template <class Link, class Obey, class Pass, class Poll>
  int run(wirebond::posix::Port& uart, Link& link, const char* expected, Obey&& obey, Pass&& pass, Poll&& poll) {
    if (!uart.start(link)) {
      std::fprintf(stderr, "the system has no descriptor left: %s\n", std::strerror(errno));
      return 3;
    }
    bool has_stdin = true;
    std::uint64_t before_us = start_us_;
    while (has_stdin || !ends_with_stdin_) {
      pollfd watched = {has_stdin ? STDIN_FILENO : -1, POLLIN, 0};
      ::poll(&watched, 1, tick_ms);
      if (has_stdin && watched.revents != 0) {
        has_stdin = operator_.read([&](const std::string& line) {
          if (obey(line)) return;
          std::fprintf(stderr, "unknown line '%.40s'; expected: %s\n", line.c_str(), expected);
        });
      }
      const std::uint64_t now_us = monotonic_us();
      while (before_us + 1000 <= now_us) pass(static_cast<std::uint32_t>(before_us += 1000));
      poll(static_cast<std::uint32_t>(now_us));
    }
    uart.stop();  // its thread uses the link, which may be destroyed first
    return 0;
  }

 private:
  static constexpr int tick_ms = 1;

  wirebond::posix::Pty pty_;
  Operator operator_;
  std::uint64_t start_us_ = 0;
  bool ends_with_stdin_ = false;
};

}  // namespace host
