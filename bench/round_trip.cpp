// The far end of a pty that sends back what it reads, and the near end without Wirebond: what a round trip costs at
// all.
#include "round_trip.hpp"  // generated

#include <unistd.h>

#include <cerrno>
#include <cstdint>
#include <cstdio>
#include <cstdlib>
#include <string>

#include "pty_trip.hpp"
#include "wirebond/posix/pty.hpp"
#include "wirebond/posix/serial.hpp"
#include "wirebond/posix/stream.hpp"

namespace {

namespace posix = wirebond::posix;

constexpr std::size_t frame_bytes = round_trip::Probe::Info::max_frame_bytes;
static_assert(frame_bytes == 45);

/// Waits for bytes and reads them. 0: the other side is gone.
std::size_t read_some(int fd, std::uint8_t* bytes, std::size_t size, std::uint64_t* came_ns = nullptr) {
  for (;;) {
    wait_for_bytes(fd, ~std::uint64_t{0});
    if (came_ns != nullptr) *came_ns = now_ns();
    const ssize_t got = ::read(fd, bytes, size);
    if (got > 0) return static_cast<std::size_t>(got);
    if (got == 0 || (errno != EAGAIN && errno != EINTR)) return 0;
  }
}

void echo_bytes(int fd) {
  std::uint8_t bytes[4096];
  while (const std::size_t size = read_some(fd, bytes, sizeof bytes)) {
    if (posix::send(fd, bytes, size, 1000) != 0) return;
  }
}

/// Decodes each frame, and encodes the answer.
struct Echo {
  void on(const round_trip::Probe& probe) {
    std::uint8_t frame[frame_bytes];
    std::size_t size = 0;
    if (encode(probe, frame, sizeof frame, size) != wirebond::Status::ok) return;
    failed = failed || posix::send(fd, frame, size, 1000) != 0;
  }
  int fd;
  bool failed = false;
};

void echo_frames(int fd) {
  Echo echo{fd};
  round_trip::Receiver<round_trip::FromHost> receiver(round_trip::idle_us);
  while (!echo.failed && posix::pump(fd, 1000, receiver, echo) == 0) {
  }
}

int serve(bool frames) {
  posix::Pty pty;
  if (!posix::open_pty(pty)) return 3;
  std::printf("%s\n", pty.path.c_str());
  std::fflush(stdout);
  frames ? echo_frames(pty.controller.get()) : echo_bytes(pty.controller.get());
  return 0;
}

/// One line for each round trip, in nanoseconds.
int ask(const char* path, unsigned count) {
  posix::SerialError error;
  const posix::Descriptor tty = posix::open_serial(path, {round_trip::baud}, error);
  if (!tty.is_open()) return 3;
  std::uint8_t frame[frame_bytes] = {0xAA};
  std::uint8_t bytes[frame_bytes];
  for (unsigned i = 0; i < count; ++i) {
    const std::uint64_t began_ns = now_ns();
    if (posix::send(tty.get(), frame, sizeof frame, 1000) != 0) return 1;
    std::uint64_t came_ns = 0;
    for (std::size_t got = 0; got < sizeof frame;) {
      const std::size_t size = read_some(tty.get(), bytes, sizeof bytes - got, &came_ns);
      if (size == 0) return 1;
      got += size;
    }
    std::printf("%llu\n", static_cast<unsigned long long>(came_ns - began_ns));
  }
  return 0;
}

}  // namespace

int main(int count, char** arguments) {
  const std::string what = count > 1 ? arguments[1] : "";
  if (what == "echo-bytes") return serve(false);
  if (what == "echo-frames") return serve(true);
  if (what == "ask" && count == 4) return ask(arguments[2], static_cast<unsigned>(std::atoi(arguments[3])));
  std::fprintf(stderr, "usage: round_trip echo-bytes | echo-frames | ask PORT COUNT\n");
  return 2;
}
