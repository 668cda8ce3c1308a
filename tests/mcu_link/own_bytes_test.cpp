// A link on a line that echoes: own bytes reach nobody, those of others do, and what comes back otherwise is a
// collision.
#include <doctest/doctest.h>

#include <cstdint>
#include <vector>

#include "bus_link.hpp"
#include "scripted_port.hpp"
#include "wirebond/mcu/link.hpp"

using wirebond::Status;
using wirebond::Why;

namespace {

struct Handler {
  void on(const bus::Ask& ask) { asked.push_back(ask.number); }
  void on(const bus::Note& note) { noted.push_back(note.number); }

  std::vector<std::uint32_t> asked;
  std::vector<std::uint32_t> noted;
};

template <class Message>
Bytes frame_of(const Message& message) {
  Bytes frame(Message::Info::max_frame_bytes);
  std::size_t size = 0;
  REQUIRE(bus::encode(message, frame.data(), frame.size(), size) == Status::ok);
  frame.resize(size);
  return frame;
}

struct Board {
  Board() { poll(); }

  void poll(int times = 1) {
    for (; times != 0; --times) {
      link.poll(now_us += ms);
      if (port.pended) link.on_pended();
      port.pended = false;
    }
  }
  /// Sends, and the run leaves. What was on the line; nothing: the port was not given a run.
  Bytes send(std::uint32_t number) {
    port.run.clear();
    REQUIRE(link.send(bus::Note{number}) == Status::ok);
    if (port.pended) link.on_pended();
    port.pended = false;
    if (!port.run.empty()) link.on_transmitted();
    return port.run;
  }
  void come(const Bytes& bytes) {
    port.arrive(bytes);
    link.on_received();
    poll();
  }
  bool closes() const { return link.receive_account().handed_out == link.receiver().bytes() + link.counters().echoed; }

  std::uint32_t now_us = 0;
  ScriptedPort port;
  Handler handler;
  bus::McuBuffers<256, 256> buffers;
  bus::McuLink<Handler, ScriptedPort, decltype(buffers)> link{handler, port, buffers};
};

}  // namespace

TEST_CASE("own frames reach no handler, and those of the other end before and behind them do") {
  Board board;
  board.port.arrive(frame_of(bus::Ask{1}));  // nobody has read it yet
  const Bytes own = board.send(7);
  REQUIRE(own.size() == frame_of(bus::Note{7}).size());
  board.port.arrive(own);
  board.come(frame_of(bus::Note{8}));
  CHECK(board.handler.asked == std::vector<std::uint32_t>{1});
  CHECK(board.handler.noted == std::vector<std::uint32_t>{8});
  CHECK(board.link.counters().echoed == own.size());
  CHECK(board.link.counters().collisions == 0);
  CHECK(board.link.receiver().account().frames == 2);
  CHECK(board.link.why() == Why::nothing);
  CHECK(board.closes());
  board.poll(100);
  CHECK(board.link.counters().collisions == 0);
}

TEST_CASE(
    "own bytes alone are silence of the other end: an incomplete frame of it is given up, and the link is stale") {
  Board board;
  board.come(frame_of(bus::Ask{1}));
  CHECK(board.link.state() == wirebond::LinkState::up);
  const Bytes begun = frame_of(bus::Ask{2});
  board.come({begun.begin(), begun.begin() + 4});
  CHECK(board.link.receiver().pending() == 4);
  for (int i = 0; i < 1100; ++i) board.come(board.send(7));
  CHECK(board.link.receiver().pending() == 0);
  CHECK(board.link.state() == wirebond::LinkState::stale);
  CHECK(board.closes());
}

TEST_CASE("what comes back otherwise is a collision, told when nothing more of it can come") {
  Board board;
  for (int i = 0; i < 3; ++i) board.come(board.send(7));
  Bytes own = board.send(8);
  own[5] ^= 1;
  board.come(own);
  CHECK(board.link.counters().collisions == 0);
  const std::uint32_t due_us = board.link.next_due_us(board.now_us);
  CHECK(due_us - board.now_us < 100'000);
  while (board.now_us < due_us + 60 * ms) board.poll();
  CHECK(board.link.counters().collisions == 1);
  CHECK(board.handler.noted.empty());  // its check does not hold
  board.come(frame_of(bus::Ask{1}));
  CHECK(board.handler.asked == std::vector<std::uint32_t>{1});
  CHECK(board.link.why() == Why::many_collisions);
  CHECK(board.closes());
}

TEST_CASE("a line that does not echo loses no frame, and says what is wrong") {
  Board board;
  for (std::uint32_t i = 1; i <= 30; ++i) {
    static_cast<void>(board.send(i));
    board.come(frame_of(bus::Ask{i}));
    board.poll(20);
    CHECK(board.handler.asked.size() == i);  // one that ends like an own one begins is held back for some milliseconds
  }
  CHECK(board.link.counters().echoed == 0);
  CHECK(board.link.counters().collisions > 0);
  CHECK(board.link.why() == Why::no_echo);
}

TEST_CASE("what was not heard yet holds the next run back, which leaves when it was") {
  Board board;
  std::vector<Bytes> runs;
  do {
    runs.push_back(board.send(static_cast<std::uint32_t>(runs.size())));
  } while (!runs.back().empty());
  runs.pop_back();
  CHECK(runs.size() >= 4);
  CHECK(board.link.counters().transmit_retries == 0);
  for (const Bytes& run : runs) board.port.arrive(run);
  board.link.on_received();
  board.poll(2);
  CHECK(board.port.run == frame_of(bus::Note{static_cast<std::uint32_t>(runs.size())}));
  CHECK(board.link.counters().collisions == 0);
}

TEST_CASE("a run that the port did not take is not expected") {
  Board board;
  board.port.refuses_transmit = true;
  REQUIRE(board.send(7).empty());
  board.poll(5);
  board.come(frame_of(bus::Note{7}));  // the other end's
  CHECK(board.handler.noted == std::vector<std::uint32_t>{7});
  board.port.refuses_transmit = false;
  board.poll(2);
  const Bytes run = board.port.run;
  REQUIRE_FALSE(run.empty());
  board.link.on_transmitted();
  board.come(run);
  CHECK(board.link.counters().echoed == run.size());
  CHECK(board.link.counters().collisions == 0);
}
