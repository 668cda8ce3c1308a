// Own frames that come back although the file has no `echo`: TX is shorted to RX, or a transceiver hears itself.
#include <doctest/doctest.h>

#include <cstdint>
#include <vector>

#include "diffdrive_link.hpp"
#include "heard_link.hpp"
#include "native_link.hpp"
#include "scripted_port.hpp"
#include "wirebond/mcu/link.hpp"

using wirebond::LinkState;
using wirebond::Status;
using wirebond::Why;

namespace {

struct Handler {
  void on(const heard::Heartbeat&) { ++heartbeats; }
  void on(const heard::Note& note) { noted.push_back(note.number); }
  void on(const heard::Command& command) { speeds.push_back(command.speed); }
  bool fill(heard::Heartbeat&) { return beats; }
  void unknown(const wirebond::Frame&) { ++unknown_frames; }
  void stop() { ++stops; }
  void safe_mode() {}

  bool beats = false;
  int heartbeats = 0;
  int unknown_frames = 0;
  int stops = 0;
  std::vector<std::uint32_t> noted;
  std::vector<int> speeds;
};

/// When an own run is heard: as it leaves, or a little later, where bytes wait before the UART.
enum class Hears { nothing, as_it_leaves, after_it_left };

template <class LinkOf, class Buffers>
struct Bench {
  explicit Bench(Hears hears_now) : hears(hears_now) { poll(); }

  void poll(int times = 1) {
    for (; times != 0; --times) {
      link.poll(now_us += ms);
      serve();
    }
  }
  void serve() {
    while (port.pended) {
      port.pended = false;
      link.on_pended();
      while (!port.run.empty()) {
        const Bytes run = port.run;
        port.run.clear();
        if (hears == Hears::as_it_leaves) come(run);
        link.on_transmitted();
        if (hears == Hears::after_it_left) come(run);
      }
    }
  }
  void come(const Bytes& bytes) {
    port.arrive(bytes);
    link.on_received();
  }

  Hears hears;
  std::uint32_t now_us = 0;
  ScriptedPort port;
  Handler handler;
  Buffers buffers;
  LinkOf link{handler, port, buffers};
};

using HeardBuffers = heard::McuBuffers<256, 256>;
using Heard = Bench<heard::McuLink<Handler, ScriptedPort, HeardBuffers>, HeardBuffers>;

template <class Message>
Bytes frame_of(const Message& message) {
  Bytes frame(Message::Info::max_frame_bytes);
  std::size_t size = 0;
  REQUIRE(heard::encode(message, frame.data(), frame.size(), size) == Status::ok);
  frame.resize(size);
  return frame;
}

}  // namespace

TEST_CASE(
    "own heartbeats that come back feed no deadline and make no link up; where a frame that only this end sends came "
    "back, they reach no handler") {
  for (const Hears hears : {Hears::as_it_leaves, Hears::after_it_left}) {
    for (const bool reports : {false, true}) {
      CAPTURE(hears);
      CAPTURE(reports);
      Heard bench(hears);
      bench.handler.beats = true;
      for (int i = 0; i < 3'000; ++i) {
        if (reports && i % 20 == 0) REQUIRE(bench.link.send(heard::Report{7}) == Status::ok);
        bench.poll();
        REQUIRE(bench.link.state() == LinkState::stale);
        if (i >= 800) REQUIRE(bench.handler.stops == 1);  // which is struck once, and never ends
      }
      CHECK(bench.link.struck(heard::Action::stop));
      bench.handler.beats = false;
      bench.poll(2);
      CHECK(bench.handler.stops == 1);
      CHECK((bench.handler.heartbeats == 0) == reports);
      CHECK(bench.link.counters().own_frames == bench.link.send_account().sent);
      CHECK(bench.link.why() == Why::hears_itself);
    }
  }
}

TEST_CASE("a short while the host is heard ends the link after a second, and the deadline strikes") {
  Heard bench(Hears::nothing);
  bench.handler.beats = true;
  for (int i = 0; i < 1'000; ++i) {
    if (i % 100 == 50) bench.come(frame_of(heard::Heartbeat{}));
    bench.poll();
  }
  REQUIRE(bench.link.state() == LinkState::up);
  REQUIRE(bench.handler.stops == 0);
  REQUIRE(bench.link.why() == Why::nothing);
  bench.hears = Hears::as_it_leaves;  // the host's plug is pulled, and the pins touch
  bench.poll(900);
  CHECK(bench.handler.stops == 1);  // two of them fed it
  bench.poll(200);
  CHECK(bench.link.state() == LinkState::stale);
  CHECK(bench.link.why() == Why::hears_itself);
}

TEST_CASE("a host whose frames equal own ones is heard, also where they meet") {
  Heard bench(Hears::nothing);
  bench.handler.beats = true;
  int host_beats = 0;
  for (int i = 0; i < 20'000; ++i) {
    if (i % 97 == 0) {  // against the 100 ms of this end: in some polls both send
      bench.come(frame_of(heard::Heartbeat{}));
      ++host_beats;
    }
    bench.poll();
    if (i > 200) REQUIRE(bench.link.state() == LinkState::up);
  }
  CHECK(bench.handler.stops == 0);
  CHECK(bench.handler.heartbeats == host_beats);  // no intact frame is lost
  CHECK(bench.link.why() == Why::nothing);
}

TEST_CASE("beside the host, an end that hears itself tells both apart, once a frame that only it sends came back") {
  Heard bench(Hears::as_it_leaves);
  bench.handler.beats = true;
  for (int i = 0; i < 2'000; ++i) {
    if (i % 10 == 0) bench.come(frame_of(heard::Command{static_cast<std::int16_t>(i)}));
    if (i % 50 == 0) REQUIRE(bench.link.send(heard::Report{7}) == Status::ok);
    if (i % 50 == 25) REQUIRE(bench.link.send(heard::Note{1}) == Status::ok);
    if (i % 50 == 30) bench.come(frame_of(heard::Note{2}));
    bench.poll();
  }
  CHECK(bench.handler.speeds.size() == 200);
  CHECK(bench.handler.noted == std::vector<std::uint32_t>(40, 2));
  CHECK(bench.link.state() == LinkState::up);
  CHECK(bench.handler.unknown_frames == 40);
  CHECK(bench.handler.stops == 1);  // the host sends no heartbeat
  CHECK(bench.link.why() == Why::hears_itself);
}

TEST_CASE("where frames of unknown messages are refused, own ones are not frames") {
  using Buffers = diffdrive::McuBuffers<256, 256>;
  Bench<diffdrive::McuLink<Handler, ScriptedPort, Buffers>, Buffers> bench(Hears::as_it_leaves);
  for (int i = 0; i < 100; ++i) {
    REQUIRE(bench.link.send(diffdrive::Odometry{1, 2}) == Status::ok);
    bench.poll(2);
    REQUIRE(bench.link.state() == LinkState::stale);
  }
  CHECK(bench.link.receiver().account().frames == 0);
  CHECK(bench.link.why() == Why::nothing_understood);
}

TEST_CASE("an own hello that comes back is answered twice at most, and says nothing of the peer") {
  using Buffers = native::McuBuffers<256, 512>;
  Bench<native::McuLink<Handler, ScriptedPort, Buffers>, Buffers> bench(Hears::as_it_leaves);
  bench.poll(2'000);
  CHECK(bench.link.peer() == wirebond::Peer::unknown);
  CHECK(bench.link.state() == LinkState::stale);
  CHECK(bench.link.send_account().sent <= 3);
  CHECK(bench.link.why() == Why::hears_itself);
  Bytes frame(native::Hello::Info::max_frame_bytes);
  std::size_t size = 0;
  REQUIRE(native::encode(native::Hello{native::protocol_hash, 1}, frame.data(), frame.size(), size) == Status::ok);
  frame.resize(size);
  bench.hears = Hears::nothing;
  bench.come(frame);  // the host's, which has the same bytes
  bench.poll(2);
  CHECK(bench.link.peer() == wirebond::Peer::same);
  CHECK(bench.link.state() == LinkState::up);
}
