// Requests of the parameter service that break a rule of their own fields: they do not act, and are refused in words
// that the host understands.
#include <doctest/doctest.h>

#include <array>
#include <cstdint>
#include <vector>

#include "loose_link.hpp"
#include "scripted_port.hpp"
#include "tuned_link.hpp"
#include "wirebond/mcu/link.hpp"

namespace {

using wirebond::ParameterResult;

struct Gains {
  void on(const tuned::Set&) { sets += 1; }
  auto& parameters() { return table; }
  void parameter_set(std::size_t, float) { stored += 1; }

  static constexpr std::array<wirebond::ParameterRule, 3> rules = {{{0, 10, 1}, {0, 5, 2}, {0, 1, 0.5F}}};
  wirebond::Parameters<3> table{rules};
  int sets = 0;
  int stored = 0;
};

struct Host {
  void on(const tuned::Value& value) { values.push_back(value); }
  std::vector<tuned::Value> values;
};

struct Bench {
  Bench() { link.poll(now_us); }

  /// What a host asks whose file lacks the rules. Is it answered?
  template <class Message>
  bool ask(const Message& message, std::uint8_t to = 1) {
    std::array<std::uint8_t, Message::Info::max_frame_bytes> frame;
    std::size_t size = 0;
    loose::Header header;
    header.to = to;
    REQUIRE(loose::encode(message, header, frame.data(), frame.size(), size) == wirebond::Status::ok);
    port.arrive(Bytes(frame.data(), frame.data() + size));
    link.on_received();
    link.poll(now_us += ms);
    host.values.clear();
    if (port.pended) link.on_pended();
    port.pended = false;
    receiver.feed(port.run.data(), port.run.size(), now_us, host);
    if (!port.run.empty()) link.on_transmitted();
    port.run.clear();
    return host.values.size() == 1;
  }
  ParameterResult result() const { return static_cast<ParameterResult>(host.values.front().result); }

  std::uint32_t now_us = 0;
  ScriptedPort port;
  Gains gains;
  Host host;
  tuned::Receiver<tuned::FromMcu> receiver;
  tuned::McuBuffers<64, 64, 4> buffers;
  tuned::McuLink<Gains, ScriptedPort, decltype(buffers)> link{gains, port, buffers};
};

}  // namespace

TEST_CASE("a value that its field does not allow is refused, with the value that stays in force") {
  Bench bench;
  for (const float value : {11.0F, -1.0F}) {
    REQUIRE(bench.ask(loose::Set{1, value}));
    CHECK(bench.result() == ParameterResult::out_of_range);
    CHECK(bench.host.values.front().index == 1);
    CHECK(bench.host.values.front().value == 2.0F);
  }
  CHECK(bench.link.receiver().violations().rejected == 2);
  CHECK(bench.gains.sets + bench.gains.stored == 0);
  REQUIRE(bench.ask(loose::Set{1, 4.0F}));
  CHECK(bench.result() == ParameterResult::ok);
  CHECK(bench.gains.sets + bench.gains.stored == 2);
}

TEST_CASE("an index that its field does not allow is not a parameter, also where the table has it") {
  Bench bench;
  for (const std::uint8_t index : {std::uint8_t{2}, std::uint8_t{9}}) {
    REQUIRE(bench.ask(loose::Read{index}));
    CHECK(bench.result() == ParameterResult::no_such_index);
    CHECK(bench.host.values.front().index == index);
    REQUIRE(bench.ask(loose::Set{index, 0.25F}));
    CHECK(bench.result() == ParameterResult::no_such_index);
  }
  CHECK(bench.gains.parameters()[2] == 0.5F);
}

TEST_CASE("what is for all or for another is not answered, refused or not") {
  Bench bench;
  CHECK_FALSE(bench.ask(loose::Set{1, 11.0F}, 0xFF));
  CHECK_FALSE(bench.ask(loose::Set{1, 11.0F}, 7));
}
