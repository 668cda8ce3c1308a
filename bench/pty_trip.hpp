// What the programs of the round trips share: a clock, and waiting for bytes.
#pragma once

#include <poll.h>
#include <time.h>
#include <unistd.h>

#include <cerrno>
#include <cstddef>
#include <cstdint>

inline std::uint64_t now_ns() {
  timespec now{};
  ::clock_gettime(CLOCK_MONOTONIC, &now);
  return static_cast<std::uint64_t>(now.tv_sec) * 1'000'000'000U + static_cast<std::uint64_t>(now.tv_nsec);
}

/// Are there bytes? Waits until `until_ns`; at once where that is over.
inline bool wait_for_bytes(int fd, std::uint64_t until_ns) {
  pollfd waiting{fd, POLLIN, 0};
  const std::uint64_t now = now_ns();
  const std::uint64_t left = until_ns > now ? until_ns - now : 0;
  const timespec timeout{static_cast<time_t>(left / 1'000'000'000), static_cast<long>(left % 1'000'000'000)};
  return ::ppoll(&waiting, 1, &timeout, nullptr) > 0;
}
