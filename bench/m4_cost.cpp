// What a frame costs generated code on a Cortex-M4: loops whose instructions an emulator counts. See m4_cost.py.
#include <cstddef>
#include <cstdint>

#include "enterprize.hpp"

namespace {

constexpr std::size_t ring_bytes = 512;
constexpr std::size_t places = 8;  // of a frame in the ring; the last one lies across its end

}  // namespace

extern "C" {  // the bench writes and reads these by their names
std::uint8_t ring[ring_bytes];
std::uint8_t out[64];
}

namespace {

/// Keeps the compiler from knowing what lies in memory, and from leaving a store out.
inline void forget_memory() { asm volatile("" ::: "memory"); }

struct Handler {
  /// As firmware has it: in another file, so that the whole message must be there.
  __attribute__((noinline)) void on(const enterprize::FieldMsg& message) { take(message, field); }
  __attribute__((noinline)) void on(const enterprize::SentryGimbalMsg& message) { take(message, sentry_gimbal); }
  void on(const enterprize::GimbalMsg&) { ++others; }
  void on(const enterprize::ChassisMsg&) { ++others; }

  template <class Message>
  void take(const Message& message, const Message*& seen) {
    seen = &message;
    forget_memory();
    ++calls;
  }

  std::uint32_t calls = 0;
  std::uint32_t others = 0;
  const enterprize::FieldMsg* field = nullptr;
  const enterprize::SentryGimbalMsg* sentry_gimbal = nullptr;
};

/// Encodes what it is handed: so the test sees that every field came through.
struct Echo {
  template <class Message>
  void on(const Message& message) {
    static_cast<void>(encode(message, out, sizeof out, size));
  }
  std::size_t size = 0;
};

Handler handler;
Echo echo;

/// Eight places, 64 bytes apart; half of a frame at the last one lies behind the ring's end.
std::size_t place_of(std::size_t index, std::size_t frame_bytes) {
  return (index + 1) * (ring_bytes / places) - frame_bytes / 2;
}

template <class AnyHandler>
void feed_from_ring(enterprize::Receiver<enterprize::FromMcu>& receiver, std::size_t at, std::size_t frame_bytes,
                    std::uint32_t now_us, AnyHandler& to) {
  const std::size_t before_end = ring_bytes - at;
  if (frame_bytes <= before_end) {
    receiver.feed(ring + at, frame_bytes, now_us, to);
  } else {
    receiver.feed(ring + at, before_end, now_us, to);
    receiver.feed(ring, frame_bytes - before_end, now_us, to);
  }
}

template <class Message>
std::size_t encode_again(const std::uint8_t* payload, std::size_t payload_bytes, std::uint8_t* out, std::size_t times) {
  static Message message;
  std::size_t size = 0;
  if (!decode(payload, payload_bytes, message)) return 0;
  for (std::size_t i = 0; i < times; ++i) {
    forget_memory();
    if (encode(message, out, Message::Info::max_frame_bytes, size) != wirebond::Status::ok) return 0;
  }
  return size;
}

}  // namespace

extern "C" {

/// Receive `frames` frames of one size out of the ring, each when it has come. Handler calls that this made.
std::uint32_t receive(std::uint32_t frame_bytes, std::uint32_t frames) {
  static enterprize::Receiver<enterprize::FromMcu> receiver;
  const std::uint32_t before = handler.calls;
  std::size_t at = place_of(0, frame_bytes);
  for (std::uint32_t i = 0; i < frames; ++i) {
    forget_memory();
    feed_from_ring(receiver, at, frame_bytes, i, handler);
    at = (at + ring_bytes / places) % ring_bytes;
  }
  return handler.calls - before;
}

/// Receive the frame at one place and encode its message into `out` again. Its size.
std::uint32_t receive_and_encode(std::uint32_t frame_bytes, std::uint32_t place) {
  enterprize::Receiver<enterprize::FromMcu> receiver;
  echo.size = 0;
  feed_from_ring(receiver, place_of(place, frame_bytes), frame_bytes, 0, echo);
  return static_cast<std::uint32_t>(echo.size);
}

/// Encode the message of the frame at the first place `times` times into `out`. The size on the wire; 0: refused.
std::uint32_t encode_field(std::uint32_t payload_at, std::uint32_t times) {
  return static_cast<std::uint32_t>(
      encode_again<enterprize::FieldMsg>(ring + payload_at, enterprize::FieldMsg::Info::max_payload_bytes, out, times));
}

std::uint32_t encode_sentry_gimbal(std::uint32_t payload_at, std::uint32_t times) {
  return static_cast<std::uint32_t>(encode_again<enterprize::SentryGimbalMsg>(
      ring + payload_at, enterprize::SentryGimbalMsg::Info::max_payload_bytes, out, times));
}
}
