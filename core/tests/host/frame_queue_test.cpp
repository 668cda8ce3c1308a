// The host's queue against a list, and how much of the line may lie in a driver.
#include "wirebond/host/frame_queue.hpp"

#include <doctest/doctest.h>

#include <cstdint>
#include <deque>
#include <random>
#include <vector>

#include "wirebond/host/pacing.hpp"

using wirebond::FrameQueue;
using wirebond::Pacing;
using wirebond::QueuedFrame;

namespace {

struct Model {
  std::int16_t message;
  std::vector<std::uint8_t> bytes;
};

/// Takes every frame of `message` out of the list; how many bytes and frames that were.
std::size_t drop(std::deque<Model>& model, std::int16_t message, std::size_t& used) {
  std::size_t dropped = 0;
  for (auto at = model.begin(); at != model.end();) {
    if (at->message != message) {
      ++at;
      continue;
    }
    used -= at->bytes.size();
    at = model.erase(at);
    ++dropped;
  }
  return dropped;
}

}  // namespace

TEST_CASE("the queue holds what a list holds, whatever is dropped from its middle") {
  std::mt19937 random(1);
  const auto draw = [&](unsigned below) { return static_cast<unsigned>(random() % below); };
  for (int round = 0; round < 200; ++round) {
    const std::size_t byte_capacity = 1 + draw(64);
    const std::size_t frame_capacity = 1 + draw(12);
    std::vector<std::uint8_t> bytes(byte_capacity);
    std::vector<QueuedFrame> frames(frame_capacity);
    FrameQueue queue(bytes.data(), bytes.size(), frames.data(), frames.size());
    std::deque<Model> model;
    std::size_t used = 0;
    for (int step = 0; step < 300; ++step) {
      const unsigned what = draw(4);
      const auto message = static_cast<std::int16_t>(draw(3));
      if (what < 2) {
        Model next{message, std::vector<std::uint8_t>(draw(20))};
        for (auto& byte : next.bytes) byte = static_cast<std::uint8_t>(random());
        const bool fits = used + next.bytes.size() <= byte_capacity && model.size() < frame_capacity;
        const QueuedFrame frame{static_cast<std::uint32_t>(next.bytes.size()), next.message, -1, 0};
        REQUIRE(queue.push(frame, next.bytes.data()) == fits);
        if (!fits) continue;
        used += next.bytes.size();
        model.push_back(next);
      } else if (what == 2 && !model.empty()) {
        used -= model.front().bytes.size();
        model.pop_front();
        queue.pop();
      } else {
        const std::size_t dropped = drop(model, message, used);
        REQUIRE(queue.drop([&](const QueuedFrame& frame) { return frame.message == message; }) == dropped);
      }
      REQUIRE(queue.size() == model.size());
      REQUIRE(queue.bytes() == used);
      if (model.empty()) continue;
      std::vector<std::uint8_t> front(queue.front().size);
      queue.copy_front(front.data());
      REQUIRE(front == model.front().bytes);
      REQUIRE(queue.front().message == model.front().message);
    }
  }
}

TEST_CASE("the line's time of what was handed over is exact over many frames") {
  Pacing pacing(115200, 10);
  std::uint64_t now = 1'000'000;
  for (int i = 0; i < 1'000'000; ++i) {
    pacing.written(11, now);
    now = pacing.begins_at_us(11, now);
  }
  const double end_us = static_cast<double>(now + pacing.waiting_us(now)) - 1e6;
  CHECK(end_us == doctest::Approx(11e6 * 10 / 115200 * 1e6).epsilon(1e-6));
}

TEST_CASE("a frame may go where at most 5 ms lie before its end, a longer one behind the last millisecond") {
  Pacing pacing(100'000, 10);  // 100 us a byte
  CHECK(pacing.may_begin(50, 0));
  pacing.written(40, 0);  // 4 ms
  CHECK(pacing.may_begin(10, 0));
  CHECK_FALSE(pacing.may_begin(11, 0));
  CHECK(pacing.begins_at_us(11, 0) == 100);
  CHECK(pacing.begins_at_us(1, 2'000) == 2'000);
  CHECK_FALSE(pacing.may_begin(200, 2'999));
  CHECK(pacing.may_begin(200, 3'000));
  CHECK(pacing.begins_at_us(200, 0) == 3'000);
}

TEST_CASE("a driver that holds more than was worked out delays, one that holds less shortens nothing") {
  Pacing pacing(100'000, 10);
  pacing.written(10, 0);
  pacing.driver_holds(50, 1'000);
  CHECK(pacing.waiting_us(1'000) == 5'000);
  pacing.driver_holds(0, 2'000);
  CHECK(pacing.waiting_us(2'000) == 4'000);
  Pacing not_paced;
  not_paced.written(1'000'000, 0);
  not_paced.driver_holds(1'000'000, 0);
  CHECK(not_paced.may_begin(1'000'000, 0));
}
