// How large the MCU's rings are.
#pragma once

#include <cstddef>

namespace soak {

/// What a firmware gives a ring whose largest frame has this size: 1024 bytes, or four frames.
constexpr std::size_t buffer_for(std::size_t frame_bytes) {
  std::size_t bytes = 1024;
  while (bytes < 4 * frame_bytes) bytes *= 2;
  return bytes;
}

}  // namespace soak
