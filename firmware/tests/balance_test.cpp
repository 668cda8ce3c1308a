// The balance bot against its simulated body.
#include "balance.hpp"

#include <doctest/doctest.h>

#include <cmath>
#include <cstdint>
#include <vector>

#include "body.hpp"

namespace {

struct Bench {
  float pitch_rad() const { return body.pitch_rad(); }
  float pitch_rate_rad_s() const { return body.pitch_rate_rad_s(); }
  float speed_m_s() const { return body.speed_m_s(); }
  void set_motors(float left, float right) {
    output = left;
    body.set_motors(left, right);
  }
  wirebond::Status send(const pid_tuner::Acknowledge& message) {
    answers.push_back(message);
    return wirebond::Status::ok;
  }
  wirebond::Status send(const pid_tuner::Gains& message) {
    gains = message;
    return wirebond::Status::ok;
  }

  balance::Body body;
  float output = 99.0F;  // neither end of the range: the firmware must set it
  std::vector<pid_tuner::Acknowledge> answers;
  pid_tuner::Gains gains{};
};

struct Bot {
  Bench bench;
  balance::Balance<Bench> firmware{bench};

  void run(float seconds) {
    const int steps = static_cast<int>(seconds * 1e6F / static_cast<float>(balance::step_us));
    for (int i = 0; i < steps; ++i) {
      firmware.step();
      for (std::uint32_t ms = 0; ms < balance::step_us / 1000; ++ms) bench.body.step(1e-3F);
    }
  }
  void tune() {
    firmware.on(pid_tuner::Pid{0, 10.0F, 0.1F, 0.3F});
    firmware.on(pid_tuner::Pid{1, 0.2F, 0.0F, 0.0F});
  }
  pid_tuner::Gains read(std::uint8_t index) {
    firmware.on(pid_tuner::ReadGains{index});
    return bench.gains;
  }
};

using Result = pid_tuner::Acknowledge::Result;

}  // namespace

TEST_CASE("the motors rest until gains have come, and the body falls") {
  Bot bot;
  CHECK(bot.bench.output == 0.0F);
  bot.run(3.0F);
  CHECK(bot.bench.output == 0.0F);
  CHECK(std::fabs(bot.bench.body.pitch_rad()) > balance::fallen_rad);
}

TEST_CASE("tuned, it stands still, and withstands a push") {
  Bot bot;
  bot.tune();
  bot.run(5.0F);
  bot.bench.body.push(1.0F);
  bot.run(15.0F);
  CHECK(std::fabs(bot.bench.body.pitch_rad()) < 0.01F);
  CHECK(std::fabs(bot.bench.body.speed_m_s()) < 0.05F);
}

TEST_CASE("the motors stop when gains change, and it goes on standing with the new ones") {
  Bot bot;
  bot.tune();
  bot.run(0.5F);
  bot.bench.body.push(1.0F);
  bot.run(0.02F);
  REQUIRE(bot.bench.output != 0.0F);
  for (const std::uint8_t index : {std::uint8_t{0}, std::uint8_t{1}}) {
    bot.firmware.step();
    REQUIRE(bot.bench.output != 0.0F);
    bot.firmware.on(index == 0 ? pid_tuner::Pid{0, 12.0F, 0.1F, 0.4F} : pid_tuner::Pid{1, 0.18F, 0.0F, 0.0F});
    CHECK(bot.bench.output == 0.0F);
  }
  bot.run(15.0F);
  CHECK(std::fabs(bot.bench.body.pitch_rad()) < 0.01F);
}

TEST_CASE("of the outer loop, i is p/200 whatever is sent") {
  Bot bot;
  bot.firmware.on(pid_tuner::Pid{1, 50.0F, 7.0F, 7.0F});
  const pid_tuner::Gains gains = bot.read(1);
  CHECK(gains.p == 50.0F);
  CHECK(gains.i == 0.25F);
  CHECK(gains.d == 0.0F);
  bot.firmware.on(pid_tuner::Pid{0, 50.0F, 7.0F, 6.0F});
  CHECK(bot.read(0).i == 7.0F);
  CHECK(bot.read(0).d == 6.0F);
}

TEST_CASE("each change is answered, and what is refused changes nothing") {
  Bot bot;
  bot.tune();
  bot.firmware.on(pid_tuner::Pid{2, 1.0F, 1.0F, 1.0F});
  bot.firmware.on(pid_tuner::Pid{0, 1001.0F, 0.0F, 0.0F});
  bot.firmware.on(pid_tuner::ReadGains{2});
  const std::vector<Result> results = {Result::accepted, Result::accepted, Result::unknown_index, Result::out_of_range,
                                       Result::unknown_index};
  REQUIRE(bot.bench.answers.size() == results.size());
  for (std::size_t i = 0; i < results.size(); ++i) CHECK(bot.bench.answers[i].result == results[i]);
  CHECK(bot.bench.answers.back().of == pid_tuner::ReadGains::Info::id);
  CHECK(bot.read(0).p == 10.0F);
}

TEST_CASE("fallen, its motors rest until somebody puts it up") {
  Bot bot;
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

TEST_CASE("what it sends at its rhythm is what the loops see and put out") {
  Bot bot;
  bot.tune();
  bot.run(0.02F);
  pid_tuner::Attitude attitude;
  pid_tuner::Motors motors;
  REQUIRE(bot.firmware.fill(attitude));
  REQUIRE(bot.firmware.fill(motors));
  CHECK(std::fabs(attitude.pitch - bot.bench.body.pitch_rad()) < 0.05F);
  CHECK(motors.left == bot.bench.output);
  CHECK(motors.right == bot.bench.output);
}
