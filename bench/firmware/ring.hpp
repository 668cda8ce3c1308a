// What the programs for the emulated Cortex-M4 share: a ring with frames in it, and how their bytes are handed over.
// bench/m4_cost.py writes and reads the variables and calls the functions by their names.
#pragma once

#include <cstddef>
#include <cstdint>

constexpr std::size_t ring_bytes = 512;
constexpr std::size_t places = 8;        // of frames in the ring, 64 bytes apart
constexpr std::size_t first_place = 40;  // so that a frame at the last one lies across the ring's end

enum class Which : std::uint32_t { field, sentry_gimbal };

extern "C" {
extern std::uint8_t ring[ring_bytes];
extern std::uint32_t frame_bytes[places];
extern std::uint8_t out[128];

/// Receive `frames` frames out of the ring, place after place, each when it has come. Handler calls that this made.
std::uint32_t receive(std::uint32_t frames);
/// Receive the frame at one place and encode its message into `out` again. Its size there; 0: no frame.
std::uint32_t receive_and_encode(std::uint32_t place);
/// Encode the message of the frame at the first place `times` times into `out`. Its size there; 0: no frame.
std::uint32_t encode_again(Which message, std::uint32_t times);
}

/// Keeps the compiler from knowing what lies in memory, and from leaving a store out.
inline void forget_memory() { asm volatile("" ::: "memory"); }

/// `feed(bytes, size)`: once, or twice where the ring's end divides the frame.
template <class Feed>
inline void feed_frame(std::size_t at, std::size_t size, Feed&& feed) {
  const std::size_t before_end = ring_bytes - at;
  if (size <= before_end) {
    feed(ring + at, size);
  } else {
    feed(ring + at, before_end);
    feed(ring, size - before_end);
  }
}

template <class Feed>
inline void feed_frames(std::uint32_t frames, Feed&& feed) {
  std::size_t at = first_place;
  for (std::uint32_t i = 0; i < frames; ++i) {
    forget_memory();
    feed_frame(at, frame_bytes[i % places], feed);
    at = (at + ring_bytes / places) % ring_bytes;
  }
}

template <class Feed>
inline void feed_place(std::size_t place, Feed&& feed) {
  feed_frame(first_place + ring_bytes / places * place, frame_bytes[place], feed);
}
