// Both ends of a line that is used to 90 % both ways: probes go out and come back among other frames. With Wirebond at
// the far end, or with nothing but reads and writes at both.
#include <unistd.h>

#include <cerrno>
#include <cstdint>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <string>

#include "pty_trip.hpp"
#include "round_trip.hpp"  // generated
#include "wirebond/posix/serial.hpp"
#include "wirebond/posix/stream.hpp"

namespace {

namespace posix = wirebond::posix;

constexpr std::size_t frame_bytes = round_trip::Probe::Info::max_frame_bytes;
constexpr std::size_t number_at = 5;
constexpr std::size_t flags_at = 41;
constexpr std::uint16_t is_probe = 1;
constexpr std::uint64_t tick_ns = 1'000'000;
constexpr double bytes_per_second = 0.9 * round_trip::baud / 11;
constexpr unsigned most_probes = 1'000'000;

std::uint64_t sent_ns[most_probes];

struct Frame {
  std::uint8_t bytes[frame_bytes];
  std::size_t size;

  std::uint32_t number() const { return wirebond::load<std::uint32_t>(bytes + number_at); }
  bool returns() const { return wirebond::load<std::uint16_t>(bytes + flags_at) == is_probe; }
};

Frame frame_of(std::uint32_t number, std::uint16_t flags) {
  round_trip::Probe probe{};
  probe.number = number;
  probe.flags = flags;
  Frame frame{};
  static_cast<void>(encode(probe, frame.bytes, sizeof frame.bytes, frame.size));
  return frame;
}

bool send(int fd, const Frame& frame) { return posix::send(fd, frame.bytes, frame.size, 1000) == 0; }

/// Finds frames by their size alone: the stream is clean, and has no other ones.
class Cutter {
 public:
  template <class Take>
  void feed(const std::uint8_t* bytes, std::size_t size, Take&& take) {
    for (std::size_t i = 0; i < size; ++i) {
      frame_.bytes[frame_.size++] = bytes[i];
      if (frame_.size < frame_bytes) continue;
      take(frame_);
      frame_.size = 0;
    }
  }

 private:
  Frame frame_{};
};

/// Runs an end for this long: `tick(frames)` each millisecond, with how many frames are due, and `take(bytes, size)`.
template <class Tick, class Take>
int run(int fd, double seconds, double rate, Tick&& tick, Take&& take) {
  const std::uint64_t begin = now_ns();
  const std::uint64_t end = begin + static_cast<std::uint64_t>(seconds * 1e9);
  std::uint64_t next = begin;
  std::uint64_t sent = 0;
  for (;;) {
    const std::uint64_t now = now_ns();
    if (now >= end + 200 * tick_ns) return 0;  // what is under way comes back
    if (now >= next && now < end) {
      const auto due = static_cast<std::uint64_t>(static_cast<double>(now - begin) * 1e-9 * rate);
      if (!tick(due - sent)) return 1;
      sent = due;
      next = now - (now - begin) % tick_ns + tick_ns;
    }
    std::uint8_t bytes[4096];
    if (!wait_for_bytes(fd, now < end ? next : now + tick_ns)) continue;
    const ssize_t got = ::read(fd, bytes, sizeof bytes);
    if (got < 0 && errno != EAGAIN && errno != EINTR) return 1;
    if (got > 0) take(bytes, static_cast<std::size_t>(got));
  }
}

posix::Descriptor open(const char* path) {
  posix::SerialError error;
  return posix::open_serial(path, {round_trip::baud}, error);
}

/// Sends a probe each millisecond, and other frames up to the line use. Prints each round trip in nanoseconds.
int ask(const char* path, double seconds) {
  const posix::Descriptor tty = open(path);
  if (!tty.is_open()) return 3;
  std::uint32_t number = 0;
  Cutter cutter;
  const auto tick = [&](std::uint64_t frames) {
    for (std::uint64_t i = 0; i < frames; ++i) {
      if (i == 0 && number < most_probes) sent_ns[number] = now_ns();
      if (!send(tty.get(), i == 0 ? frame_of(number++, is_probe) : frame_of(0, 0))) return false;
    }
    return true;
  };
  const auto take = [&](const std::uint8_t* bytes, std::size_t size) {
    const std::uint64_t now = now_ns();
    cutter.feed(bytes, size, [&](const Frame& frame) {
      if (!frame.returns()) return;
      std::printf("%llu\n", static_cast<unsigned long long>(now - sent_ns[frame.number() % most_probes]));
    });
  };
  const int failed = run(tty.get(), seconds, bytes_per_second / frame_bytes, tick, take);
  std::printf("sent %u\n", number);
  return failed;
}

struct Answer {
  void on(const round_trip::Probe& probe) {
    if (probe.flags == is_probe) ok = ok && send(fd, frame_of(probe.number, is_probe));
  }
  int fd;
  bool ok = true;
};

/// Sends probes back as they come, and other frames up to the line use.
int serve(const char* path, double seconds, bool with_wirebond) {
  const posix::Descriptor tty = open(path);
  if (!tty.is_open()) return 3;
  std::puts("ready");
  std::fflush(stdout);
  const auto tick = [&](std::uint64_t frames) {
    while (frames-- != 0) {
      if (!send(tty.get(), frame_of(0, 0))) return false;
    }
    return true;
  };
  const double rate = bytes_per_second / frame_bytes - 1000;  // the probes are 1000 a second
  wait_for_bytes(tty.get(), ~std::uint64_t{0});
  if (with_wirebond) {
    Answer answer{tty.get()};
    round_trip::Receiver<round_trip::FromHost> receiver(round_trip::idle_us);
    return run(tty.get(), seconds, rate, tick, [&](const std::uint8_t* bytes, std::size_t size) {
      receiver.feed(bytes, size, posix::now_us(), answer);
    });
  }
  Cutter cutter;
  return run(tty.get(), seconds, rate, tick, [&](const std::uint8_t* bytes, std::size_t size) {
    cutter.feed(bytes, size, [&](const Frame& frame) {
      if (frame.returns()) send(tty.get(), frame);
    });
  });
}

}  // namespace

int main(int count, char** arguments) {
  const std::string what = count == 4 ? arguments[1] : "";
  if (what == "ask") return ask(arguments[2], std::atof(arguments[3]));
  if (what == "serve-bytes") return serve(arguments[2], std::atof(arguments[3]), false);
  if (what == "serve-frames") return serve(arguments[2], std::atof(arguments[3]), true);
  std::fprintf(stderr, "usage: loaded_round_trip ask|serve-bytes|serve-frames PORT SECONDS\n");
  return 2;
}
