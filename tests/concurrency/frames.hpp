// Frames that tell who sent them, which one they are, and whether they are whole. For tests of queues.
#pragma once

#include <cstddef>
#include <cstdint>

namespace frames {

inline constexpr std::size_t least = 8;
inline constexpr std::size_t most = 40;

inline std::uint32_t mixed(std::uint32_t value) {
  value ^= value >> 16;
  value *= 0x7FEB352Du;
  value ^= value >> 15;
  value *= 0x846CA68Bu;
  return value ^ value >> 16;
}

/// Bytes of frame `number` of this sender.
inline std::size_t size_of(std::uint8_t sender, std::uint32_t number) {
  return least + mixed(number * 16u + sender) % (most - least + 1);
}

inline std::uint8_t byte_at(std::uint8_t sender, std::uint32_t number, std::size_t i) {
  return static_cast<std::uint8_t>(number * 31u + sender * 7u + static_cast<std::uint32_t>(i) * 13u);
}

inline void write(std::uint8_t* to, std::uint8_t sender, std::uint8_t kind, std::uint32_t number, std::size_t size) {
  to[0] = static_cast<std::uint8_t>(size);
  to[1] = sender;
  to[2] = kind;
  to[3] = static_cast<std::uint8_t>(~size);
  for (unsigned i = 0; i < 4; ++i) to[4 + i] = static_cast<std::uint8_t>(number >> 8 * i);
  for (std::size_t i = least; i < size; ++i) to[i] = byte_at(sender, number, i);
}

struct Frame {
  std::size_t size = 0;  ///< 0: what lies there is not whole
  std::uint8_t sender = 0;
  std::uint8_t kind = 0;
  std::uint32_t number = 0;
};

/// The frame that begins at `from`, of at most `available` bytes.
inline Frame read(const std::uint8_t* from, std::size_t available) {
  if (available < least || from[0] < least || from[0] > available || from[3] != static_cast<std::uint8_t>(~from[0])) {
    return {};
  }
  Frame frame{from[0], from[1], from[2], 0};
  for (unsigned i = 0; i < 4; ++i) frame.number |= static_cast<std::uint32_t>(from[4 + i]) << 8 * i;
  for (std::size_t i = least; i < frame.size; ++i) {
    if (from[i] != byte_at(frame.sender, frame.number, i)) return {};
  }
  return frame;
}

}  // namespace frames
