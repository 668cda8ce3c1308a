// What a link does when nobody looked for too long: polls that stall or come in the middle of the UART's interrupt, on
// a port without a clock, with one, and on one that cannot be lapped unseen.
#include <doctest/doctest.h>

#include <cstdint>
#include <functional>
#include <string>
#include <vector>

#include "aging.hpp"
#include "diffdrive_link.hpp"
#include "scripted_port.hpp"
#include "wirebond/mcu/link.hpp"

namespace {

constexpr std::uint32_t frame_bytes = diffdrive::Velocity::Info::max_frame_bytes;

struct ClockedPort : ScriptedPort {
  std::uint32_t now_us() const { return clock_us; }
  std::uint32_t clock_us = 0;
};

struct TellingPort : ScriptedPort {
  static constexpr bool tells_every_lap = true;
};

struct Rover {
  void on(const diffdrive::Velocity& velocity) { velocities.push_back(velocity.linear); }
  void on(const diffdrive::StatusQuery&) {
    if (on_query) on_query();
  }
  bool fill(diffdrive::Odometry&) {
    if (on_fill) on_fill();
    return false;
  }
  void stop() {
    actions += "stop ";
    if (on_stop) on_stop();
  }
  void safe_mode() { actions += "safe_mode "; }

  std::vector<float> velocities;
  std::string actions;
  std::function<void()> on_query;
  std::function<void()> on_stop;
  std::function<void()> on_fill;
};

template <std::size_t receive_bytes, class Port = ScriptedPort>
struct Bench {
  explicit Bench(std::uint32_t start_us) : start(start_us) { poll_at(0); }

  /// `at_us` since the start.
  void poll_at(std::uint32_t at_us) { link.poll(start + at_us); }

  void put(float linear, std::size_t from = 0, std::size_t to = frame_bytes) {
    Bytes frame(frame_bytes);
    std::size_t size = 0;
    REQUIRE(diffdrive::encode(diffdrive::Velocity{linear, 0.0F}, frame.data(), frame.size(), size) ==
            wirebond::Status::ok);
    port.arrive({frame.begin() + static_cast<std::ptrdiff_t>(from), frame.begin() + static_cast<std::ptrdiff_t>(to)});
  }

  void check_sums() const {
    const wirebond::ReceiveAccount ring = link.receive_account();
    CHECK(ring.received == ring.handed_out + ring.lapped + ring.dropped + static_cast<std::uint32_t>(link.unread()));
    CHECK(link.receiver().bytes() == ring.handed_out);
    CHECK(link.receiver().account().settled() + link.receiver().pending() == ring.handed_out);
  }

  std::uint32_t start;
  Port port;
  Rover rover;
  diffdrive::McuBuffers<receive_bytes, 64, 4> buffers;
  diffdrive::McuLink<Rover, Port, decltype(buffers)> link{rover, port, buffers};
};

/// The clock wraps between the first poll and the stall's end, or does not.
constexpr std::uint32_t starts[] = {0, 0xFFFFFFFFu - 500 * ms};

constexpr std::size_t seconds_long = 16'384;  // 1.4 s of the line
constexpr std::uint32_t fill_us = 5'555;      // of 64 bytes at 11 520 in a second

}  // namespace

TEST_CASE("a command as old as its shortest deadline is late: it does not act, and its deadlines go on") {
  for (const std::uint32_t start : starts) {
    CAPTURE(start);
    Bench<seconds_long> bench(start);
    bench.put(0.5F);
    bench.poll_at(999'999);
    CHECK(bench.rover.velocities == std::vector<float>{0.5F});  // it may have come just before this poll
    CHECK(bench.link.counters().slow_polls == 1);
    bench.put(0.25F);
    bench.poll_at(1'999'999);
    CHECK(bench.rover.velocities.size() == 1);
    CHECK(bench.link.counters().late == 1);
    CHECK(bench.link.counters().slow_polls == 2);
    CHECK(bench.rover.actions == "stop ");
    CHECK(bench.link.receiver().account().frames == 2);  // it was delivered all the same
    CHECK(bench.link.state() == wirebond::LinkState::up);
    bench.check_sums();
    bench.put(0.125F);
    bench.poll_at(2'000'999);
    CHECK(bench.rover.velocities == std::vector<float>{0.5F, 0.125F});
    CHECK_FALSE(bench.link.struck(diffdrive::Action::stop));
    CHECK(bench.link.counters().late == 1);
  }
}

TEST_CASE("silence counts from when a command came at the earliest, not from the poll that found it") {
  Bench<seconds_long> bench(0);
  bench.poll_at(1'000);
  bench.put(0.5F);
  bench.poll_at(400'000);
  bench.poll_at(1'000'999);
  CHECK(bench.rover.actions.empty());
  bench.poll_at(1'001'000);
  CHECK(bench.rover.actions == "stop ");
}

TEST_CASE("a message without a deadline is never late") {
  Bench<seconds_long> bench(0);
  Bytes frame(diffdrive::StatusQuery::Info::max_frame_bytes);
  std::size_t size = 0;
  REQUIRE(diffdrive::encode(diffdrive::StatusQuery{}, frame.data(), frame.size(), size) == wirebond::Status::ok);
  bench.port.arrive(frame);
  bench.poll_at(1'200'000);
  CHECK(bench.link.counters().late == 0);
  CHECK(bench.link.receiver().account().frames == 1);
}

TEST_CASE("polls as far apart as half the shortest deadline are not slow, others are counted") {
  Bench<seconds_long> bench(0);
  bench.poll_at(500'000);
  CHECK(bench.link.counters().slow_polls == 0);
  bench.poll_at(1'000'001);
  CHECK(bench.link.counters().slow_polls == 1);
}

TEST_CASE("where nobody looked for as long as the ring takes to fill, what is unread is dropped and counted") {
  for (const std::uint32_t start : {0u, 0xFFFFFFFFu - 3 * ms}) {
    for (const bool in_time : {true, false}) {
      CAPTURE(start);
      CAPTURE(in_time);
      Bench<64> bench(start);
      bench.put(0.5F, 0, 5);  // the first bytes of a frame, and then the stall
      bench.poll_at(1'000);
      CHECK(bench.link.receiver().pending() == 5);
      bench.put(0.5F, 5);
      bench.put(0.25F);
      bench.poll_at(1'000 + fill_us - in_time);
      bench.check_sums();
      const wirebond::ReceiveAccount account = bench.link.receive_account();
      CHECK(account.received == 2 * frame_bytes);
      CHECK(account.laps_unknown == (in_time ? 0 : 1));
      CHECK(account.dropped == (in_time ? 0 : 2 * frame_bytes - 5));
      CHECK(bench.rover.velocities.size() == (in_time ? 2 : 0));
      CHECK(bench.link.receiver().pending() == 0);
      bench.put(0.125F);  // and the line goes on
      bench.poll_at(8'000);
      CHECK(bench.rover.velocities.back() == 0.125F);
      bench.check_sums();
    }
  }
}

TEST_CASE("a stall that loses count also passes the holes of restarts") {
  Bench<64> bench(0);
  bench.poll_at(1'000);
  for (int i = 0; i < 3; ++i) {
    bench.put(0.5F);
    bench.link.on_received();
    bench.port.is_receiving = false;
    bench.link.on_error();
  }
  bench.poll_at(1'000 + fill_us);
  CHECK(bench.link.receive_account().laps_unknown == 1);
  CHECK(bench.link.receive_account().dropped + bench.link.receive_account().lapped == 3 * frame_bytes);
  CHECK(bench.rover.velocities.empty());
  bench.check_sums();
  bench.put(0.25F);
  bench.poll_at(8'000);
  CHECK(bench.rover.velocities == std::vector<float>{0.25F});
  bench.check_sums();
}

TEST_CASE("a port that cannot be lapped unseen drops nothing in a stall") {
  Bench<64, TellingPort> bench(0);
  bench.put(0.5F);
  bench.poll_at(900'000);
  CHECK(bench.rover.velocities == std::vector<float>{0.5F});
  CHECK(bench.link.receive_account().laps_unknown == 0);
}

TEST_CASE("the first poll of a link that was down for long has lost nothing") {
  Bench<64> bench(0);
  Rover rover;
  ScriptedPort port;
  port.refuses_receive = true;
  diffdrive::McuLink link{rover, port, bench.buffers};
  link.poll(0);
  port.refuses_receive = false;
  link.poll(900'000);
  link.poll(901'000);
  CHECK(link.receive_account().laps_unknown == 0);
}

TEST_CASE("with a clock bytes are as old as the event before them, also in a stall of the poll") {
  for (const std::uint32_t start : starts) {
    CAPTURE(start);
    Bench<seconds_long, ClockedPort> bench(start);
    const auto event_at = [&](std::uint32_t at_us) {
      bench.port.clock_us = start + at_us;
      bench.link.on_received();
    };
    bench.put(0.5F);
    event_at(500'000);
    event_at(1'000'000);
    bench.put(0.25F);
    event_at(1'400'000);
    bench.poll_at(1'450'000);
    CHECK(bench.rover.velocities == std::vector<float>{0.25F});  // not before the event at 1 s
    CHECK(bench.link.counters().late == 1);
    CHECK(bench.rover.actions == "stop ");  // struck at 1 s, and ended by the command that came later
    CHECK_FALSE(bench.link.struck(diffdrive::Action::stop));
    CHECK(bench.link.receive_account().laps_unknown == 0);
    bench.poll_at(1'999'999);
    CHECK_FALSE(bench.link.struck(diffdrive::Action::stop));
    bench.poll_at(2'000'000);
    CHECK(bench.link.struck(diffdrive::Action::stop));
    bench.check_sums();
  }
}

TEST_CASE("with a clock a ring is lapped in the account as long as events come, and unknown where none came") {
  Bench<64, ClockedPort> bench(0);
  for (std::uint32_t at_us = 2'000; at_us <= 20'000; at_us += 2'000) {
    bench.port.clock_us = at_us;
    bench.put(0.5F);
    bench.put(0.5F);
    bench.link.on_received();
  }
  bench.poll_at(21'000);
  wirebond::ReceiveAccount account = bench.link.receive_account();
  CHECK(account.received == 20 * frame_bytes);
  CHECK(account.lapped > 0);
  CHECK(account.laps_unknown == 0);
  CHECK_FALSE(bench.rover.velocities.empty());
  const std::size_t before = bench.rover.velocities.size();
  bench.check_sums();
  bench.put(0.25F);  // now everything stalls, interrupts as well
  bench.port.clock_us = 21'000 + fill_us;
  bench.link.on_received();
  bench.poll_at(21'001 + fill_us);
  account = bench.link.receive_account();
  CHECK(account.laps_unknown == 1);
  CHECK(bench.rover.velocities.size() == before);
  bench.check_sums();
}

TEST_CASE("with a clock an event between the poll's reading of the time and its look makes nothing late") {
  for (const std::uint32_t start : {0u, 0xFFFFFFFFu - 100 * ms}) {
    CAPTURE(start);
    Bench<seconds_long, ClockedPort> bench(start);
    const auto event_at = [&](std::uint32_t at_us) {
      bench.port.clock_us = start + at_us;
      bench.link.on_received();
    };
    bench.poll_at(95'000);
    bench.put(0.5F);
    event_at(101'000);  // the task that polls has read 100 ms, and was interrupted before it called `poll`
    bench.put(0.25F);
    event_at(102'000);
    bench.poll_at(100'000);
    CHECK(bench.rover.velocities == std::vector<float>{0.5F, 0.25F});
    CHECK(bench.link.counters().late == 0);
    CHECK(bench.rover.actions.empty());
    bench.poll_at(1'099'999);
    CHECK(bench.rover.actions.empty());
    bench.poll_at(1'100'000);
    CHECK(bench.rover.actions == "stop ");
    bench.check_sums();
  }
}

TEST_CASE("with a clock a recover inside a handler is not undone by bytes that the same poll finds behind it") {
  for (const std::uint32_t start : starts) {
    CAPTURE(start);
    Bench<seconds_long, ClockedPort> bench(start);
    const auto event_at = [&](std::uint32_t at_us) {
      bench.port.clock_us = start + at_us;
      bench.link.on_received();
    };
    Bytes query(diffdrive::StatusQuery::Info::max_frame_bytes);
    std::size_t size = 0;
    REQUIRE(diffdrive::encode(diffdrive::StatusQuery{}, query.data(), query.size(), size) == wirebond::Status::ok);
    bench.put(0.5F);
    bench.poll_at(1'000);
    bench.poll_at(4'000'000);
    REQUIRE(bench.rover.actions == "stop safe_mode ");
    bench.rover.on_query = [&] { bench.link.recover(diffdrive::Action::safe_mode); };
    bench.port.arrive(query);
    event_at(4'001'000);
    bench.put(0.25F);
    event_at(4'002'000);
    bench.poll_at(4'004'000);
    CHECK(bench.rover.actions == "stop safe_mode ");
    CHECK(bench.rover.velocities == std::vector<float>{0.5F, 0.25F});
    CHECK(bench.link.counters().held_back == 0);
    CHECK_FALSE(bench.link.struck(diffdrive::Action::safe_mode));
    CHECK_FALSE(bench.link.struck(diffdrive::Action::stop));
    bench.check_sums();
  }
}

// ---- a handler that takes long, such as one that erases flash

namespace {

/// A query whose handler takes two seconds lies in the ring before a command. 1 s is the shortest deadline of that.
template <class Port, class Wait>
void put_slow_query_and_command(Bench<seconds_long, Port>& bench, Wait&& wait) {
  Bytes query(diffdrive::StatusQuery::Info::max_frame_bytes);
  std::size_t size = 0;
  REQUIRE(diffdrive::encode(diffdrive::StatusQuery{}, query.data(), query.size(), size) == wirebond::Status::ok);
  bench.rover.on_query = wait;
  bench.port.arrive(query);
  bench.put(0.5F);
  bench.link.on_received();
}

}  // namespace

TEST_CASE("with a clock a command that waited for a slow handler is late, however early the poll began") {
  for (const std::uint32_t start : starts) {
    CAPTURE(start);
    Bench<seconds_long, ClockedPort> bench(start);
    for (const std::uint32_t takes_us : {900'000u, 2'000'000u}) {
      CAPTURE(takes_us);
      bench.port.clock_us = start + 10'000;
      put_slow_query_and_command(bench, [&] { bench.port.clock_us += takes_us; });
      bench.poll_at(10'000);
      CHECK(bench.rover.velocities.size() == 1);
      CHECK(bench.link.counters().late == (takes_us > 1'000'000 ? 1 : 0));
    }
    CHECK(bench.link.why() != wirebond::Why::slow_without_clock);
    bench.check_sums();
  }
}

TEST_CASE("without a clock `why` says that a command after a slow handler acts late") {
  Bench<seconds_long> bench(0);
  put_slow_query_and_command(bench, [] {});  // takes two seconds, which this link cannot know
  bench.poll_at(10'000);
  CHECK(bench.rover.velocities.size() == 1);
  CHECK(bench.link.counters().late == 0);
  CHECK(bench.link.why() == wirebond::Why::nothing);
  bench.put(0.25F);  // came after the handler
  bench.poll_at(2'010'000);
  bench.put(0.25F);
  bench.poll_at(2'011'000);
  CHECK(bench.link.why() == wirebond::Why::slow_without_clock);
}

TEST_CASE("an explicit deadline that has struck holds commands back until recover, and they are counted") {
  Bench<64> bench(0);
  std::uint32_t at_us = 0;
  const auto until = [&](std::uint32_t end_us) {
    while (at_us < end_us) bench.poll_at(at_us += 1'000);
  };
  until(4'000'000);
  CHECK(bench.rover.actions == "stop safe_mode ");
  bench.put(0.5F);
  until(4'001'000);  // before its message ever came it held nothing back
  CHECK(bench.rover.velocities.size() == 1);
  until(8'000'000);
  CHECK(bench.rover.actions == "stop safe_mode stop safe_mode ");
  for (int i = 0; i < 3; ++i) {
    bench.put(0.5F);
    until(at_us + 1'000);
  }
  CHECK(bench.rover.velocities.size() == 1);
  CHECK(bench.link.counters().held_back == 3);
  CHECK(bench.link.state() == wirebond::LinkState::up);  // the line is not silent
  CHECK(bench.link.struck(diffdrive::Action::stop));     // and no deadline was put off
  bench.link.recover(diffdrive::Action::safe_mode);
  CHECK_FALSE(bench.link.struck(diffdrive::Action::stop));
  bench.put(0.25F);
  until(at_us + 1'000);
  CHECK(bench.rover.velocities == std::vector<float>{0.5F, 0.25F});
  bench.check_sums();
}

// ---- a poll above the UART's interrupt

TEST_CASE("a poll that interrupts the restart of reception replays nothing, and is counted") {
  Bench<128> bench(0);
  std::uint32_t at_us = 0;
  for (int i = 0; i < 15; ++i) {  // the ring is full of old commands
    bench.put(0.5F);
    bench.link.on_received();
    bench.poll_at(at_us += 1'000);
  }
  REQUIRE(bench.rover.velocities.size() == 15);
  bench.port.error_behind_start = [&] {
    bench.poll_at(at_us += 1'000);
  };  // DMA begins again, the link has not noted it
  bench.port.is_receiving = false;
  bench.link.on_error();
  CHECK(bench.link.counters().nested_polls == 1);
  bench.poll_at(at_us += 1'000);
  CHECK(bench.rover.velocities.size() == 15);
  CHECK(bench.link.receive_account().received == 15 * frame_bytes);
  bench.put(0.25F);
  bench.poll_at(at_us += 1'000);
  CHECK(bench.rover.velocities.back() == 0.25F);
  CHECK(bench.link.counters().nested_polls == 1);
  bench.check_sums();
}

TEST_CASE("a poll in any event of the UART's interrupt returns at once") {
  Bench<64> bench(0);
  std::uint32_t polls = 0;
  bench.port.at_call = [&] {
    ++polls;
    bench.put(0.5F);
    bench.poll_at(polls);
  };
  bench.link.on_received();  // asks for the position
  bench.link.on_error();     // asks whether reception runs
  CHECK(polls == 2);
  REQUIRE(bench.link.send(diffdrive::Status{}) == wirebond::Status::ok);
  bench.link.on_pended();  // starts a run
  CHECK(polls == 3);
  REQUIRE(bench.link.send(diffdrive::Status{}) == wirebond::Status::ok);
  bench.link.on_transmitted();  // and the next one
  CHECK(polls == 4);
  CHECK(bench.link.counters().nested_polls == polls);
  CHECK(bench.rover.velocities.empty());
  bench.port.at_call = nullptr;
  bench.poll_at(1'000);
  CHECK(bench.rover.velocities.size() == 4);
  CHECK(bench.link.counters().nested_polls == polls);
}

TEST_CASE("a poll in a handler, in an action or in a fill does nothing, and is counted") {
  Bench<64> bench(0);
  Bytes query(diffdrive::StatusQuery::Info::max_frame_bytes);
  std::size_t size = 0;
  REQUIRE(diffdrive::encode(diffdrive::StatusQuery{}, query.data(), query.size(), size) == wirebond::Status::ok);
  query.resize(size);
  int queries = 0;
  bench.rover.on_query = [&] {
    ++queries;
    if (queries < 10) bench.poll_at(2'000);  // it would find the same query again
  };
  bench.port.arrive(query);
  bench.put(0.5F);
  bench.poll_at(1'000);
  CHECK(queries == 1);
  CHECK(bench.rover.velocities == std::vector<float>{0.5F});
  CHECK(bench.link.counters().nested_polls == 1);
  CHECK(bench.link.receiver().account().frames == 2);
  bench.check_sums();
  bench.rover.on_stop = [&] { bench.poll_at(1'002'000); };
  bench.poll_at(1'001'000);
  CHECK(bench.rover.actions == "stop ");
  CHECK(bench.link.counters().nested_polls == 2);
  bench.rover.on_fill = [&] { bench.poll_at(1'102'000); };
  bench.poll_at(1'101'000);
  CHECK(bench.link.counters().nested_polls == 3);
  bench.rover.on_fill = nullptr;
  bench.rover.on_query = nullptr;
  bench.put(0.25F);
  bench.poll_at(1'104'000);  // and the next one works
  CHECK(bench.rover.velocities == std::vector<float>{0.5F, 0.25F});
  CHECK(bench.link.counters().nested_polls == 3);
}

// ---- what lay behind a false start

namespace {

/// Lets everything act, and notes how old it is.
struct Watch {
  template <class IsStop>
  wirebond::MayAct may_act(std::int16_t, std::uint32_t came_us, std::uint32_t, IsStop&&) {
    ages.push_back(came_us);
    return wirebond::MayAct::yes;
  }
  void seen(std::int16_t, std::uint32_t) {}
  std::vector<std::uint32_t> ages;
};

}  // namespace

TEST_CASE("a message that lay behind a false start is as old as the bytes that were kept, not as those that free it") {
  Watch watch;
  struct Nothing {
  } nothing;
  Bytes command(aging::Command::Info::max_frame_bytes);
  std::size_t size = 0;
  REQUIRE(aging::encode(aging::Command{}, command.data(), command.size(), size) == wirebond::Status::ok);
  const Bytes false_start{0x55, 4, 32};  // the header of a large message, which never comes
  Bytes kept = false_start;
  kept.insert(kept.end(), command.begin(), command.end());
  for (const bool by_silence : {false, true}) {
    CAPTURE(by_silence);
    watch.ages.clear();
    wirebond::Receiver<aging::FromHost> receiver(20'000);
    receiver.feed(kept.data(), kept.size(), 1'000, 2'000, nothing, watch);
    CHECK(watch.ages.empty());
    if (by_silence) {
      receiver.idle(900'000, nothing, watch);
      CHECK(watch.ages == std::vector<std::uint32_t>{1'000});
    } else {
      for (int i = 0; i < 3; ++i) receiver.feed(command.data(), command.size(), 800'000, 900'000, nothing, watch);
      // Two of them were kept as well: their age is that of the oldest byte beside them.
      CHECK(watch.ages == std::vector<std::uint32_t>{1'000, 1'000, 1'000, 800'000});
    }
  }
}
