// A port that says whether anybody reads, and one that the program stops: what waits expires, nothing times out, and
// the link comes back. And when a link wants to be polled.
#include "wirebond/mcu/connection.hpp"

#include <doctest/doctest.h>

#include <cstdint>
#include <vector>

#include "diffdrive_link.hpp"
#include "scripted_port.hpp"
#include "wirebond/mcu/link.hpp"

using wirebond::LinkState;
using wirebond::Status;
using wirebond::Why;

namespace {

/// It can be away, and makes its sender wait.
struct UsbPort : ScriptedPort {
  bool connected() const { return is_connected; }
  void stop_receive() { ++receive_stops; }
  void read_to(std::size_t read_place) { read = read_place; }

  bool is_connected = true;
  int receive_stops = 0;
  std::size_t read = 0;
};

struct Rover {
  void on(const diffdrive::Velocity& velocity) { velocities.push_back(velocity.linear); }
  bool fill(diffdrive::Odometry&) { return sends; }
  void stop() { ++stops; }
  void safe_mode() {}

  std::vector<float> velocities;
  int stops = 0;
  bool sends = false;
};

template <class Port, std::size_t receive_bytes = 64>
struct Board {
  void poll(int times = 1) {
    for (; times != 0; --times) {
      link.poll(now_us += ms);
      serve();
    }
  }
  void serve() {
    if (port.pended) {
      port.pended = false;
      link.on_pended();
    }
  }
  void arrive(float linear, std::size_t most = 100) {
    Bytes frame(diffdrive::Velocity::Info::max_frame_bytes);
    std::size_t size = 0;
    REQUIRE(diffdrive::encode(diffdrive::Velocity{linear, 0.0F}, frame.data(), frame.size(), size) == Status::ok);
    frame.resize(size < most ? size : most);
    port.arrive(frame);
    link.on_received();
  }

  std::uint32_t now_us = 0;
  Port port;
  Rover rover;
  diffdrive::McuBuffers<receive_bytes, 128, 8> buffers;
  diffdrive::McuLink<Rover, Port, decltype(buffers)> link{rover, port, buffers};
};

}  // namespace

TEST_CASE("while nobody reads the link is down: sends are refused, deadlines strike, nothing is tried or timed out") {
  Board<UsbPort> board;
  board.port.is_connected = false;
  board.poll(3000);
  CHECK(board.link.state() == LinkState::down);
  CHECK(board.link.why() == Why::not_connected);
  CHECK(board.link.send(diffdrive::Status{}) == Status::link_down);
  CHECK(board.rover.stops == 1);
  CHECK(board.port.receive_starts == 0);
  board.port.is_connected = true;
  board.poll(2);
  board.arrive(0.5F);
  board.poll();
  CHECK(board.rover.velocities == std::vector<float>{0.5F});
  CHECK(board.link.state() == LinkState::up);
  CHECK(board.link.why() == Why::nothing);
}

TEST_CASE("what waits when the reader goes expires, the run under way is broken off, and nothing old leaves later") {
  Board<UsbPort> board;
  board.poll();
  REQUIRE(board.link.send(diffdrive::Status{}) == Status::ok);
  board.serve();
  REQUIRE(board.port.transmit_starts == 1);  // with the port
  for (int i = 0; i < 3; ++i) REQUIRE(board.link.send(diffdrive::Status{}) == Status::ok);
  board.port.is_connected = false;
  board.poll();
  CHECK(board.link.state() == LinkState::down);
  CHECK(board.port.transmit_stops == 1);
  CHECK(board.port.receive_stops == 1);
  board.link.on_transmitted();  // too late
  wirebond::SendAccount account = board.link.send_account();
  CHECK(account.aborted == 1);
  CHECK(account.expired == 3);
  CHECK(account.queued == 0);
  CHECK(account.balances());
  board.poll(2000);
  CHECK(board.link.counters().transmit_timeouts == 0);
  CHECK(board.link.counters().transmit_retries == 0);
  CHECK(board.link.counters().receive_restarts == 0);
  CHECK(board.link.counters().unserved_pends == 0);
  board.port.is_connected = true;
  board.poll(5);
  CHECK(board.port.transmit_starts == 1);
  REQUIRE(board.link.send(diffdrive::Status{}) == Status::ok);
  board.serve();
  CHECK(board.port.transmit_starts == 2);
  account = board.link.send_account();
  CHECK(account.balances());
}

TEST_CASE("it goes and comes at any byte: whole frames are delivered, half ones are not joined, every byte counts") {
  Board<UsbPort> board;
  board.poll(2);
  for (std::size_t cut = 1; cut < 11; ++cut) {
    for (const bool is_looked : {false, true}) {
      board.arrive(0.5F);
      board.arrive(0.25F, cut);
      if (is_looked) board.poll();
      board.port.is_connected = false;
      board.poll(3);
      board.port.is_connected = true;
      board.poll(3);
      board.rover.velocities.clear();
      board.arrive(1.0F);
      board.poll();
      CHECK(board.rover.velocities == std::vector<float>{1.0F});
      CHECK(board.port.read == 11);
      const wirebond::ReceiveAccount ring = board.link.receive_account();
      CHECK(ring.received == ring.handed_out + ring.lapped + ring.dropped + board.link.unread());
    }
  }
}

TEST_CASE("the link does not come back before its interrupt has cleared what waited") {
  Board<UsbPort> board;
  board.poll();
  REQUIRE(board.link.send(diffdrive::Status{}) == Status::ok);
  board.port.is_connected = false;
  board.link.poll(board.now_us += ms);  // and nobody serves the pend
  board.port.pended = false;
  board.port.is_connected = true;
  board.link.poll(board.now_us += ms);
  CHECK(board.link.state() == LinkState::down);
  CHECK(board.port.pended);
  board.serve();
  board.poll();
  CHECK(board.link.state() == LinkState::stale);
  CHECK(board.link.send_account().expired == 1);
}

TEST_CASE("any port can be stopped and started by the program") {
  Board<wirebond::Stoppable<ScriptedPort>> board;
  board.poll();
  board.arrive(0.5F);
  board.poll();
  CHECK(board.link.state() == LinkState::up);
  board.port.stop();
  board.poll();
  CHECK(board.link.state() == LinkState::down);
  CHECK(board.link.why() == Why::not_connected);
  CHECK(board.link.send(diffdrive::Status{}) == Status::link_down);
  board.port.start();
  board.poll();
  CHECK(board.link.state() == LinkState::stale);
  CHECK(board.port.receive_starts == 2);
  board.arrive(0.25F);
  board.poll();
  CHECK(board.rover.velocities == std::vector<float>{0.5F, 0.25F});
}

TEST_CASE("a link that is polled when it is due, and after interrupts, does the same as one that is polled always") {
  for (const bool sends : {false, true}) {
    using Sleeper = Board<ScriptedPort, 1024>;
    Sleeper often, seldom;
    often.rover.sends = seldom.rover.sends = sends;
    int polls = 0, early_ms = 0;
    std::uint32_t due_us = 0;
    for (std::uint32_t now_us = 0; now_us < 4'000'000; now_us += ms) {
      const bool frame_comes = now_us == 500'000 || now_us == 3'700'000;
      bool is_due = static_cast<std::int32_t>(now_us - due_us) >= 0;
      if (frame_comes) {
        often.arrive(0.5F);
        seldom.arrive(0.5F);
        is_due = true;
      }
      for (Sleeper* board : {&often, &seldom}) {
        if (board == &seldom && !is_due) continue;
        board->link.poll(now_us);
        board->serve();
        if (board->port.run.empty()) continue;
        board->port.run.clear();
        board->link.on_transmitted();
      }
      if (is_due) {
        ++polls;
        due_us = seldom.link.next_due_us(now_us);
        CHECK(due_us - now_us <= 100'000);
      }
      CHECK(often.rover.stops <= seldom.rover.stops);
      early_ms += seldom.rover.stops - often.rover.stops;
      CHECK(often.link.state() == seldom.link.state());
      CHECK(often.link.send_account().sent == seldom.link.send_account().sent);
      CHECK(often.port.receive_starts == seldom.port.receive_starts);
    }
    CHECK(often.rover.stops == 1);
    CHECK(early_ms < 45);  // silence counts from the poll before the bytes
    CHECK(polls < (sends ? 400 : 200));
    if (sends) CHECK(often.link.send_account().sent > 70);
  }
}
