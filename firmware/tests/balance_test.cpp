// The balance bot against its simulated body, over a simulated UART.
#include "balance.hpp"

#include <doctest/doctest.h>

#include <cmath>
#include <cstdint>
#include <vector>

#include "body.hpp"
#include "wirebond/fake/line.hpp"
#include "wirebond/fake/uart.hpp"

namespace {

namespace fake = wirebond::fake;

template <class Body>
struct Bench {
  float pitch_rad() const { return body.pitch_rad(); }
  float pitch_rate_rad_s() const { return body.pitch_rate_rad_s(); }
  float speed_m_s() const { return body.speed_m_s(); }
  void set_motors(float left, float right) {
    output = left;
    body.set_motors(left, right);
  }

  Body body;
  float output = 99.0F;  // neither end of the range: the firmware must set it
};

/// The firmware on a simulated UART, and the frames that a host at the other end receives.
template <class Body = balance::Body>
struct Bot {
  fake::Line in{pid_tuner::baud, 10};
  fake::Line out{pid_tuner::baud, 10};
  fake::Uart uart{in, out};
  fake::Time now = 0;
  Bench<Body> bench;
  balance::Buffers buffers{};
  balance::Balance<Bench<Body>, fake::Uart> firmware{bench, uart, buffers};
  pid_tuner::Receiver<pid_tuner::FromMcu> receiver;
  std::vector<pid_tuner::Acknowledge> answers;
  pid_tuner::Gains gains{};
  pid_tuner::Attitude attitude{};
  pid_tuner::Motors motors{99.0F, 99.0F};

  void on(const pid_tuner::Acknowledge& message) { answers.push_back(message); }
  void on(const pid_tuner::Gains& message) { gains = message; }
  void on(const pid_tuner::Attitude& message) { attitude = message; }
  void on(const pid_tuner::Motors& message) { motors = message; }

  void run(float seconds) {
    for (int left_ms = static_cast<int>(std::lround(seconds * 1e3F)); left_ms > 0; --left_ms) {
      bench.body.step(1e-3F);
      now += 1'000'000;
      uart.run(now, firmware.link());
      firmware.poll(static_cast<std::uint32_t>(now / 1000));
      const std::vector<std::uint8_t> bytes = out.read(now);
      receiver.feed(bytes.data(), bytes.size(), static_cast<std::uint32_t>(now / 1000), *this);
      in.forget();
      out.forget();
    }
  }
  /// Let the frame travel, and its answer.
  template <class Message>
  void send(const Message& message) {
    std::uint8_t frame[Message::Info::max_frame_bytes];
    std::size_t size = 0;
    REQUIRE(pid_tuner::encode(message, frame, sizeof frame, size) == wirebond::Status::ok);
    in.put(frame, size, now);
    run(0.01F);
  }
  void tune() {
    run(0.001F);  // the first poll starts the link
    send(pid_tuner::Pid{0, 10.0F, 0.1F, 0.3F});
    send(pid_tuner::Pid{1, 0.2F, 0.0F, 0.0F});
  }
  pid_tuner::Gains read(std::uint8_t index) {
    send(pid_tuner::ReadGains{index});
    return gains;
  }
};

using Result = pid_tuner::Acknowledge::Result;

}  // namespace

TEST_CASE("the motors rest until gains have come, and the body falls") {
  Bot<> bot;
  CHECK(bot.bench.output == 0.0F);
  bot.run(3.0F);
  CHECK(bot.bench.output == 0.0F);
  CHECK(std::fabs(bot.bench.body.pitch_rad()) > balance::fallen_rad);
}

TEST_CASE("tuned, it stands still, and withstands a push") {
  Bot<> bot;
  bot.tune();
  bot.run(5.0F);
  bot.bench.body.push(1.0F);
  bot.run(15.0F);
  CHECK(std::fabs(bot.bench.body.pitch_rad()) < 0.01F);
  CHECK(std::fabs(bot.bench.body.speed_m_s()) < 0.05F);
}

TEST_CASE("the motors stop when gains change, and it goes on standing with the new ones") {
  Bot<> bot;
  bot.tune();
  bot.run(0.5F);
  bot.bench.body.push(1.0F);
  bot.run(0.02F);
  REQUIRE(bot.bench.output != 0.0F);
  for (const std::uint8_t index : {std::uint8_t{0}, std::uint8_t{1}}) {
    bot.run(0.02F);
    REQUIRE(bot.bench.output != 0.0F);
    bot.firmware.on(index == 0 ? pid_tuner::Pid{0, 12.0F, 0.1F, 0.4F} : pid_tuner::Pid{1, 0.18F, 0.0F, 0.0F});
    CHECK(bot.bench.output == 0.0F);
  }
  bot.run(15.0F);
  CHECK(std::fabs(bot.bench.body.pitch_rad()) < 0.01F);
}

TEST_CASE("of the outer loop, i is p/200 whatever is sent") {
  Bot<> bot;
  bot.run(0.001F);
  bot.send(pid_tuner::Pid{1, 50.0F, 7.0F, 7.0F});
  const pid_tuner::Gains gains = bot.read(1);
  CHECK(gains.p == 50.0F);
  CHECK(gains.i == 0.25F);
  CHECK(gains.d == 0.0F);
  bot.send(pid_tuner::Pid{0, 50.0F, 7.0F, 6.0F});
  CHECK(bot.read(0).i == 7.0F);
  CHECK(bot.read(0).d == 6.0F);
}

TEST_CASE("each change is answered, and what is refused changes nothing") {
  Bot<> bot;
  bot.tune();
  bot.send(pid_tuner::Pid{2, 1.0F, 1.0F, 1.0F});
  bot.send(pid_tuner::Pid{0, 1001.0F, 0.0F, 0.0F});
  bot.send(pid_tuner::ReadGains{2});
  const std::vector<Result> results = {Result::accepted, Result::accepted, Result::unknown_index, Result::out_of_range,
                                       Result::unknown_index};
  REQUIRE(bot.answers.size() == results.size());
  for (std::size_t i = 0; i < results.size(); ++i) CHECK(bot.answers[i].result == results[i]);
  CHECK(bot.answers.back().of == pid_tuner::ReadGains::Info::id);
  CHECK(bot.read(0).p == 10.0F);
}

TEST_CASE("fallen, its motors rest until somebody puts it up") {
  Bot<> bot;
  bot.tune();
  bot.bench.body.push(20.0F);
  bot.run(2.0F);
  CHECK(bot.bench.output == 0.0F);
  bot.bench.body.put_up();
  bot.run(0.1F);
  bot.bench.body.push(0.1F);
  bot.run(10.0F);
  CHECK(std::fabs(bot.bench.body.pitch_rad()) < 0.01F);
}

TEST_CASE("in a person's hand, it stands once it is tuned, also after it fell at full speed") {
  Bot<balance::HeldBody> bot;
  bot.run(0.001F);
  bot.send(pid_tuner::Pid{0, 10.0F, 0.1F, 0.3F});
  // Without the outer loop it runs away, until its wheels can turn no faster.
  float largest_rad = 0.0F;
  for (int ms = 0; ms < 20'000; ++ms) {
    bot.run(0.001F);
    largest_rad = std::fmax(largest_rad, std::fabs(bot.bench.body.pitch_rad()));
  }
  REQUIRE(largest_rad > balance::fallen_rad);
  bot.send(pid_tuner::Pid{1, 0.2F, 0.0F, 0.0F});
  bot.run(15.0F);
  CHECK(std::fabs(bot.bench.body.pitch_rad()) < 0.01F);
}

TEST_CASE("what it sends at its rhythm is what the loops see and put out") {
  Bot<> bot;
  bot.tune();
  bot.run(0.5F);
  bot.bench.body.push(1.0F);
  bot.run(0.1F);
  CHECK(bot.attitude.pitch != 0.0F);
  CHECK(std::fabs(bot.attitude.pitch - bot.bench.body.pitch_rad()) < 0.05F);
  CHECK(bot.motors.left != 0.0F);
  CHECK(std::fabs(bot.motors.left - bot.bench.output) < 0.5F);
  CHECK(bot.motors.right == bot.motors.left);
}

TEST_CASE("control comes every 5 ms of its clock, also while that wraps and after a pause") {
  struct Counter {
    float pitch_rad() { return ++steps, 0.0F; }
    float pitch_rate_rad_s() const { return 0.0F; }
    float speed_m_s() const { return 0.0F; }
    void set_motors(float, float) {}
    int steps = 0;
  } board;
  fake::Line line{pid_tuner::baud, 10};
  fake::Uart uart{line, line};
  balance::Buffers buffers{};
  balance::Balance<Counter, fake::Uart> firmware(board, uart, buffers);
  std::uint32_t now_us = 0xFFFF'0000U;
  firmware.poll(now_us);
  board.steps = 0;
  for (int ms = 0; ms < 200; ++ms) firmware.poll(now_us += 1000);
  CHECK(board.steps == 40);
  firmware.poll(now_us += 100'000);
  CHECK(board.steps == 41);
  for (int ms = 0; ms < 4; ++ms) firmware.poll(now_us += 1000);
  CHECK(board.steps == 41);
  firmware.poll(now_us += 1000);
  CHECK(board.steps == 42);
}
