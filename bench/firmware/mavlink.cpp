// MAVLink's generated C on a Cortex-M4, with the same messages as wirebond.cpp; see ring.hpp.
#include <cstring>

#define MAVLINK_COMM_NUM_BUFFERS 1
#include "enterprize/mavlink.h"
#include "ring.hpp"

std::uint8_t ring[ring_bytes];
std::uint32_t frame_bytes[places];
std::uint8_t out[128];

namespace {

constexpr std::uint8_t system_id = 1;
constexpr std::uint8_t component_id = 1;

struct Handler {
  __attribute__((noinline)) void on(const mavlink_field_msg_t& message) { take(&message); }
  __attribute__((noinline)) void on(const mavlink_sentry_gimbal_msg_t& message) { take(&message); }

  void take(const void* message) {
    seen = message;
    forget_memory();
    ++calls;
  }

  std::uint32_t calls = 0;
  const void* seen = nullptr;
};

std::uint32_t encode(const mavlink_field_msg_t& message) {
  mavlink_message_t frame;
  mavlink_msg_field_msg_encode(system_id, component_id, &frame, &message);
  return mavlink_msg_to_send_buffer(out, &frame);
}

std::uint32_t encode(const mavlink_sentry_gimbal_msg_t& message) {
  mavlink_message_t frame;
  mavlink_msg_sentry_gimbal_msg_encode(system_id, component_id, &frame, &message);
  return mavlink_msg_to_send_buffer(out, &frame);
}

/// Keeps what it is handed, and encodes it as the first frame of a link.
struct Echo {
  void on(const mavlink_field_msg_t& message) {
    field = message;
    mavlink_get_channel_status(MAVLINK_COMM_0)->current_tx_seq = 0;
    size = encode(message);
  }
  void on(const mavlink_sentry_gimbal_msg_t& message) {
    sentry_gimbal = message;
    mavlink_get_channel_status(MAVLINK_COMM_0)->current_tx_seq = 0;
    size = encode(message);
  }

  mavlink_field_msg_t field;
  mavlink_sentry_gimbal_msg_t sentry_gimbal;
  std::uint32_t size = 0;
};

Handler handler;
Echo echo;

template <class AnyHandler>
void feed(const std::uint8_t* bytes, std::size_t size, AnyHandler& to) {
  static mavlink_message_t message;
  static mavlink_status_t status;
  for (std::size_t i = 0; i < size; ++i) {
    if (mavlink_parse_char(MAVLINK_COMM_0, bytes[i], &message, &status) == 0) continue;
    switch (message.msgid) {
      case MAVLINK_MSG_ID_FIELD_MSG: {
        mavlink_field_msg_t found;
        mavlink_msg_field_msg_decode(&message, &found);
        to.on(found);
        break;
      }
      case MAVLINK_MSG_ID_SENTRY_GIMBAL_MSG: {
        mavlink_sentry_gimbal_msg_t found;
        mavlink_msg_sentry_gimbal_msg_decode(&message, &found);
        to.on(found);
        break;
      }
      default: break;
    }
  }
}

}  // namespace

std::uint32_t receive(std::uint32_t frames) {
  const std::uint32_t before = handler.calls;
  feed_frames(frames, [](const std::uint8_t* bytes, std::size_t size) { feed(bytes, size, handler); });
  return handler.calls - before;
}

std::uint32_t receive_and_encode(std::uint32_t place) {
  echo.size = 0;
  feed_place(place, [](const std::uint8_t* bytes, std::size_t size) { feed(bytes, size, echo); });
  return echo.size;
}

std::uint32_t encode_again(Which message, std::uint32_t times) {
  std::uint32_t size = receive_and_encode(0);
  for (std::uint32_t i = 0; i < times && size != 0; ++i) {
    forget_memory();
    size = message == Which::field ? encode(echo.field) : encode(echo.sentry_gimbal);
  }
  return size;
}
