// How senders, poll and the UART's interrupt agree: the table of handshake.hpp line by line, and what a link makes of
// it in orders of events that real drivers produce.
#include "wirebond/mcu/handshake.hpp"

#include <doctest/doctest.h>

#include <cstdint>
#include <utility>

#include "aging_link.hpp"
#include "scripted_port.hpp"
#include "wirebond/mcu/link.hpp"

using Handshake = wirebond::Handshake<>;
using wirebond::Line;

TEST_CASE("who offers a frame pends the interrupt, unless that looks again by itself") {
  Handshake line;
  CHECK(line.look().line() == Line::idle);
  CHECK(line.offer());
  CHECK(line.offer());  // a request may get lost, so each of them pends
  CHECK(line.take() == Handshake::Work::look);
  CHECK(line.look().line() == Line::looking);
  CHECK_FALSE(line.look().offered());
  CHECK_FALSE(line.offer());
  CHECK_FALSE(line.rest());  // looks again
  CHECK(line.rest());
  CHECK(line.look().line() == Line::idle);
  CHECK(line.offer());
}

TEST_CASE("a run is sent once, and only its own complete event ends it") {
  Handshake line;
  CHECK_FALSE(line.complete());
  CHECK(line.take() == Handshake::Work::look);
  CHECK_FALSE(line.complete());
  line.found();
  CHECK(line.look().line() == Line::sending);
  CHECK(line.take() == Handshake::Work::none);
  CHECK_FALSE(line.offer());
  CHECK(line.complete());
  CHECK_FALSE(line.complete());
  CHECK(line.look().line() == Line::looking);
  CHECK(line.rest());  // the offer was taken with the run's end
}

TEST_CASE("a run that the port refuses is asked for again") {
  Handshake line;
  static_cast<void>(line.take());
  line.found();
  line.refuse();
  CHECK(line.look().line() == Line::refused);
  CHECK(line.look().asks());
  CHECK_FALSE(line.complete());
  CHECK(line.offer());
  CHECK(line.take() == Handshake::Work::look);
}

TEST_CASE("only a run that poll has seen for long is broken off, and never the one behind it") {
  Handshake line;
  CHECK_FALSE(line.ask_abort());
  static_cast<void>(line.take());
  line.found();
  CHECK_FALSE(line.ask_abort());  // begun since poll looked
  line.note(false);
  CHECK(line.ask_abort());
  SUBCASE("it is broken off") {
    CHECK(line.take() == Handshake::Work::abort);
    CHECK(line.look().line() == Line::looking);
    CHECK_FALSE(line.complete());
  }
  SUBCASE("it left after all") {
    CHECK(line.complete());
    line.found();
    CHECK(line.take() == Handshake::Work::none);
    CHECK(line.look().line() == Line::sending);
  }
  SUBCASE("it left after all, and nothing follows") {
    CHECK(line.complete());
    CHECK(line.rest());
    CHECK(line.take() == Handshake::Work::look);
  }
}

TEST_CASE("a restart that is asked for stands until it is done, whatever is sent") {
  Handshake line;
  line.ask_restart();
  CHECK(line.look().asks());
  static_cast<void>(line.take());
  line.found();
  CHECK(line.complete());
  CHECK(line.rest());
  CHECK(line.look().restart());
  line.restarted();
  CHECK_FALSE(line.look().asks());
}

namespace {

struct Board {
  explicit Board(std::uint32_t start_us) : now_us(start_us) { poll(0); }

  void poll(std::uint32_t after_us) {
    now_us += after_us;
    link.poll(now_us);
  }
  void serve() {
    if (!port.pended) return;
    port.pended = false;
    link.on_pended();
  }
  std::size_t sent() const { return link.send_account().sent; }
  std::size_t expired() const { return link.send_account().expired; }

  std::uint32_t now_us;
  struct Nothing {
  } nothing;
  ScriptedPort port;
  aging::McuBuffers<64, 128> buffers;
  aging::McuLink<Nothing, ScriptedPort, decltype(buffers)> link{nothing, port, buffers};
};

/// A port whose runs take as long as the other end likes.
struct PatientBoard {
  struct Port : ScriptedPort {
    static constexpr bool may_wait = true;
  };

  std::uint32_t now_us = 0;
  struct Nothing {
  } nothing;
  Port port;
  aging::McuBuffers<64, 128> buffers;
  aging::McuLink<Nothing, Port, decltype(buffers)> link{nothing, port, buffers};
};

}  // namespace

TEST_CASE("a request of the interrupt that got lost is repeated by the next poll") {
  Board board(0);
  REQUIRE(board.link.send(aging::Report{}) == wirebond::Status::ok);
  REQUIRE(board.port.pended);
  board.port.pended = false;  // the UART was initialised again, say
  board.poll(1'000);
  CHECK(board.port.pended);
  board.serve();
  CHECK(board.port.transmit_starts == 1);
  board.link.on_transmitted();
  board.poll(1'000);
  CHECK_FALSE(board.port.pended);
}

TEST_CASE("a run that leaves while poll gives it up takes no other run with it") {
  Board board(0);
  REQUIRE(board.link.send(aging::Report{}) == wirebond::Status::ok);
  board.serve();
  board.poll(1'000);  // sees it begun
  REQUIRE(board.link.send(aging::Report{}) == wirebond::Status::ok);
  while (!board.port.pended) board.poll(1'000);  // gives it up
  board.link.on_transmitted();                   // which comes before the interrupt that poll has pended
  CHECK(board.port.transmit_starts == 2);
  board.serve();
  CHECK(board.port.transmit_stops == 0);
  board.link.on_transmitted();
  CHECK(board.sent() == 2);
  CHECK(board.link.send_account().aborted == 0);
  CHECK(board.link.send_account().balances());
}

TEST_CASE("a frame expires when it has waited for max_age, also where the clock of 32 bits wraps meanwhile") {
  // The last one has the wrap of the units of 16 bits in it, the last but one that of the clock.
  for (const std::uint32_t start : {0u, 0u - 3'000u, (1u << 26) - 3'000u}) {
    for (const bool is_latest : {false, true}) {
      CAPTURE(start);
      CAPTURE(is_latest);
      Board board(start);
      const auto send = [&] { return is_latest ? board.link.send(aging::Newest{}) : board.link.send(aging::Report{}); };
      REQUIRE(send() == wirebond::Status::ok);
      board.poll(6'000);  // across the wrap
      board.serve();
      CHECK(board.expired() == 0);
      CHECK(board.port.transmit_starts == 1);
      board.link.on_transmitted();
      CHECK(board.sent() == 1);

      board.now_us = start;
      board.poll(0);
      REQUIRE(send() == wirebond::Status::ok);
      board.poll(50'000);
      board.serve();
      CHECK(board.expired() == 0);  // not before its time
      board.link.on_transmitted();

      board.now_us = start;
      board.poll(0);
      REQUIRE(send() == wirebond::Status::ok);
      board.poll(53'000);
      board.serve();
      CHECK(board.expired() == 1);
      CHECK(board.sent() == 2);
      CHECK(board.link.send_account().balances());
    }
  }
}

TEST_CASE("a frame that waited through a pause of any length has expired, and one that was sent behind it leaves") {
  for (const std::uint32_t pause_us : {60 * ms, 1'000 * ms, 40'000 * ms, 66'000 * ms, 67'109 * ms, 67'120 * ms,
                                       134'218 * ms, 3'000'000 * ms, 4'200'000 * ms}) {
    for (const std::uint32_t start : {0u, 0u - 3'000u}) {
      for (const bool is_latest : {false, true}) {
        CAPTURE(pause_us);
        CAPTURE(start);
        CAPTURE(is_latest);
        Board board(start);
        const auto send = [&] {
          return is_latest ? board.link.send(aging::Newest{}) : board.link.send(aging::Report{});
        };
        board.poll(1'000);
        REQUIRE(send() == wirebond::Status::ok);
        board.poll(pause_us);
        board.serve();
        CHECK(board.expired() == 1);
        CHECK(board.port.transmit_starts == 0);
        board.port.pended = true;  // by a send before the interrupt has run
        board.poll(pause_us);
        REQUIRE(send() == wirebond::Status::ok);
        board.serve();
        CHECK(board.expired() == 1);
        CHECK(board.port.transmit_starts == 1);
        CHECK(board.link.send_account().balances());
      }
    }
  }
}

TEST_CASE("what waits behind a run that takes minutes expires meanwhile, or when the run has left") {
  for (const std::uint32_t seconds : {20u, 66u, 67u, 68u, 135u}) {
    for (const bool is_served : {true, false}) {
      CAPTURE(seconds);
      CAPTURE(is_served);
      PatientBoard board;
      board.link.poll(board.now_us);
      REQUIRE(board.link.send(aging::Report{}) == wirebond::Status::ok);
      board.link.on_pended();
      REQUIRE(board.port.transmit_starts == 1);
      REQUIRE(board.link.send(aging::Report{}) == wirebond::Status::ok);
      REQUIRE(board.link.send(aging::Newest{}) == wirebond::Status::ok);
      for (std::uint32_t i = 0; i < seconds * 20; ++i) {
        board.link.poll(board.now_us += 50 * ms);
        if (is_served && std::exchange(board.port.pended, false)) board.link.on_pended();
      }
      board.link.on_transmitted();
      CHECK(board.link.send_account().sent == 1);
      CHECK(board.link.send_account().expired == 2);
      CHECK(board.port.transmit_starts == 1);
      CHECK(board.link.send_account().balances());
    }
  }
}

TEST_CASE("what is sent just before a run of minutes has left is not taken for old") {
  for (const std::uint32_t seconds : {20u, 66u, 135u}) {
    CAPTURE(seconds);
    PatientBoard board;
    board.link.poll(board.now_us);
    REQUIRE(board.link.send(aging::Report{}) == wirebond::Status::ok);
    board.link.on_pended();
    for (std::uint32_t i = 0; i < seconds * 20; ++i) {
      board.port.arrive({0x00});  // without it, reception begins again each second, in the same interrupt
      board.link.poll(board.now_us += 50 * ms);
      if (std::exchange(board.port.pended, false)) board.link.on_pended();
    }
    REQUIRE(board.link.send(aging::Report{}) == wirebond::Status::ok);
    board.link.on_transmitted();
    CHECK(board.port.transmit_starts == 2);
    CHECK(board.link.send_account().expired == 0);
  }
}
