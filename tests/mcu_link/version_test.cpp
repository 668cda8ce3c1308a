// In which version an MCU sends: that of the newest frame of the host, where a format has several.
#include <doctest/doctest.h>

#include <cstdint>

#include "mavlink_link.hpp"
#include "msp_link.hpp"
#include "scripted_port.hpp"
#include "wirebond/mcu/link.hpp"

using wirebond::Status;

namespace {

template <template <class, class, class> class Link, class Buffers, class Handler>
struct Board {
  Board() { poll(); }

  void poll() {
    link.poll(now_us += ms);
    if (port.pended) link.on_pended();
    port.pended = false;
  }
  /// What it answers to these bytes.
  Bytes answer(const Bytes& bytes) {
    port.run.clear();
    port.arrive(bytes);
    link.on_received();
    poll();
    Bytes answers;
    while (!port.run.empty()) {
      answers.insert(answers.end(), port.run.begin(), port.run.end());
      port.run.clear();
      link.on_transmitted();
    }
    return answers;
  }

  std::uint32_t now_us = 0;
  ScriptedPort port;
  Buffers buffers;
  Handler handler{*this};
  Link<Handler, ScriptedPort, Buffers> link{handler, port, buffers};
};

template <class Message, class... Header>
Bytes frame_of(const Message& message, const Header&... header) {
  Bytes frame(Message::Info::max_frame_bytes);
  std::size_t size = 0;
  REQUIRE(encode(message, header..., frame.data(), frame.size(), size) == Status::ok);
  frame.resize(size);
  return frame;
}

struct FlightController;
using Msp = Board<msp::McuLink, msp::McuBuffers<256, 256>, FlightController>;

struct FlightController {
  void on(const msp::ReadAttitude&);
  void on(const msp::ReadVersion&);
  void on(const msp::SetAirSpeed&);

  Msp& board;
};

constexpr std::uint32_t request_1 = 0x244D3C, reply_1 = 0x244D3E, reply_2 = 0x24583E;
constexpr std::uint32_t failed_1 = 0x244D21, failed_2 = 0x245821;

/// An error reply to request 108.
msp::Header failing(std::uint32_t magic) {
  msp::Header header(wirebond::End::mcu);
  header.id = 108;
  header.magic = magic;
  return header;
}

void FlightController::on(const msp::ReadAttitude&) {
  CHECK(board.link.send(msp::Attitude{1.0F, -2.0F, 90}) == Status::ok);
}
void FlightController::on(const msp::ReadVersion&) {
  auto header = board.link.header();
  header.id = 108;
  CHECK(board.link.send(msp::Failed{}, header) == Status::ok);
}
void FlightController::on(const msp::SetAirSpeed&) {
  auto header = board.link.header();
  header.magic = reply_1;
  CHECK(board.link.send(msp::Attitude{}, header) == Status::ok);
}

msp::Header sent_as(std::uint32_t magic, wirebond::End end = wirebond::End::mcu) {
  msp::Header header(end);
  header.magic = magic;
  return header;
}

struct Vehicle;
using Mavlink = Board<mavlink::McuLink, mavlink::McuBuffers<512, 512>, Vehicle>;

struct Vehicle {
  void on(const mavlink::CommandLong&);
  Mavlink& board;
};

void Vehicle::on(const mavlink::CommandLong& command) {
  mavlink::CommandAck ack{};
  ack.command = command.command;
  CHECK(board.link.send(ack) == Status::ok);
}

}  // namespace

TEST_CASE("an MCU answers in the version that it was asked in") {
  Msp board;
  const Bytes request = frame_of(msp::ReadAttitude{});
  const Bytes request_of_1 = frame_of(msp::ReadAttitude{}, sent_as(request_1, wirebond::End::host));
  REQUIRE(request != request_of_1);
  const msp::Attitude attitude{1.0F, -2.0F, 90};
  const Bytes answer = frame_of(attitude, sent_as(reply_2));
  const Bytes answer_of_1 = frame_of(attitude, sent_as(reply_1));
  CHECK(board.answer(request_of_1) == answer_of_1);
  CHECK(board.answer(request) == answer);
  CHECK(board.answer(request_of_1) == answer_of_1);
  Bytes both = request_of_1;  // within one poll
  both.insert(both.end(), request.begin(), request.end());
  Bytes answers = answer_of_1;
  answers.insert(answers.end(), answer.begin(), answer.end());
  CHECK(board.answer(both) == answers);
}

TEST_CASE("a message takes that magic of the version that its frames have") {
  Msp board;
  CHECK(board.answer(frame_of(msp::ReadVersion{}, sent_as(request_1, wirebond::End::host))) ==
        frame_of(msp::Failed{}, failing(failed_1)));
  CHECK(board.answer(frame_of(msp::ReadVersion{})) == frame_of(msp::Failed{}, failing(failed_2)));
}

TEST_CASE("a magic that the program gives is sent") {
  Msp board;
  CHECK(board.answer(frame_of(msp::SetAirSpeed{})) == frame_of(msp::Attitude{}, sent_as(reply_1)));
}

TEST_CASE("one magic of both directions is a version, too") {
  Mavlink board;
  mavlink::Header header(wirebond::End::host);
  mavlink::CommandLong command{};
  command.command = 400;
  CHECK(board.answer(frame_of(command, header)).front() == 0xFD);
  header.magic = 0xFE;
  CHECK(board.answer(frame_of(command, header)).front() == 0xFE);
}
