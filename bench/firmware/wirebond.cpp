// Wirebond's generated C++ on a Cortex-M4; see ring.hpp.
#include "enterprize.hpp"
#include "ring.hpp"

std::uint8_t ring[ring_bytes];
std::uint32_t frame_bytes[places];
std::uint8_t out[128];

namespace {

using Receiver = enterprize::Receiver<enterprize::FromMcu>;

struct Handler {
  /// As firmware has it: in another file, so that the whole message must be there.
  __attribute__((noinline)) void on(const enterprize::FieldMsg& message) { take(&message); }
  __attribute__((noinline)) void on(const enterprize::SentryGimbalMsg& message) { take(&message); }
  void on(const enterprize::GimbalMsg&) { ++others; }
  void on(const enterprize::ChassisMsg&) { ++others; }

  void take(const void* message) {
    seen = message;
    forget_memory();
    ++calls;
  }

  std::uint32_t calls = 0;
  std::uint32_t others = 0;
  const void* seen = nullptr;
};

/// Keeps what it is handed, and encodes it.
struct Echo {
  void on(const enterprize::FieldMsg& message) {
    field = message;
    static_cast<void>(encode(message, out, sizeof out, size));
  }
  void on(const enterprize::SentryGimbalMsg& message) {
    sentry_gimbal = message;
    static_cast<void>(encode(message, out, sizeof out, size));
  }

  enterprize::FieldMsg field;
  enterprize::SentryGimbalMsg sentry_gimbal;
  std::size_t size = 0;
};

Handler handler;
Echo echo;

template <class Message>
std::size_t encode_times(const Message& message, std::uint32_t times) {
  std::size_t size = 0;
  for (std::uint32_t i = 0; i < times; ++i) {
    forget_memory();
    if (encode(message, out, Message::Info::max_frame_bytes, size) != wirebond::Status::ok) return 0;
  }
  return size;
}

}  // namespace

std::uint32_t receive(std::uint32_t frames) {
  static Receiver receiver;
  const std::uint32_t before = handler.calls;
  std::uint32_t now_us = 0;
  feed_frames(frames,
              [&](const std::uint8_t* bytes, std::size_t size) { receiver.feed(bytes, size, ++now_us, handler); });
  return handler.calls - before;
}

std::uint32_t receive_and_encode(std::uint32_t place) {
  Receiver receiver;
  echo.size = 0;
  feed_place(place, [&](const std::uint8_t* bytes, std::size_t size) { receiver.feed(bytes, size, 0, echo); });
  return static_cast<std::uint32_t>(echo.size);
}

std::uint32_t encode_again(Which message, std::uint32_t times) {
  if (receive_and_encode(0) == 0) return 0;
  const std::size_t size =
      message == Which::field ? encode_times(echo.field, times) : encode_times(echo.sentry_gimbal, times);
  return static_cast<std::uint32_t>(size);
}
