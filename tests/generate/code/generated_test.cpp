// Generated code at work: what encodes, what is refused, what reaches a handler. For the protocols of the repository
// and every_type.yaml.
#define DOCTEST_CONFIG_IMPLEMENT_WITH_MAIN
#include <doctest/doctest.h>

#include <cmath>
#include <cstdint>
#include <cstring>
#include <limits>
#include <vector>

#include "diffdrive.hpp"
#include "enterprize.hpp"
#include "log.hpp"
#include "native.hpp"

using wirebond::Status;
using wirebond::Violation;
using Bytes = std::vector<std::uint8_t>;

namespace {

constexpr float not_a_number = std::numeric_limits<float>::quiet_NaN();
constexpr float infinity = std::numeric_limits<float>::infinity();

template <class Message>
Bytes frame_of(const Message& message) {
  Bytes out(Message::Info::max_frame_bytes);
  std::size_t size = 99;
  REQUIRE(encode(message, out.data(), out.size(), size) == Status::ok);
  out.resize(size);
  return out;
}

template <class Message>
Status status_of(const Message& message) {
  Bytes out(Message::Info::max_frame_bytes);
  std::size_t size = 99;
  const Status status = encode(message, out.data(), out.size(), size);
  CHECK((size == 0) == (status != Status::ok));
  return status;
}

template <class Message>
Message through_payload(const Message& message) {
  Bytes payload(payload_bytes(message));
  REQUIRE(write_payload(message, payload.data()));
  Message back;
  REQUIRE(decode(payload.data(), payload.size(), back));
  CHECK_FALSE(decode(payload.data(), Message::Info::min_payload_bytes - 1, back));
  return back;
}

}  // namespace

// ---- values ------------------------------------------------------------------------------------------------------

TEST_CASE("frames are the vectors' bytes, and their values come back as the very floats") {
  const diffdrive::Velocity velocity{0.3F, -3.14F};
  CHECK(frame_of(diffdrive::Velocity{0.5F, 0.0F}) ==
        Bytes{0xAA, 0x55, 0x01, 0xF4, 0x01, 0x00, 0x00, 0x00, 0x00, 0x0B, 0x0D});
  const diffdrive::Velocity back = through_payload(velocity);
  CHECK(back.linear == 0.3F);
  CHECK(back.angular == -3.14F);
  diffdrive::Status status;
  status.battery = 12.345F;
  status.errors = diffdrive::Status::Errors::right_motor | diffdrive::Status::Errors::low_battery;
  status.state = diffdrive::Status::State::charging;
  CHECK(frame_of(status) == Bytes{0xAA, 0x55, 0x82, 0x39, 0x30, 0x06, 0x02, 0x00, 0x00, 0x70, 0x0D});
}

TEST_CASE("every 16-bit value comes back from its SI value") {
  for (int wire = -2000; wire <= 2000; ++wire) {
    std::uint8_t payload[4] = {};
    wirebond::store(payload, static_cast<std::int16_t>(wire));
    diffdrive::Velocity velocity;
    REQUIRE(decode(payload, sizeof payload, velocity));
    std::uint8_t back[4] = {};
    REQUIRE(write_payload(velocity, back));
    REQUIRE(std::memcmp(payload, back, sizeof back) == 0);
  }
}

TEST_CASE("every type comes back") {
  log_protocol::Everything sent;
  sent.wide = 0xFFFFFF;
  sent.narrow = -8388608;
  sent.fine = -838.8608;
  sent.temperature = -12.5F;
  sent.ratio = -1.5F;
  sent.turns = 42949672.95;
  sent.ticks = std::numeric_limits<std::int64_t>::min();
  sent.doubled = 7.0F;
  sent.precise = -0.1;
  sent.mode = log_protocol::Everything::Mode::reverse;
  sent.gears = {log_protocol::Everything::Gears::second, log_protocol::Everything::Gears::first};
  sent.bits = log_protocol::Everything::Bits::highest;
  sent.switches = {true, false};
  sent.steps = {5, 7, 10};
  sent.limits = {-1.0F, 0.25F};
  sent.raw = {-2, 0x01020304};
  sent.angle = {0.0174533F, -1.047198F};
  sent.tag = {'x', 'y', 'z', '!'};
  sent.blob = {0, 255};
  REQUIRE(sent.note.assign("six by"));
  const log_protocol::Everything back = through_payload(sent);
  CHECK(back.wide == sent.wide);
  CHECK(back.narrow == sent.narrow);
  CHECK(back.fine == sent.fine);
  CHECK(back.temperature == sent.temperature);
  CHECK(back.ratio == sent.ratio);
  CHECK(back.turns == sent.turns);
  CHECK(back.ticks == sent.ticks);
  CHECK(back.doubled == sent.doubled);
  CHECK(back.precise == sent.precise);
  CHECK(back.mode == sent.mode);
  CHECK(back.gears == sent.gears);
  CHECK(back.bits == sent.bits);
  CHECK(back.switches == sent.switches);
  CHECK(back.steps == sent.steps);
  CHECK(back.limits == sent.limits);
  CHECK(back.raw == sent.raw);
  CHECK(std::fabs(back.angle[1] - sent.angle[1]) < 1e-5F);
  CHECK(back.tag == sent.tag);
  CHECK(back.blob == sent.blob);
  CHECK(back.note.view() == "six by");
  CHECK(violations(back) == Violation::none);
}

TEST_CASE("byte orders and sign extension are as the file says") {
  log_protocol::Everything message;
  message.wide = 0x010203;
  message.narrow = 0x010203;
  std::uint8_t payload[log_protocol::Everything::Info::max_payload_bytes];
  REQUIRE(write_payload(message, payload));
  CHECK(Bytes(payload, payload + 6) == Bytes{0x03, 0x02, 0x01, 0x01, 0x02, 0x03});
}

TEST_CASE("a message as it is constructed can be sent") {
  CHECK(status_of(log_protocol::Everything{}) == Status::ok);
  CHECK(status_of(log_protocol::InfoMessage{}) == Status::ok);
  CHECK(status_of(log_protocol::ReceiverMessage{}) == Status::ok);
  CHECK(status_of(log_protocol::FromHostMessage{}) == Status::ok);
  CHECK(status_of(log_protocol::ReceiverMessageMessage{}) == Status::ok);
  CHECK(status_of(native::Command{}) == Status::ok);
  CHECK(status_of(native::Log{}) == Status::ok);
  CHECK(status_of(enterprize::SentryGimbalMsg{}) == Status::ok);
  const log_protocol::Everything fresh;
  CHECK(fresh.mode == log_protocol::Everything::Mode::reverse);  // 0 is not a name: the first one
  CHECK(fresh.steps == std::array<std::uint16_t, 3>{5, 5, 5});   // 0 is out of range: the nearest value
  CHECK(fresh.note.view() == "h\xC3\xA9");
  CHECK(fresh.tag == std::array<char, 4>{'a', '\'', 'b', '\0'});
}

// ---- refusals ----------------------------------------------------------------------------------------------------

TEST_CASE("values out of range or not finite are not sent") {
  for (const float linear : {2.001F, -2.1F, 1e9F, not_a_number, infinity, -infinity}) {
    CAPTURE(linear);
    CHECK(status_of(diffdrive::Velocity{linear, 0.0F}) == Status::out_of_range);
  }
  CHECK(status_of(diffdrive::Velocity{2.0F, -3.14F}) == Status::ok);
  diffdrive::Status status;
  status.battery = 65.536F;  // fits no 16 bits
  CHECK(status_of(status) == Status::out_of_range);
  enterprize::GimbalMsg gimbal;
  gimbal.q[3] = not_a_number;
  CHECK(status_of(gimbal) == Status::out_of_range);
}

template <class Change>
Status changed(Change&& change) {
  log_protocol::Everything message;
  change(message);
  return status_of(message);
}

TEST_CASE("each field's own limit is kept") {
  using Everything = log_protocol::Everything;
  CHECK(changed([](Everything& m) { m.wide = 0x1000000; }) == Status::out_of_range);
  CHECK(changed([](Everything& m) { m.narrow = -8388609; }) == Status::out_of_range);
  CHECK(changed([](Everything& m) { m.fine = 838.9; }) == Status::out_of_range);
  CHECK(changed([](Everything& m) { m.temperature = 85.5F; }) == Status::out_of_range);
  CHECK(changed([](Everything& m) { m.turns = -0.01; }) == Status::out_of_range);
  CHECK(changed([](Everything& m) { m.doubled = 10.5F; }) == Status::out_of_range);
  CHECK(changed([](Everything& m) { m.precise = std::numeric_limits<double>::infinity(); }) == Status::out_of_range);
  CHECK(changed([](Everything& m) { m.mode = static_cast<Everything::Mode>(0); }) == Status::out_of_range);
  CHECK(changed([](Everything& m) { m.gears[1] = static_cast<Everything::Gears>(3); }) == Status::out_of_range);
  CHECK(changed([](Everything& m) { m.steps[2] = 11; }) == Status::out_of_range);
  CHECK(changed([](Everything& m) { m.limits[0] = -1.01F; }) == Status::out_of_range);
  CHECK(changed([](Everything& m) { m.note.size = 7; }) == Status::out_of_range);
}

TEST_CASE("a buffer that is too small gets nothing, one that is just large enough the frame") {
  native::Log log;
  REQUIRE(log.text.assign("hello"));
  std::size_t size = 99;
  Bytes out(64);
  const std::size_t needed = 1 + 1 + 1 + 6 + 2 + 1;  // delimiter, COBS, id, payload, check, delimiter
  CHECK(encode(log, out.data(), needed - 1, size) == Status::too_small);
  CHECK(size == 0);
  CHECK(encode(log, out.data(), needed, size) == Status::ok);
  CHECK(size == needed);
}

// ---- receiving ---------------------------------------------------------------------------------------------------

namespace {

struct Rover {
  std::vector<diffdrive::Velocity> velocities;
  int unknown_frames = 0;
  std::vector<int> actions;

  void on(const diffdrive::Velocity& velocity) { velocities.push_back(velocity); }
  void unknown(const wirebond::Frame&) { ++unknown_frames; }
  void stop() { actions.push_back(0); }
  void safe_mode() { actions.push_back(1); }
};

Bytes velocity_frame(std::int16_t linear, std::int16_t angular) {
  Bytes frame{0xAA, 0x55, 0x01, 0, 0, 0, 0, 0, 0, 0, 0x0D};
  wirebond::store(frame.data() + 3, linear);
  wirebond::store(frame.data() + 5, angular);
  for (std::size_t i = 0; i < 9; ++i) frame[9] = static_cast<std::uint8_t>(frame[9] ^ frame[i]);
  return frame;
}

}  // namespace

TEST_CASE("a handler gets the messages it has a function for, clamped where the file says so") {
  diffdrive::Receiver<diffdrive::FromHost> receiver;
  Rover rover;
  for (const Bytes& frame :
       {velocity_frame(500, 0), velocity_frame(-2500, 32767), frame_of(diffdrive::StatusQuery{})}) {
    receiver.feed(frame.data(), frame.size(), 0, rover);
  }
  REQUIRE(rover.velocities.size() == 2);
  CHECK(rover.velocities[0].linear == 0.5F);
  CHECK(rover.velocities[1].linear == -2.0F);
  CHECK(rover.velocities[1].angular == 3.14F);
  CHECK(receiver.violations().clamped == 1);
  CHECK(receiver.violations().rejected == 0);
  CHECK(receiver.account().frames == 3);
  CHECK(receiver.bytes() == 33);
  CHECK(receiver.pending() == 0);
}

TEST_CASE("a message that breaks a rule is delivered and counted, and its handler does not see it") {
  struct {
    int calls = 0;
    int unknown_frames = 0;
    void on(const native::Command&) { ++calls; }
    void unknown(const wirebond::Frame&) { ++unknown_frames; }
  } handler;
  native::Receiver<native::FromHost> receiver;
  const native::FromHost source;
  const auto feed = [&](std::uint32_t id, const Bytes& payload) {
    Bytes frame(wirebond::wire_bytes(source.format(), payload.size()));
    std::memcpy(frame.data() + wirebond::payload_lead(source), payload.data(), payload.size());
    frame.resize(wirebond::seal(source, frame.data(), frame.size(), id, payload.size()));
    REQUIRE_FALSE(frame.empty());
    receiver.feed(frame.data(), frame.size(), 0, handler);
  };
  feed(native::Command::Info::id, {0, 0, 3});  // mode 3 has no name
  CHECK(handler.calls == 0);
  CHECK(receiver.violations().unknown_enum == 1);
  CHECK(receiver.violations().rejected == 1);
  feed(native::Command::Info::id, {0, 0, 2, 9, 9});  // a newer peer's
  CHECK(handler.calls == 1);
  feed(native::Command::Info::id, {0, 0});  // too short
  feed(0x3F, {1});
  CHECK(handler.unknown_frames == 2);
  feed(native::ParameterSet::Info::id, {0, 0x00, 0x00, 0xC0, 0x7F});  // a NaN, for which this handler has no function
  CHECK(receiver.violations().not_finite == 1);
  CHECK(receiver.account().frames == 5);
}

TEST_CASE("zeros that a sender left out at a payload's end are there again for the handler") {
  struct {
    void on(const enterprize::ChassisMsg& message) { seen = message; }
    enterprize::ChassisMsg seen{9.0F, 9.0F, 9.0F};
  } handler;
  const std::uint8_t payload[] = {0x00, 0x00, 0x80, 0x3F, 0x00, 0x00, 0x00};  // the next byte would be 0x40
  wirebond::Frame frame{};
  frame.payload = payload;
  frame.payload_size = sizeof payload;
  wirebond::Violations counts;
  CHECK(wirebond::hand_over<enterprize::ChassisMsg>(frame, handler, counts));
  CHECK(handler.seen.x_vel == 1.0F);
  CHECK(handler.seen.y_vel == 0.0F);
  CHECK(handler.seen.w_vel == 0.0F);
}

TEST_CASE("violations and clamp, field by field") {
  using Everything = log_protocol::Everything;
  Everything message;
  CHECK(violations(message) == Violation::none);
  message.temperature = 87.5F;
  message.limits = {-3.0F, 3.0F};
  CHECK(violations(message) == Violation::clamped);
  clamp(message);
  CHECK(message.temperature == 85.0F);
  CHECK(message.limits == std::array<float, 2>{-1.0F, 1.0F});
  message.steps[0] = 4;
  CHECK(violations(message) == Violation::out_of_range);
  message = Everything{};
  message.limits[1] = infinity;  // no clamp makes a number of what is none
  CHECK(rejects(violations(message)));
  message = Everything{};
  message.ratio = 1.7F;  // goes on the wire as 6, which is 1.8: what a sender may send, a receiver takes
  CHECK(violations(through_payload(message)) == Violation::none);
  message.ratio = 2.1F;
  CHECK(violations(message) == Violation::out_of_range);
}

TEST_CASE("deadlines are put off by valid messages only, and strike by name") {
  diffdrive::Receiver<diffdrive::FromHost> receiver;
  Rover rover;
  wirebond::Deadlines<diffdrive::mcu_deadlines.size()> deadlines(diffdrive::mcu_deadlines, 0u);
  const auto poll = [&](std::uint32_t now_us) {
    deadlines.poll(now_us, [&](std::uint8_t action) { diffdrive::act_at_mcu(action, rover); });
  };
  const Bytes frame = velocity_frame(500, 0);
  Bytes damaged = frame;
  damaged[4] ^= 1;
  receiver.feed(frame.data(), frame.size(), 900'000, rover, deadlines);
  receiver.feed(damaged.data(), damaged.size(), 1'800'000, rover, deadlines);
  poll(1'899'999);
  CHECK(rover.actions.empty());
  poll(1'900'000);
  CHECK(rover.actions == std::vector<int>{0});
  poll(3'900'000);
  CHECK(rover.actions == std::vector<int>{0, 1});
  const std::size_t heard = rover.velocities.size();
  receiver.feed(frame.data(), frame.size(), 4'000'000, rover, deadlines);
  CHECK(rover.velocities.size() == heard);  // safe_mode is `recover: explicit`: it holds its message back
  CHECK(deadlines.not_acted().held_back == 1);
  CHECK(deadlines.struck(static_cast<std::uint8_t>(diffdrive::Action::stop)));
  deadlines.recover(static_cast<std::uint8_t>(diffdrive::Action::safe_mode), 4'100'000);
  CHECK_FALSE(deadlines.struck(static_cast<std::uint8_t>(diffdrive::Action::stop)));
  receiver.feed(frame.data(), frame.size(), 4'200'000, rover, deadlines);
  CHECK(rover.velocities.size() == heard + 1);
}

TEST_CASE("a deadline that struck before its message ever came is ended by it, also with `recover: explicit`") {
  diffdrive::Receiver<diffdrive::FromHost> receiver;
  Rover rover;
  wirebond::Deadlines<diffdrive::mcu_deadlines.size()> deadlines(diffdrive::mcu_deadlines, 0u);
  deadlines.poll(30'000'000, [&](std::uint8_t action) { diffdrive::act_at_mcu(action, rover); });
  REQUIRE(deadlines.struck(static_cast<std::uint8_t>(diffdrive::Action::safe_mode)));
  const Bytes frame = velocity_frame(500, 0);
  receiver.feed(frame.data(), frame.size(), 30'000'001, rover, deadlines);
  CHECK(rover.velocities.size() == 1);
  CHECK_FALSE(deadlines.struck(static_cast<std::uint8_t>(diffdrive::Action::safe_mode)));
}

TEST_CASE("a receiver frees a frame behind a false start when the line is idle") {
  diffdrive::Receiver<diffdrive::FromHost> receiver(5'000);
  Rover rover;
  const Bytes frame = velocity_frame(500, 0);
  Bytes stream{0xAA, 0x55, 0x01, 0x00};
  stream.insert(stream.end(), frame.begin(), frame.begin() + 11);
  stream[14] = 0x00;  // its tail is damaged: nothing to find in it
  receiver.feed(stream.data(), 8, 100, rover);
  CHECK(receiver.pending() == 8);
  receiver.idle(5'099, rover);
  CHECK(receiver.pending() == 8);
  receiver.idle(5'100, rover);
  CHECK(receiver.pending() == 0);
  CHECK(receiver.account().discarded_bytes[static_cast<std::size_t>(wirebond::Cause::incomplete)] == 8);
}

// ---- facts -------------------------------------------------------------------------------------------------------

TEST_CASE("facts of the file are constants") {
  static_assert(diffdrive::Velocity::Info::id == 0x01);
  static_assert(diffdrive::Velocity::Info::every_us == 50'000);
  static_assert(diffdrive::Velocity::Info::queue == wirebond::Queue::normal);
  static_assert(diffdrive::max_run_bytes == 11 && diffdrive::max_age_ms == 0);
  static_assert(log_protocol::max_run_bytes == 43 && log_protocol::max_age_ms == 1500);
  static_assert(log_protocol::FromMcu::LatestMessages::size == 1);
  static_assert(log_protocol::FromHost::LatestMessages::size == 0);
  static_assert(diffdrive::Velocity::Info::sender == wirebond::End::host);
  static_assert(diffdrive::Velocity::Info::max_frame_bytes == 11);
  static_assert(diffdrive::mcu_deadlines.size() == 2);
  static_assert(diffdrive::host_deadlines[1].after_us == 5'000'000);
  static_assert(diffdrive::emergency_stop().linear == 0.0F);
  static_assert(log_protocol::emergency_stop_receiver().level == 7);
  static_assert(decltype(log_protocol::emergency_stop_from_host())::Info::id == 0x0104);
  static_assert(log_protocol::parity == log_protocol::Parity::even);
  static_assert(log_protocol::stop_bits == 1.5F);
  static_assert(native::emergency_stop().mode == native::Command::Mode::idle);
  static_assert(native::services::Ping::Reply::Info::id == 0x72);
  static_assert(enterprize::baud == 2'000'000);
  static_assert(enterprize::SentryGimbalMsg::Info::max_frame_bytes == 45);
  CHECK(std::strcmp(enterprize::protocol_name, "enterprize") == 0);
  CHECK(std::strcmp(diffdrive::StatusQuery::Info::name, "status_query") == 0);
}
