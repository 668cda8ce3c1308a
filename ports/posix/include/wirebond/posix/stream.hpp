// Moves bytes through an open descriptor: waits with a limit, frames written whole, and their time stamps.
#pragma once

#include <poll.h>
#include <time.h>
#include <unistd.h>

#include <cerrno>
#include <cstddef>
#include <cstdint>

namespace wirebond::posix {

/// Return microseconds of a clock that never jumps, modulo 2^32: the `now_us` of receivers and deadlines. Any thread.
inline std::uint32_t now_us() {
  struct timespec now {};
  ::clock_gettime(CLOCK_MONOTONIC, &now);
  return static_cast<std::uint32_t>(static_cast<std::uint64_t>(now.tv_sec) * 1'000'000U +
                                    static_cast<std::uint64_t>(now.tv_nsec) / 1'000U);
}

/// Result of a read.
struct Received {
  std::size_t size = 0;
  int error = 0;  ///< errno; EIO if the other side is gone for good. 0: go on, even if `size` is 0
};

/// Read the bytes that are there, or come within `timeout_ms`; returns with the first of them. `fd` may block or not.
inline Received receive(int fd, std::uint8_t* out, std::size_t capacity, int timeout_ms) {
  struct pollfd waiting {
    fd, POLLIN, 0
  };
  const int ready = ::poll(&waiting, 1, timeout_ms);
  if (ready < 0) return {0, errno == EINTR ? 0 : errno};
  if (ready == 0) return {};
  const ssize_t size = ::read(fd, out, capacity);
  if (size > 0) return {static_cast<std::size_t>(size), 0};
  if (size == 0) return {0, EIO};  // hung up
  return {0, errno == EAGAIN || errno == EINTR ? 0 : errno};
}

/// Read once, for at most `timeout_ms`, and pass the bytes, or the silence, to `receiver`; `handler` and `deadlines`
/// are for its `feed` and `idle`. The time is taken before the read, as the rule about silence requires. Returns 0, or
/// the read's error.
template <class Receiver, class Handler, class... Watch>
int pump(int fd, int timeout_ms, Receiver& receiver, Handler& handler, Watch&... deadlines) {
  std::uint8_t bytes[4096];
  const std::uint32_t now = now_us();
  const Received received = receive(fd, bytes, sizeof bytes, timeout_ms);
  if (received.error != 0) return received.error;
  if (received.size != 0) {
    receiver.feed(bytes, received.size, now, handler, deadlines...);
  } else {
    receiver.idle(now, handler, deadlines...);
  }
  return 0;
}

/// Write all of `bytes`. Returns 0, or an errno: ETIMEDOUT if the line took nothing for `timeout_ms`. After an error
/// part of a frame may be on the line; the receiver discards it.
inline int send(int fd, const std::uint8_t* bytes, std::size_t size, int timeout_ms) {
  while (size != 0) {
    const ssize_t taken = ::write(fd, bytes, size);
    if (taken >= 0) {
      bytes += taken;
      size -= static_cast<std::size_t>(taken);
      continue;
    }
    if (errno == EINTR) continue;
    if (errno != EAGAIN) return errno;
    struct pollfd waiting {
      fd, POLLOUT, 0
    };
    const int ready = ::poll(&waiting, 1, timeout_ms);
    if (ready == 0) return ETIMEDOUT;
    if (ready < 0 && errno != EINTR) return errno;
  }
  return 0;
}

}  // namespace wirebond::posix
