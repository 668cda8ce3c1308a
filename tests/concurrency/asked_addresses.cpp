// Threads that note requests to servos while another one receives answers: an answer of a servo that is asked again and
// again is taken, and one of a servo that nobody asks is not. Exit code 1, with a line, where that does not hold.
#include "wirebond/mcu/asked_addresses.hpp"

#include <atomic>
#include <cstdint>
#include <cstdio>
#include <thread>
#include <vector>

#include "servo_bus.hpp"
#include "wirebond/mcu/atomics.hpp"

namespace {

using Replies = wirebond::AskedAddresses<servo_bus::FromMcu, wirebond::DefaultAtomics>;
using Receiver = wirebond::Receiver<servo_bus::FromMcu, std::uint32_t, wirebond::ByteAccount<std::uint32_t>, Replies>;

constexpr std::uint8_t threads = 3, asked_by_all = 200, asked_by_nobody = 201;
constexpr std::uint8_t asked_by_each = 20;  // so that pairs are forgotten all the time
constexpr int answers = 20'000;

struct Host {
  void on(const servo_bus::Pose&, const servo_bus::Header& header) { (header.servo == asked_by_all ? right : wrong)++; }
  int right = 0, wrong = 0;
};

void receive(Receiver& receiver, Host& host, std::uint8_t servo) {
  servo_bus::Header header;
  header.servo = servo;
  std::uint8_t frame[servo_bus::Pose::Info::max_frame_bytes];
  std::size_t size = 0;
  if (encode(servo_bus::Pose{}, header, frame, sizeof frame, size) != wirebond::Status::ok) return;
  receiver.feed(frame, size, 0, host);
}

}  // namespace

int main() {
  constexpr std::int16_t reply = servo_bus::Read::Info::reply;
  Receiver receiver;
  Host host;
  receiver.replies().asks(reply, asked_by_all);
  std::atomic<bool> is_over{false};
  std::vector<std::thread> askers;
  for (std::uint8_t thread = 0; thread < threads; ++thread) {
    askers.emplace_back([&, thread] {
      for (unsigned i = 0; !is_over.load(std::memory_order_relaxed); ++i) {
        receiver.replies().asks(reply, asked_by_all);
        receiver.replies().asks(reply, static_cast<std::uint8_t>(thread * asked_by_each + i % asked_by_each));
        if (i % 64 == 0) std::this_thread::yield();
      }
    });
  }
  for (int i = 0; i < answers; ++i) {
    receive(receiver, host, asked_by_all);
    receive(receiver, host, asked_by_nobody);
  }
  is_over = true;
  for (std::thread& asker : askers) asker.join();
  std::printf("right %d wrong %d foreign %u\n", host.right, host.wrong, unsigned{receiver.foreign()});
  return host.right == answers && host.wrong == 0 ? 0 : 1;
}
