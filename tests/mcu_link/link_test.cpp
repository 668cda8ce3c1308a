// A link's own rules, one by one, on a port that does what the test says: start, states, sending, retries.
#include "wirebond/mcu/link.hpp"

#include <doctest/doctest.h>

#include <cmath>
#include <cstdint>
#include <cstring>
#include <functional>
#include <string>
#include <utility>
#include <vector>

#include "diffdrive_link.hpp"
#include "native_link.hpp"
#include "scripted_port.hpp"

namespace {

struct Rover {
  void on(const diffdrive::Velocity& velocity) { velocities.push_back(velocity.linear); }
  bool fill(diffdrive::Odometry& odometry) {
    odometry.left_ticks = 7;
    return has_odometry;
  }
  void stop() { actions += "stop "; }
  void safe_mode() { actions += "safe_mode "; }
  void link_state(wirebond::LinkState state) { states.push_back(state); }

  std::vector<float> velocities;
  std::vector<wirebond::LinkState> states;
  std::string actions;
  bool has_odometry = true;
};

/// A rover's link with its memory, and what a test does to it.
struct Bench {
  explicit Bench(std::uint32_t start_us = 0) : now_us(start_us) {}

  void poll(std::uint32_t after_us = ms) {
    now_us += after_us;
    link.poll(now_us);
    serve();
  }

  /// The UART's interrupt, where it was asked for.
  void serve() {
    if (!port.pended) return;
    port.pended = false;
    link.on_pended();
  }

  /// The run leaves; what follows it as well, until nothing is left. Returns the bytes.
  Bytes drain() {
    serve();
    Bytes sent;
    while (!port.run.empty()) {
      sent.insert(sent.end(), port.run.begin(), port.run.end());
      port.run.clear();
      link.on_transmitted();
    }
    return sent;
  }

  template <class Message>
  void arrive(const Message& message) {
    Bytes frame(Message::Info::max_frame_bytes);
    std::size_t size = 0;
    REQUIRE(diffdrive::encode(message, frame.data(), frame.size(), size) == wirebond::Status::ok);
    frame.resize(size);
    port.arrive(frame);
    link.on_received();
  }

  std::uint32_t now_us;
  ScriptedPort port;
  Rover rover;
  diffdrive::McuBuffers<64, 64, 4> buffers;
  diffdrive::McuLink<Rover, ScriptedPort, decltype(buffers)> link{rover, port, buffers};
};

Bytes encoded(const diffdrive::Odometry& odometry) {
  Bytes frame(diffdrive::Odometry::Info::max_frame_bytes);
  std::size_t size = 0;
  REQUIRE(diffdrive::encode(odometry, frame.data(), frame.size(), size) == wirebond::Status::ok);
  return frame;
}

}  // namespace

TEST_CASE("before the first poll nothing is sent, and the refusal is counted") {
  Bench bench;
  CHECK(bench.link.send(diffdrive::Status{}) == wirebond::Status::link_down);
  CHECK(bench.link.state() == wirebond::LinkState::down);
  const wirebond::SendAccount account = bench.link.send_account();
  CHECK(account.refused(wirebond::Refusal::down) == 1);
  CHECK(account.balances());
}

TEST_CASE("buffers out of the DMA's reach keep the link down, and the deadlines run all the same") {
  Bench bench;
  bench.port.is_reachable = false;
  for (int i = 0; i < 3500; ++i) bench.poll();
  CHECK(bench.port.receive_starts == 0);
  CHECK(bench.link.state() == wirebond::LinkState::down);
  CHECK(bench.rover.actions == "stop safe_mode ");
}

TEST_CASE("a port that refuses reception at first is asked again by each poll") {
  Bench bench;
  bench.port.refuses_receive = true;
  bench.poll();
  bench.poll();
  CHECK(bench.link.state() == wirebond::LinkState::down);
  bench.port.refuses_receive = false;
  bench.poll();
  CHECK(bench.link.state() == wirebond::LinkState::stale);
}

TEST_CASE("events before the first poll are not the link's: nothing is counted as received, nothing is started") {
  Bench bench;
  bench.port.is_reachable = false;
  bench.port.place = 40;  // of whoever used the DMA before
  bench.link.on_received();
  bench.link.on_error();
  bench.link.on_pended();
  CHECK(bench.port.receive_starts == 0);
  bench.poll();
  CHECK(bench.port.receive_starts == 0);
  bench.port.is_reachable = true;
  bench.poll();
  CHECK(bench.port.receive_starts == 1);
  bench.poll();
  CHECK(bench.link.receive_account().received == 0);
  CHECK(bench.link.counters().receive_restarts == 0);
  bench.arrive(diffdrive::Velocity{0.5F, 0.0F});
  bench.poll();
  CHECK(bench.rover.velocities == std::vector<float>{0.5F});
  CHECK(bench.link.receive_account().received == 11);
}

TEST_CASE("an error in the middle of the start does not leave the link deaf") {
  Bench bench;
  bench.port.error_behind_start = [&] {
    bench.port.is_receiving = false;
    bench.link.on_error();
  };
  bench.poll();
  CHECK(bench.port.receive_starts == 2);
  CHECK(bench.link.counters().receive_restarts == 1);
  bench.arrive(diffdrive::Velocity{0.5F, 0.0F});
  bench.poll();
  CHECK(bench.rover.velocities == std::vector<float>{0.5F});
}

TEST_CASE("valid frames bring the link up, silence makes it stale, and a frame brings it up again") {
  Bench bench;
  bench.poll();
  bench.arrive(diffdrive::Velocity{0.5F, 0.0F});
  bench.poll();
  CHECK(bench.link.state() == wirebond::LinkState::up);
  for (int i = 0; i < 999; ++i) bench.poll();
  CHECK(bench.link.state() == wirebond::LinkState::up);
  bench.poll();
  CHECK(bench.link.state() == wirebond::LinkState::stale);
  bench.arrive(diffdrive::Velocity{0.25F, 0.0F});
  bench.poll();
  CHECK(bench.rover.velocities == std::vector<float>{0.5F, 0.25F});
  using wirebond::LinkState;
  CHECK(bench.rover.states == std::vector<LinkState>{LinkState::stale, LinkState::up, LinkState::stale, LinkState::up});
}

TEST_CASE("deadlines strike within one poll of their time, also when the clock wraps") {
  for (const std::uint32_t start : {0u, 0xFFFFFFFFu - 1500u * ms}) {
    CAPTURE(start);
    Bench bench(start);
    bench.poll(0);
    bench.arrive(diffdrive::Velocity{0.5F, 0.0F});
    bench.poll();
    for (int i = 0; i < 998; ++i) bench.poll();  // the message may have come right behind the first poll
    CHECK(bench.rover.actions.empty());
    bench.poll();
    CHECK(bench.rover.actions == "stop ");
    for (int i = 0; i < 1999; ++i) bench.poll();
    CHECK(bench.rover.actions == "stop ");
    bench.poll();
    CHECK(bench.rover.actions == "stop safe_mode ");
    CHECK(bench.link.struck(diffdrive::Action::safe_mode));
    bench.link.recover(diffdrive::Action::safe_mode);
    CHECK_FALSE(bench.link.struck(diffdrive::Action::safe_mode));
  }
}

TEST_CASE("messages with a rhythm are filled and sent when they are due, and not where the handler says so") {
  Bench bench;
  bench.poll(0);
  diffdrive::Odometry odometry;
  odometry.left_ticks = 7;
  CHECK(bench.drain() == encoded(odometry));
  for (int i = 0; i < 49; ++i) bench.poll();
  CHECK(bench.drain().empty());
  bench.poll();
  CHECK(bench.drain() == encoded(odometry));
  bench.rover.has_odometry = false;
  for (int i = 0; i < 50; ++i) bench.poll();
  CHECK(bench.drain().empty());
}

TEST_CASE("a full queue is an answer; the account closes after every step") {
  Bench bench;
  bench.rover.has_odometry = false;
  bench.poll();
  int accepted = 0;
  while (bench.link.send(diffdrive::Status{}) == wirebond::Status::ok) {
    ++accepted;
    CHECK(bench.link.send_account().balances());
  }
  CHECK(accepted == 4);
  CHECK(bench.link.send_account().refused(wirebond::Refusal::full) == 1);
  CHECK(bench.drain().size() == 4 * 11);
  CHECK(bench.link.send_account().sent == 4);
  CHECK(bench.link.send(diffdrive::Status{}) == wirebond::Status::ok);
  CHECK(bench.link.send_account().balances());
}

TEST_CASE("a value out of range is refused, queues nothing and gives its room back") {
  Bench bench;
  bench.rover.has_odometry = false;
  bench.poll();
  diffdrive::Status status;
  status.battery = 1e9F;
  for (int i = 0; i < 20; ++i) {
    CHECK(bench.link.send(status) == wirebond::Status::out_of_range);
    bench.serve();
  }
  CHECK(bench.drain().empty());
  const wirebond::SendAccount account = bench.link.send_account();
  CHECK(account.refused(wirebond::Refusal::range) == 20);
  CHECK(account.balances());
  CHECK(bench.link.send(diffdrive::Status{}) == wirebond::Status::ok);
}

TEST_CASE("a port that does not take a run gets the same run again from poll, and nothing is lost") {
  Bench bench;
  bench.rover.has_odometry = false;
  bench.poll();
  bench.port.refuses_transmit = true;
  REQUIRE(bench.link.send(diffdrive::Status{}) == wirebond::Status::ok);
  bench.serve();
  bench.poll();
  bench.poll();
  CHECK(bench.port.transmit_starts == 3);
  CHECK(bench.link.counters().transmit_retries == 3);
  bench.port.refuses_transmit = false;
  bench.poll();
  CHECK(bench.drain().size() == 11);
  CHECK(bench.link.send_account().sent == 1);
}

TEST_CASE("a run that never ends is broken off, counted, and the next one is sent") {
  Bench bench;
  bench.rover.has_odometry = false;
  bench.poll();
  REQUIRE(bench.link.send(diffdrive::Status{}) == wirebond::Status::ok);
  bench.serve();
  bench.port.run.clear();  // and no complete event comes
  for (int i = 0; i < 20; ++i) bench.poll();
  CHECK(bench.port.transmit_stops == 1);
  CHECK(bench.link.counters().transmit_timeouts == 1);
  CHECK(bench.link.send_account().aborted == 1);
  REQUIRE(bench.link.send(diffdrive::Status{}) == wirebond::Status::ok);
  CHECK(bench.drain().size() == 11);
  CHECK(bench.link.send_account().balances());
}

TEST_CASE("an event of a run that was broken off ends no other run") {
  Bench bench;
  bench.rover.has_odometry = false;
  bench.poll();
  bench.link.on_transmitted();
  CHECK(bench.link.send_account().sent == 0);
}

TEST_CASE("reception restarts after an error that stopped it, and goes on after one that did not") {
  Bench bench;
  bench.poll();
  CHECK(bench.port.receive_starts == 1);
  bench.link.on_error();
  CHECK(bench.port.receive_starts == 1);
  bench.port.is_receiving = false;
  bench.link.on_error();
  CHECK(bench.port.receive_starts == 2);
  CHECK(bench.link.counters().line_errors == 2);
  CHECK(bench.link.counters().receive_restarts == 1);
  bench.arrive(diffdrive::Velocity{0.5F, 0.0F});
  bench.poll();
  CHECK(bench.rover.velocities.size() == 1);
}

TEST_CASE("a restart that the port refuses is tried again from poll") {
  Bench bench;
  bench.poll();
  bench.port.is_receiving = false;
  bench.port.refuses_receive = true;
  bench.link.on_error();
  bench.poll();
  bench.port.refuses_receive = false;
  bench.poll();
  CHECK(bench.link.counters().receive_restarts == 1);
  bench.arrive(diffdrive::Velocity{0.5F, 0.0F});
  bench.poll();
  CHECK(bench.rover.velocities.size() == 1);
}

TEST_CASE("a frame survives restarts and pieces, and every byte is in the account") {
  Bench bench;
  bench.poll();
  std::uint32_t total = 0;
  for (int i = 0; i < 50; ++i) {
    bench.port.arrive({0x01, 0x02, 0x03});
    total += 3;
    bench.link.on_received();
    bench.arrive(diffdrive::Velocity{0.5F, 0.0F});
    total += 11;
    bench.port.is_receiving = false;
    bench.link.on_error();
    CHECK(bench.port.receive_starts == i + 1);  // not before the poll has read them
    bench.poll();
    CHECK(bench.port.receive_starts == i + 2);
  }
  CHECK(bench.rover.velocities.size() == 50);
  const wirebond::ReceiveAccount account = bench.link.receive_account();
  CHECK(bench.link.counters().receive_restarts == 50);
  CHECK(account.received == total);
  CHECK(account.lapped == 0);
  CHECK(account.handed_out == total);
  CHECK(bench.link.receiver().bytes() == account.handed_out);
  CHECK(bench.link.receiver().account().settled() + bench.link.receiver().pending() == account.handed_out);
}

TEST_CASE("bytes that come when a silent line is about to be restarted are kept, and reception runs on") {
  for (const bool tells : {false, true}) {
    CAPTURE(tells);
    Bench bench;
    bench.rover.has_odometry = false;
    for (int i = 0; i < 1000; ++i) bench.poll();
    bench.now_us += ms;
    bench.link.poll(bench.now_us);
    REQUIRE(bench.port.pended);
    Bytes frame(diffdrive::Velocity::Info::max_frame_bytes);
    std::size_t size = 0;
    REQUIRE(diffdrive::encode(diffdrive::Velocity{0.5F, 0.0F}, frame.data(), frame.size(), size) ==
            wirebond::Status::ok);
    frame.resize(size);
    bench.port.arrive({frame.begin(), frame.begin() + 5});
    if (tells) bench.link.on_received();
    bench.serve();
    CHECK(bench.port.receive_starts == 1);
    bench.port.arrive({frame.begin() + 5, frame.end()});
    bench.poll();
    CHECK(bench.rover.velocities == std::vector<float>{0.5F});
    CHECK(bench.link.receive_account().lapped == 0);
    for (int i = 0; i < 1001; ++i) bench.poll();  // silent again, and now it stays so
    CHECK(bench.link.counters().receive_restarts == 1);
  }
}

TEST_CASE("a silent line is restarted every second, lest the UART hangs") {
  Bench bench;
  bench.rover.has_odometry = false;
  for (int i = 0; i < 3500; ++i) bench.poll();
  CHECK(bench.link.counters().receive_restarts == 3);
}

// ---- subscriptions

namespace {

struct Shared : wirebond::Subscribed {
  void on(const diffdrive::Velocity&) { ++own; }
  void stop() {}
  void safe_mode() {}
  int own = 0;
};

std::string seen_by;
const wirebond::Subscription<diffdrive::Velocity> first([](const diffdrive::Velocity&) { seen_by += "1"; });

}  // namespace

TEST_CASE("a message goes to its handler and to every subscription, as long as that lives") {
  ScriptedPort port;
  Shared shared;
  diffdrive::McuBuffers<64, 64, 4> buffers;
  diffdrive::McuLink link{shared, port, buffers};
  link.poll(0);
  const auto arrive = [&](std::uint32_t now_us) {
    Bytes frame(diffdrive::Velocity::Info::max_frame_bytes);
    std::size_t size = 0;
    REQUIRE(diffdrive::encode(diffdrive::Velocity{}, frame.data(), frame.size(), size) == wirebond::Status::ok);
    port.arrive(frame);
    link.poll(now_us);
  };
  {
    const wirebond::Subscription<diffdrive::Velocity> second([](const diffdrive::Velocity&) { seen_by += "2"; });
    const wirebond::Subscription<diffdrive::StatusQuery> other([](const diffdrive::StatusQuery&) { seen_by += "x"; });
    arrive(ms);
    CHECK(seen_by == "21");
  }
  arrive(2 * ms);
  CHECK(seen_by == "211");
  CHECK(shared.own == 2);
}
