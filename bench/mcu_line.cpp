// The MCU's link on the simulated UART of ports/fake: the clock service, and a line with an error in one of 100 bytes.
// Prints one object of JSON.
#include <cstdint>
#include <cstdio>

#include "clock_exchange.hpp"
#include "native_link.hpp"
#include "wirebond/fake/uart.hpp"

namespace fake = wirebond::fake;

namespace {

struct Arm {
  void on(const native::Ping& ping) { last = ping.number; }
  void stop() {}

  std::uint32_t last = 0;
};

struct BadLine {
  unsigned whole = 0;  ///< frames whose bytes all came as they were sent
  unsigned lost = 0;   ///< of these, not delivered
  unsigned restarts = 0;
};

BadLine on_a_bad_line(std::uint32_t frames) {
  fake::Line in{native::baud, 10};
  fake::Line out{native::baud, 10};
  in.faults = {4'000, 3'000, 3'000, 0};  // of a million bytes: framing, noise, overrun
  fake::Behaviour habits;
  habits.on_line_error = fake::OnLineError::flag;
  fake::Uart uart{in, out, habits};
  Arm arm;
  native::McuBuffers<1024, 512> buffers;
  native::McuLink<Arm, fake::Uart, decltype(buffers)> link{arm, uart, buffers};
  BadLine found;
  fake::Time now = 0;
  const auto pass = [&] {
    uart.run(now += 1'000'000, link);
    link.poll(static_cast<std::uint32_t>(now / 1000));
  };
  for (int i = 0; i < 10; ++i) pass();
  for (std::uint32_t number = 1; number <= frames; ++number) {
    std::uint8_t frame[native::Ping::Info::max_frame_bytes];
    std::size_t size = 0;
    if (native::encode(native::Ping{number}, frame, sizeof frame, size) != wirebond::Status::ok) return {};
    in.forget();
    in.put(frame, size, now);
    pass();
    pass();
    bool is_whole = true;
    for (const fake::LineByte& byte : in.bytes()) {
      is_whole = is_whole && byte.fate <= fake::Fate::damaged && byte.seen == byte.sent;
    }
    found.whole += is_whole ? 1 : 0;
    found.lost += is_whole && arm.last != number ? 1 : 0;
    out.forget();
  }
  found.restarts = link.counters().receive_restarts;
  return found;
}

}  // namespace

int main() {
  std::int64_t worst_us = 0;
  for (const bool with_others : {false, true}) {
    const auto found = clock_exchange::exchange<fake::ClockedUart>(1'000, with_others);
    worst_us = found.worst_us > worst_us ? found.worst_us : worst_us;
  }
  const auto without = clock_exchange::exchange<fake::Uart>(1'000, false);
  const BadLine line = on_a_bad_line(100'000);
  std::printf("{\"clock_offset_us\": %d, \"clock_offset_without_clock_us\": %d, ", static_cast<int>(worst_us),
              static_cast<int>(without.worst_us));
  std::printf("\"bad_line_lost\": %u, \"bad_line_frames\": %u, \"bad_line_restarts\": %u}\n", line.lost, line.whole,
              line.restarts);
  return line.whole == 0 ? 1 : 0;
}
