// What acts after a reset of the MCU: nothing that is held from the start, nothing of a host of another protocol file,
// and the emergency stop in every case, however late it is.
#include <doctest/doctest.h>

#include <cstdint>
#include <string>
#include <vector>

#include "held_link.hpp"
#include "scripted_port.hpp"
#include "wirebond/mcu/link.hpp"

namespace {

struct Rover : wirebond::ServesBothEnds {
  void on(const held::Drive& drive) { speeds.push_back(drive.speed); }
  void on(const held::Grip& grip) { forces.push_back(grip.force); }
  void on(const held::Say& say) { lines.emplace_back(say.line.data()); }
  void on(const held::Clear&) { ++clears; }
  void stop() { actions += "stop "; }
  void safe_mode() { actions += "safe_mode "; }
  void hush() { actions += "hush "; }

  std::vector<float> speeds;
  std::vector<float> forces;
  std::vector<std::string> lines;
  int clears = 0;
  std::string actions;
};

struct Bench {
  Bench() { link.poll(now_us); }

  template <class Message>
  void come(const Message& message, std::uint32_t after_us = ms) {
    Bytes frame(Message::Info::max_frame_bytes);
    std::size_t size = 0;
    if constexpr (Message::Info::sender == wirebond::End::both) {
      REQUIRE(wirebond::encode_frame<held::FromHost>(message, frame.data(), frame.size(), size) ==
              wirebond::Status::ok);
    } else {
      REQUIRE(held::encode(message, frame.data(), frame.size(), size) == wirebond::Status::ok);
    }
    frame.resize(size);
    port.arrive(frame);
    link.on_received();
    link.poll(now_us += after_us);
    if (port.pended) link.on_pended();
    port.pended = false;
    link.on_transmitted();
  }
  held::Drive drive(float speed) const { return {speed, held::Drive::Mode::manual}; }

  std::uint32_t now_us = 5'000;
  ScriptedPort port;
  Rover rover;
  held::McuBuffers<16'384, 256> buffers;  // 1.4 s of the line
  held::McuLink<Rover, ScriptedPort, decltype(buffers)> link{rover, port, buffers};
};

const held::Hello same{held::protocol_hash, 1};
const held::Hello other{held::protocol_hash + 1, 1};

}  // namespace

TEST_CASE("what is held from the start does not act until somebody recovers, and other messages do") {
  Bench bench;
  CHECK(bench.rover.actions == "safe_mode ");  // the first poll says so
  CHECK(bench.link.struck(held::Action::safe_mode));
  for (int i = 0; i < 100; ++i) bench.come(bench.drive(0.5F));
  CHECK(bench.rover.speeds.empty());
  CHECK(bench.link.counters().held_back == 100);
  bench.come(held::Grip{2.0F});
  CHECK(bench.rover.forces == std::vector<float>{2.0F});
  bench.link.recover(held::Action::safe_mode);
  CHECK_FALSE(bench.link.struck(held::Action::safe_mode));
  bench.come(bench.drive(0.25F));
  CHECK(bench.rover.speeds == std::vector<float>{0.25F});
  CHECK(bench.link.counters().held_back == 100);
  for (int i = 0; i < 1'001; ++i) bench.link.poll(bench.now_us += ms);
  CHECK(bench.rover.actions == "safe_mode stop hush safe_mode ");  // and it strikes again by silence
  bench.come(bench.drive(0.25F));
  CHECK(bench.rover.speeds.size() == 1);
}

TEST_CASE("commands of a host of another protocol file do not act, its hello and pings are answered") {
  Bench bench;
  bench.link.recover(held::Action::safe_mode);
  bench.come(same);
  bench.come(bench.drive(0.5F));
  bench.come(other);
  REQUIRE(bench.link.peer() == wirebond::Peer::different);
  for (int i = 0; i < 300; ++i) bench.come(bench.drive(0.25F));
  bench.come(held::Grip{2.0F});
  CHECK(bench.rover.speeds == std::vector<float>{0.5F});
  CHECK(bench.rover.forces.empty());
  CHECK(bench.link.counters().held_back == 301);
  CHECK(bench.rover.actions == "safe_mode stop ");  // no deadline is put off
  CHECK(bench.link.why() == wirebond::Why::protocol_differs);
  const std::uint32_t sent = bench.link.send_account().sent;
  bench.come(held::Ping{7});
  CHECK(bench.link.send_account().sent == sent + 1);
  bench.come(same);
  bench.come(bench.drive(0.125F));
  CHECK(bench.rover.speeds == std::vector<float>{0.5F, 0.125F});
  CHECK(bench.link.why() == wirebond::Why::nothing);
}

TEST_CASE("an emergency stop acts late, held back, and of a host of another file; it puts off no deadline") {
  for (const char* state : {"late", "held", "strange"}) {
    CAPTURE(state);
    Bench bench;
    if (std::string(state) != "held") {
      bench.link.recover(held::Action::safe_mode);
      bench.come(bench.drive(0.5F));
    }
    if (std::string(state) == "strange") bench.come(other);
    const std::uint32_t after_us = std::string(state) == "late" ? 600 * ms : 20 * ms;
    bench.rover.speeds.clear();
    bench.come(held::emergency_stop_drive(), after_us);
    CHECK(bench.rover.speeds == std::vector<float>{0.1F});
    bench.come(bench.drive(0.1F), after_us);  // another mode: it is not a stop
    bench.come(held::Drive{0.101F, held::Drive::Mode::idle}, after_us);
    CHECK(bench.rover.speeds == std::vector<float>{0.1F});
    CHECK(bench.link.counters().late + bench.link.counters().held_back == 2);
    bench.come(held::emergency_stop_say(), after_us);
    CHECK(bench.rover.lines == std::vector<std::string>{"STOP"});
    if (std::string(state) != "held") {
      held::Say loud;
      loud.line = {'S', 'T', 'O', 'P', 'S'};
      bench.come(loud, after_us);
      CHECK(bench.rover.lines.size() == 1);
    }
    CHECK(bench.link.struck(held::Action::safe_mode) == (std::string(state) != "strange"));
  }
}
