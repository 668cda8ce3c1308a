// The clock service on the simulated UART, with a poll every 10 ms: how wrong the offset is that a host finds from one
// exchange.
#pragma once

#include <cstdint>
#include <cstdlib>
#include <optional>
#include <stdexcept>
#include <vector>

#include "native_link.hpp"
#include "wirebond/fake/uart.hpp"

namespace clock_exchange {

namespace fake = wirebond::fake;

struct Arm {
  void stop() {}
};

struct Replies {
  void on(const native::ClockReply& message) { reply = message; }
  std::optional<native::ClockReply> reply;
};

/// Microseconds by which the offset is wrong that a host finds from one exchange; it knows the line's own time.
struct Exchanges {
  std::int64_t worst_us = 0;
  int with_different_times = 0;
};

/// `count` times a host asks for the MCU's time, with or without another request behind it. `std::runtime_error`
/// where there is no answer.
template <class Port>
Exchanges exchange(int count, bool with_others) {
  constexpr fake::Time poll_every = 10'000'000;
  constexpr std::uint32_t ahead_us = 0xFFFF0000;  // of the host's clock, which begins at 0; it wraps
  fake::Line in{native::baud, 10};
  fake::Line out{native::baud, 10};
  fake::Behaviour habits;
  habits.interrupt_delay = 4'000;
  habits.restart_gap = 3'000;
  Port uart{in, out, habits};
  if constexpr (wirebond::detail::HasClock<Port>::value) uart.clock_start_us = ahead_us;
  Arm arm;
  native::McuBuffers<1024, 512> buffers;
  native::McuLink<Arm, Port, decltype(buffers)> link{arm, uart, buffers};
  native::Receiver<native::FromMcu> receiver;
  Replies replies;
  fake::Draw draw(9);
  fake::Time now = 0;
  std::size_t read = 0;
  const auto poll = [&] {
    uart.run(now += poll_every, link);
    link.poll(ahead_us + static_cast<std::uint32_t>(now / 1000));
  };
  const auto put = [&](const auto& message, fake::Time at) {
    std::uint8_t frame[64];
    std::size_t size = 0;
    if (native::encode(message, frame, sizeof frame, size) != wirebond::Status::ok)
      throw std::runtime_error("no frame");
    return in.put(frame, size, at);
  };
  Exchanges found;
  for (int i = 0; i < 20; ++i) poll();
  for (int i = 0; i < count; ++i) {
    const fake::Time asked = put(native::ClockRequest{1}, now + draw.below(8'000'000));  // its last bit is on the line
    if (with_others) put(native::Ping{7}, asked + 500'000);
    poll();
    poll();
    const std::vector<std::uint8_t> bytes = out.read(now);
    fake::Time begun = 0;
    for (const std::uint8_t byte : bytes) {
      const std::uint32_t before = receiver.account().frame_bytes;
      receiver.feed(&byte, 1, 0, replies);
      const fake::Time end = out.bytes()[read++].end;
      if (replies.reply && begun == 0) begun = end - (receiver.account().frame_bytes - before) * out.byte_time();
    }
    if (!replies.reply) throw std::runtime_error("the clock does not answer");
    const auto since_start = [&](std::uint64_t us) {
      return static_cast<std::int32_t>(static_cast<std::uint32_t>(us) - ahead_us);
    };
    const std::int64_t forth_us = since_start(replies.reply->received_us) - static_cast<std::int64_t>(asked / 1000);
    const std::int64_t back_us = since_start(replies.reply->sent_us) - static_cast<std::int64_t>(begun / 1000);
    const std::int64_t wrong_us = std::abs(forth_us + back_us) / 2;
    found.worst_us = wrong_us > found.worst_us ? wrong_us : found.worst_us;
    found.with_different_times += replies.reply->received_us != replies.reply->sent_us;
    replies.reply.reset();
  }
  return found;
}

}  // namespace clock_exchange
