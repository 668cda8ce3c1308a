// What a link answers by itself: hello, ping, clock, log lines, parameters.
#include "wirebond/mcu/services.hpp"

#include <doctest/doctest.h>

#include <array>
#include <cstdint>
#include <string>
#include <vector>

#include "native_link.hpp"
#include "scripted_port.hpp"

namespace {

struct Arm {
  void stop() {}
  auto& parameters() { return table; }
  void parameter_set(std::size_t index, float) { stored.push_back(index); }

  static constexpr std::array<wirebond::ParameterRule, 2> rules = {{{0.0F, 10.0F, 1.0F}, {-1.0F, 1.0F, 0.5F}}};
  wirebond::Parameters<2> table{rules};
  std::vector<std::size_t> stored;
};

/// What the host's end decodes.
struct Host {
  void on(const native::Hello& message) { hellos.push_back(message.protocol_hash); }
  void on(const native::Pong& message) { pongs.push_back(message.number); }
  void on(const native::ClockReply& message) { clocks.push_back(message); }
  void on(const native::Log& message) { lines.emplace_back(message.text.view()); }
  void on(const native::ParameterValue& message) { values.push_back(message); }

  std::vector<std::uint64_t> hellos;
  std::vector<std::uint32_t> pongs;
  std::vector<native::ClockReply> clocks;
  std::vector<std::string> lines;
  std::vector<native::ParameterValue> values;
};

template <class Handler>
struct Bench {
  template <class Message>
  void ask(const Message& message) {
    std::array<std::uint8_t, Message::Info::max_frame_bytes> frame;
    std::size_t size = 0;
    REQUIRE(native::encode(message, frame.data(), frame.size(), size) == wirebond::Status::ok);
    port.arrive(Bytes(frame.data(), frame.data() + size));
    link.on_received();
    exchange();
  }

  void exchange() {
    now_us += ms;
    link.poll(now_us);
    if (port.pended) link.on_pended();
    port.pended = false;
    while (!port.run.empty()) {
      const Bytes run = port.run;
      port.run.clear();
      receiver.feed(run.data(), run.size(), now_us, host);
      link.on_transmitted();
    }
  }

  std::uint32_t now_us = 0;
  ScriptedPort port;
  Handler arm;
  Host host;
  native::Receiver<native::FromMcu> receiver;
  native::McuBuffers<256, 512> buffers;
  native::McuLink<Handler, ScriptedPort, decltype(buffers)> link{arm, port, buffers};
};

}  // namespace

TEST_CASE("hello is said at the start and answered, and a peer of another file is told apart") {
  Bench<Arm> bench;
  bench.exchange();
  CHECK(bench.host.hellos == std::vector<std::uint64_t>{native::protocol_hash});
  CHECK(bench.link.peer() == wirebond::Peer::unknown);
  bench.ask(native::Hello{native::protocol_hash, 1});
  CHECK(bench.link.peer() == wirebond::Peer::same);
  CHECK(bench.host.hellos.size() == 2);
  bench.ask(native::Hello{native::protocol_hash + 1, 1});
  CHECK(bench.link.peer() == wirebond::Peer::different);
}

TEST_CASE("pings come back with their number, clock requests with the time at this end") {
  Bench<Arm> bench;
  bench.exchange();
  bench.ask(native::Ping{0xFEDCBA98u});
  CHECK(bench.host.pongs == std::vector<std::uint32_t>{0xFEDCBA98u});
  bench.ask(native::ClockRequest{123456789012u});
  REQUIRE(bench.host.clocks.size() == 1);
  CHECK(bench.host.clocks[0].host_us == 123456789012u);
  CHECK(bench.host.clocks[0].received_us == bench.now_us);
}

TEST_CASE("log lines are cut to what their message holds") {
  Bench<Arm> bench;
  bench.exchange();
  CHECK(bench.link.log(wirebond::Level::info, "motor 2 is warm") == wirebond::Status::ok);
  CHECK(bench.link.log(wirebond::Level::error, std::string(100, 'x')) == wirebond::Status::ok);
  bench.exchange();
  CHECK(bench.host.lines == std::vector<std::string>{"motor 2 is warm", std::string(48, 'x')});
}

TEST_CASE("a flood of log lines takes half of the send queue, and no other message is refused for it") {
  struct Arm {
    void stop() {}
    bool fill(native::State&) { return true; }
  };
  Bench<Arm> bench;
  bench.exchange();
  std::uint32_t taken = 0;
  std::uint32_t refused = 0;
  for (int i = 0; i < 2'000; ++i) {
    for (int line = 0; line < 5; ++line) {
      const bool is_taken =
          bench.link.log(wirebond::Level::info, "encoder " + std::to_string(i)) == wirebond::Status::ok;
      ++(is_taken ? taken : refused);
    }
    for (int status = 0; status < 2; ++status) CHECK(bench.link.send(native::Pong{7}) == wirebond::Status::ok);
    bench.now_us += ms;  // the line takes one run in a millisecond, which is what is sent, without the log lines
    bench.link.poll(bench.now_us);
    if (bench.port.pended) bench.link.on_pended();
    bench.port.pended = false;
    bench.link.on_transmitted();
  }
  CHECK(taken > 100);
  CHECK(refused > 1'000);
  const wirebond::SendAccount account = bench.link.send_account();
  CHECK(account.refused() == refused);
  CHECK(account.balances());
}

TEST_CASE("a log line that finds the send queue empty is taken, however long it is") {
  Bench<Arm> bench;
  for (int i = 0; i < 100; ++i) {
    bench.exchange();
    CHECK(bench.link.log(wirebond::Level::info, std::string(48, 'x')) == wirebond::Status::ok);
  }
}

TEST_CASE("parameters are read, set within their range, and stored by the hook") {
  Bench<Arm> bench;
  bench.exchange();
  using Result = native::ParameterValue::Result;
  bench.ask(native::ParameterRead{0});
  bench.ask(native::ParameterSet{1, -0.25F});
  bench.ask(native::ParameterSet{1, 2.0F});
  bench.ask(native::ParameterSet{7, 0.0F});
  REQUIRE(bench.host.values.size() == 4);
  CHECK(bench.host.values[0].value == 1.0F);
  CHECK(bench.host.values[1].value == -0.25F);
  CHECK(bench.host.values[1].result == Result::ok);
  CHECK(bench.host.values[2].value == -0.25F);
  CHECK(bench.host.values[2].result == Result::out_of_range);
  CHECK(bench.host.values[3].result == Result::no_such_index);
  CHECK(bench.arm.stored == std::vector<std::size_t>{1});
  CHECK(bench.arm.parameters()[1] == -0.25F);
}

TEST_CASE("a handler without parameters has none: the request is answered all the same") {
  struct Bare {
    void stop() {}
  };
  Bench<Bare> bench;
  bench.exchange();
  bench.ask(native::ParameterRead{0});
  bench.ask(native::ParameterSet{1, 0.5F});
  REQUIRE(bench.host.values.size() == 2);
  CHECK(bench.host.values[0].result == native::ParameterValue::Result::no_such_index);
  CHECK(bench.host.values[1].index == 1);
  CHECK(bench.host.values[1].result == native::ParameterValue::Result::no_such_index);
}
