// A link whose frames have header fields: what it sends, what its handler gets, and which address it listens to.
#include "wirebond/header.hpp"

#include <doctest/doctest.h>

#include <cstdint>
#include <string>
#include <utility>
#include <vector>

#include "headers_link.hpp"
#include "peers_link.hpp"
#include "scripted_port.hpp"

using headers::Header;
using wirebond::Status;

namespace {

struct Servo : wirebond::Subscribed {
  void on(const headers::Move& move, const Header& header) { moves.emplace_back(move.angle, header); }
  void on(const headers::Ask&) { ++asks; }
  void on(const headers::Note&) { without += 1; }  // the other one is called
  void on(const headers::Note&, const Header&) { with += 1; }
  void unknown(const wirebond::Frame&, const Header& header) { strangers.push_back(header.servo); }
  bool fill(headers::Beat& beat, Header& header) {
    beat.count = 9;
    header.hops = hops;
    return has_beat;
  }
  void rest() { ++rests; }
  void link_state(wirebond::LinkState now) { state = now; }

  std::vector<std::pair<float, Header>> moves;
  std::vector<unsigned> strangers;
  wirebond::LinkState state = wirebond::LinkState::down;
  int asks = 0, without = 0, with = 0, rests = 0;
  std::uint8_t hops = 4;
  bool has_beat = false;
};

/// What the host's end decodes, whoever it is from.
struct Host {
  void on(const headers::Answer& answer, const Header& header) { answers.emplace_back(answer.angle, header); }
  void on(const headers::Beat& beat, const Header& header) { beats.emplace_back(beat.count, header); }
  void on(const headers::Pong& pong, const Header& header) { pongs.emplace_back(pong.number, header.servo); }

  std::vector<std::pair<float, Header>> answers;
  std::vector<std::pair<unsigned, Header>> beats;
  std::vector<std::pair<std::uint32_t, unsigned>> pongs;
};

struct Bench {
  Bench() { poll(); }

  void poll(std::uint32_t after_us = ms) {
    now_us += after_us;
    link.poll(now_us);
    if (std::exchange(port.pended, false)) link.on_pended();
    while (!port.run.empty()) {
      const Bytes run = std::exchange(port.run, {});
      receiver.feed(run.data(), run.size(), now_us, host);
      link.on_transmitted();
    }
  }

  template <class Message>
  void arrive(const Message& message, const Header& header) {
    Bytes frame(Message::Info::max_frame_bytes);
    std::size_t size = 0;
    REQUIRE(wirebond::encode_frame<headers::FromHost>(message, frame.data(), frame.size(), size, header) == Status::ok);
    frame.resize(size);
    port.arrive(frame);
    link.on_received();
    poll();
  }
  template <class Message>
  void arrive(const Message& message, std::uint8_t address) {
    Header header(wirebond::End::host);
    header.servo = address;
    arrive(message, header);
  }

  std::uint32_t now_us = 0;
  ScriptedPort port;
  Servo servo;
  headers::McuBuffers<256, 256> buffers;
  headers::McuLink<Servo, ScriptedPort, decltype(buffers)> link{servo, port, buffers};
  Host host;
  headers::Receiver<headers::FromMcu> receiver;
};

const headers::Move half{0.5F};

std::vector<unsigned> heard;  // by the subscription
wirebond::Subscription<headers::Move> with_header([](const headers::Move&, const Header& header) {
  heard.push_back(header.servo);
});
int moved = 0;
wirebond::Subscription<headers::Move> without_header([](const headers::Move&) { ++moved; });

}  // namespace

// ---- values ------------------------------------------------------------------------------------------------------

TEST_CASE("a message without a header carries the defaults of its end, one with a header its values") {
  Bench bench;
  CHECK(bench.link.send(headers::Answer{0.25F}) == Status::ok);
  Header header = bench.link.header();
  header.temperature = 36.6F;
  header.state = Header::State::voltage | Header::State::angle;
  header.kind = Header::Kind::read;
  header.turn = -7;
  CHECK(bench.link.send(headers::Answer{0.5F}, header) == Status::ok);
  bench.poll();
  REQUIRE(bench.host.answers.size() == 2);
  const Header& first = bench.host.answers[0].second;
  CHECK(first.servo == 1);
  CHECK(first.system == 1);  // the MCU's default: the host's is 255
  CHECK(first.kind == Header::Kind::ping);
  CHECK(first.temperature == 0.0F);
  const Header& second = bench.host.answers[1].second;
  CHECK(bench.host.answers[1].first == 0.5F);
  CHECK(second.temperature == 36.6F);
  CHECK(second.state == 3);
  CHECK(second.kind == Header::Kind::read);
  CHECK(second.turn == -7);
}

TEST_CASE("the header's values choose the form, and a value that no form has is refused") {
  Bench bench;
  Header header = bench.link.header();
  header.stamp = 0x1122334455667788;
  CHECK(bench.link.send(headers::Answer{}, header) == Status::out_of_range);  // `state` does not ask for it
  header.state = Header::State::stamped;
  CHECK(bench.link.send(headers::Answer{}, header) == Status::ok);
  bench.poll();
  REQUIRE(bench.host.answers.size() == 1);
  CHECK(bench.host.answers[0].second.stamp == 0x1122334455667788);
}

TEST_CASE("a header value that breaks its field's rule is refused and counted") {
  Bench bench;
  const auto refused = [&](auto change) {
    Header header = bench.link.header();
    change(header);
    return bench.link.send(headers::Answer{}, header) == Status::out_of_range;
  };
  CHECK(refused([](Header& h) { h.temperature = 120.2F; }));
  CHECK(refused([](Header& h) { h.hops = 21; }));
  CHECK(refused([](Header& h) { h.kind = static_cast<Header::Kind>(3); }));
  const wirebond::SendAccount account = bench.link.send_account();
  CHECK(account.refused(wirebond::Refusal::range) == 3);
  CHECK(account.balances());
  bench.poll();
  CHECK(bench.host.answers.empty());
}

TEST_CASE("a received header that breaks a rule keeps its message from the handler") {
  Bench bench;
  Bytes frame(headers::Ask::Info::max_frame_bytes);
  std::size_t size = 0;
  REQUIRE(encode(headers::Ask{}, frame.data(), frame.size(), size) == Status::ok);
  constexpr std::size_t kind = 7;  // in the bits behind `system`
  REQUIRE(frame[kind] == 1);
  frame[kind] = 5;  // no name
  const std::uint64_t check = wirebond::check_end(
      headers::FromHost{}.format().algorithms[0],
      headers::FromHost{}.check_update(0, wirebond::check_begin(headers::FromHost{}.format().algorithms[0]),
                                       frame.data(), size - 2));
  wirebond::store(frame.data() + size - 2, static_cast<std::uint16_t>(check));
  bench.port.arrive(Bytes(frame.begin(), frame.begin() + static_cast<std::ptrdiff_t>(size)));
  bench.link.on_received();
  bench.poll();
  CHECK(bench.servo.asks == 0);
  CHECK(bench.link.receiver().violations().unknown_enum == 1);
  CHECK(bench.link.receiver().violations().rejected == 1);
  CHECK(bench.link.receiver().account().frames == 1);
}

// ---- handlers ----------------------------------------------------------------------------------------------------

TEST_CASE("a handler gets the header where it takes one, and of two functions that one is called") {
  Bench bench;
  Header header(wirebond::End::host);
  header.hops = 20;
  bench.arrive(half, header);
  bench.arrive(headers::Ask{}, header);
  bench.arrive(headers::Note{}, header);
  REQUIRE(bench.servo.moves.size() == 1);
  CHECK(bench.servo.moves[0].first == 0.5F);
  CHECK(bench.servo.moves[0].second.hops == 20);
  CHECK(bench.servo.moves[0].second.system == 255);
  CHECK(bench.servo.asks == 1);
  CHECK(bench.servo.with == 1);
  CHECK(bench.servo.without == 0);
}

TEST_CASE("subscriptions may take the header, each as it likes") {
  heard.clear();
  moved = 0;
  Bench bench;
  bench.arrive(half, 1);
  bench.arrive(half, 9);  // for another
  CHECK(heard == std::vector<unsigned>{1});
  CHECK(moved == 1);
}

TEST_CASE("what fills a scheduled message finds the link's header, and its changes are sent") {
  Bench bench;
  REQUIRE(bench.link.set_address(6));
  bench.servo.has_beat = true;
  for (int i = 0; i < 100; ++i) bench.poll();
  REQUIRE(bench.host.beats.size() == 1);
  CHECK(bench.host.beats[0].first == 9);
  CHECK(bench.host.beats[0].second.servo == 6);
  CHECK(bench.host.beats[0].second.hops == 4);
}

// ---- addresses ---------------------------------------------------------------------------------------------------

TEST_CASE("a link acts on its own address and on broadcasts; others are foreign, and the line is not silent") {
  Bench bench;
  CHECK(bench.link.address() == 1);  // what the host sends by default
  for (const std::uint8_t address : Bytes{1, 2, 0xFE, 3, 0xFF}) bench.arrive(half, address);
  std::vector<unsigned> got;
  for (const auto& [angle, header] : bench.servo.moves) got.push_back(header.servo);
  CHECK(got == std::vector<unsigned>{1, 0xFE, 0xFF});
  CHECK(bench.link.counters().foreign == 2);
  CHECK(bench.link.receiver().account().frames == 5);
  CHECK(bench.link.receiver().bytes() == bench.link.receiver().account().frame_bytes);
}

TEST_CASE("frames for others keep the link up, and put off no deadline") {
  Bench bench;
  bench.arrive(half, 1);
  for (int i = 0; i < 2000; ++i) bench.arrive(half, 2);
  CHECK(bench.servo.state == wirebond::LinkState::up);
  CHECK(bench.servo.rests == 1);
  CHECK(bench.link.counters().foreign == 2000);
}

TEST_CASE("an address can be set, and what the link sends carries it") {
  Bench bench;
  REQUIRE(bench.link.set_address(7));
  bench.arrive(half, 1);
  bench.arrive(half, 7);
  REQUIRE(bench.servo.moves.size() == 1);
  CHECK(bench.servo.moves[0].second.servo == 7);
  CHECK(bench.link.send(headers::Answer{}) == Status::ok);
  bench.poll();
  REQUIRE(bench.host.answers.size() == 1);
  CHECK(bench.host.answers[0].second.servo == 7);
  CHECK(bench.host.answers[0].second.system == 1);
}

TEST_CASE("a broadcast cannot be the own address, so that nobody answers one") {
  Bench bench;
  REQUIRE(bench.link.set_address(7));
  CHECK_FALSE(bench.link.set_address(0xFE));
  CHECK(bench.link.address() == 7);
}

TEST_CASE("services answer what is for the own address, and nothing else") {
  Bench bench;
  REQUIRE(bench.link.set_address(7));
  bench.arrive(headers::Ping{11}, 7);
  bench.arrive(headers::Ping{12}, 0xFE);
  bench.arrive(headers::Ping{13}, 8);
  bench.link.listen_to_all();
  bench.arrive(headers::Ping{14}, 8);
  bench.arrive(headers::Ping{15}, 7);
  bench.poll();
  CHECK(bench.host.pongs == std::vector<std::pair<std::uint32_t, unsigned>>{{11, 7}, {15, 7}});
}

TEST_CASE("a link that listens to all hands out every frame, also of unknown messages") {
  Bench bench;
  const headers::FromHost source;
  const auto stranger = [&](std::uint64_t servo) {
    const std::uint64_t numbers[] = {servo, 0, 0, 255, 1, 0, 0, 0, 0};
    Bytes frame(wirebond::wire_bytes(source.format(), 0));
    frame.resize(wirebond::seal(source, frame.data(), frame.size(), 0x55, 0, 0, numbers));
    bench.port.arrive(frame);
    bench.link.on_received();
    bench.poll();
  };
  stranger(2);
  stranger(1);
  bench.link.listen_to_all();
  stranger(3);
  bench.arrive(half, 4);
  CHECK(bench.servo.strangers == std::vector<unsigned>{1, 3});
  CHECK(bench.servo.moves.size() == 1);
  CHECK(bench.link.counters().foreign == 1);
  CHECK(bench.link.send(headers::Answer{}) == Status::ok);
  bench.poll();
  CHECK(bench.host.answers[0].second.servo == 1);
}

TEST_CASE("a receiver without a link listens to an address in the same way") {
  headers::Receiver<headers::FromHost> receiver;
  Servo servo;
  const auto feed = [&](std::uint8_t address) {
    Header header(wirebond::End::host);
    header.servo = address;
    Bytes frame(headers::Move::Info::max_frame_bytes);
    std::size_t size = 0;
    REQUIRE(encode(half, header, frame.data(), frame.size(), size) == Status::ok);
    receiver.feed(frame.data(), size, 0, servo);
  };
  feed(1);
  feed(2);
  CHECK(servo.moves.size() == 1);
  REQUIRE(receiver.set_address(2));
  feed(1);
  feed(2);
  CHECK(servo.moves.size() == 2);
  CHECK(receiver.foreign() == 2);
  CHECK(receiver.account().frames == 4);
}

// ---- frames that name both their receiver and their sender -------------------------------------------------------

namespace {

struct Asker : wirebond::ServesBothEnds {
  void on(const peers::Pong& pong, const peers::Header& header) { pongs.emplace_back(pong.number, header.source); }
  std::vector<std::pair<std::uint32_t, unsigned>> pongs;
};

/// A link at either end of `peers`, and what it sends.
template <class Link, class Memory>
struct Peer {
  Peer() { exchange(); }

  /// A poll, and what leaves by it.
  Bytes exchange() {
    link.poll(now_us += ms);
    if (std::exchange(port.pended, false)) link.on_pended();
    Bytes sent;
    while (!port.run.empty()) {
      const Bytes run = std::exchange(port.run, {});
      sent.insert(sent.end(), run.begin(), run.end());
      link.on_transmitted();
    }
    return sent;
  }
  Bytes take(const Bytes& bytes) {
    port.arrive(bytes);
    link.on_received();
    return exchange();
  }

  std::uint32_t now_us = 0;
  ScriptedPort port;
  Asker handler;
  Memory memory;
  Link link{handler, port, memory};
};

using McuMemory = peers::McuBuffers<256, 256>;
using HostMemory = peers::HostBuffers<256, 256>;
using McuPeer = Peer<peers::McuLink<Asker, ScriptedPort, McuMemory>, McuMemory>;
using HostPeer = Peer<peers::HostLink<Asker, ScriptedPort, HostMemory>, HostMemory>;

}  // namespace

TEST_CASE("the file's stop has its header beside it") {
  constexpr Header header = headers::header_of_emergency_stop();
  static_assert(headers::emergency_stop().angle == 0.0F);
  static_assert(header.servo == 0xFE && header.temperature == 21.5F && header.kind == Header::Kind::read);
  static_assert(header.system == 255);  // the host's, where the file says nothing
}

TEST_CASE("a host that asked one takes no other's reply") {
  Host host;
  headers::Receiver<headers::FromMcu> receiver;
  std::uint32_t now_us = 0;
  const auto arrive = [&](const auto& message, std::uint8_t servo) {
    Header header(wirebond::End::mcu);
    header.servo = servo;
    std::uint8_t frame[64];
    std::size_t size = 0;
    REQUIRE(wirebond::encode_frame<headers::FromMcu>(message, frame, sizeof frame, size, header) == Status::ok);
    receiver.feed(frame, size, now_us += ms, host);
  };
  receiver.expect<headers::Ask>(3);
  arrive(headers::Answer{0.25F}, 4);
  CHECK(host.answers.empty());
  CHECK(receiver.foreign() == 1);
  CHECK(receiver.account().frames == 1);
  arrive(headers::Answer{0.5F}, 3);
  arrive(headers::Beat{7}, 4);  // that is not a reply to what was asked
  CHECK(host.answers.size() == 1);
  CHECK(host.answers.back().second.servo == 3);
  CHECK(host.beats.size() == 1);
  CHECK(receiver.foreign() == 1);
  receiver.expect<headers::Ask>(0xFE);  // a broadcast asks everybody
  arrive(headers::Answer{0.5F}, 4);
  receiver.expect<headers::Ask>();
  arrive(headers::Answer{0.5F}, 5);
  CHECK(host.answers.size() == 3);
  CHECK(receiver.foreign() == 1);
}

namespace {

/// A host on a line with many servos.
struct Master {
  Master() { poll(); }

  void poll() {
    link.poll(now_us += ms);
    if (std::exchange(port.pended, false)) link.on_pended();
    while (!std::exchange(port.run, {}).empty()) link.on_transmitted();
  }
  template <class Message>
  void ask(const Message& request, std::uint8_t servo) {
    Header header = link.header();
    header.servo = servo;
    REQUIRE(link.send(request, header) == Status::ok);
    poll();
  }
  /// What of these servos' answers reaches the handler.
  std::vector<unsigned> answers_of(const std::vector<std::uint8_t>& servos) {
    host.answers.clear();
    for (const std::uint8_t servo : servos) arrive(headers::Answer{0.5F}, servo);
    std::vector<unsigned> came;
    for (const auto& answer : host.answers) came.push_back(answer.second.servo);
    return came;
  }
  template <class Message>
  void arrive(const Message& message, std::uint8_t servo) {
    Header header(wirebond::End::mcu);
    header.servo = servo;
    Bytes frame(Message::Info::max_frame_bytes);
    std::size_t size = 0;
    REQUIRE(wirebond::encode_frame<headers::FromMcu>(message, frame.data(), frame.size(), size, header) == Status::ok);
    frame.resize(size);
    port.arrive(frame);
    link.on_received();
    poll();
  }

  std::uint32_t now_us = 0;
  ScriptedPort port;
  Host host;
  headers::HostBuffers<256, 256> buffers;
  headers::HostLink<Host, ScriptedPort, decltype(buffers)> link{host, port, buffers};
};

using Servos = std::vector<unsigned>;

}  // namespace

TEST_CASE("a host's link takes a reply from the addresses that it has asked for it") {
  Master master;
  CHECK(master.answers_of({3, 4}) == Servos{3, 4});  // nobody was asked
  master.ask(headers::Ask{}, 3);
  CHECK(master.answers_of({4, 3, 5}) == Servos{3});
  CHECK(master.link.counters().foreign == 2);
  CHECK(master.link.receiver().account().frames == 5);  // delivered all the same
  master.ask(headers::Ask{}, 5);                        // before the answer to an earlier request came
  CHECK(master.answers_of({4, 3, 5}) == Servos{3, 5});
  CHECK(master.link.send(headers::Ask{}) == Status::ok);  // to the file's default
  CHECK(master.answers_of({4, 1}) == Servos{1});
}

TEST_CASE("at a host's link each reply has addresses of its own, and what is not a reply has none") {
  Master master;
  master.ask(headers::Ask{}, 3);
  master.ask(headers::Move{}, 7);  // has no reply
  master.arrive(headers::Pong{9}, 4);
  master.arrive(headers::Beat{9}, 4);
  CHECK(master.host.pongs.size() == 1);
  CHECK(master.host.beats.size() == 1);
  CHECK(master.answers_of({7}).empty());
}

TEST_CASE("at a host's link a request that was not sent asks nobody") {
  Master master;
  Header header = master.link.header();
  header.servo = 3;
  header.hops = 21;
  CHECK(master.link.send(headers::Ask{}, header) == Status::out_of_range);
  CHECK(master.answers_of({4}) == Servos{4});
}

TEST_CASE("at a host's link a broadcast asks everybody, and a monitor takes all replies") {
  Master master;
  master.ask(headers::Ask{}, 3);
  CHECK(master.answers_of({4}).empty());
  SUBCASE("a broadcast") { master.ask(headers::Ask{}, 0xFE); }
  SUBCASE("the other one") { master.ask(headers::Ask{}, 0xFF); }
  SUBCASE("a monitor") { master.link.listen_to_all(); }
  CHECK(master.answers_of({4, 3}) == Servos{4, 3});
  CHECK(master.link.counters().foreign == 1);
}

TEST_CASE("a host's link remembers sixteen addresses at least, by the newest request to each") {
  Master master;
  for (std::uint8_t round = 0; round < 5; ++round) {
    for (std::uint8_t servo = 1; servo <= 100; ++servo) {
      master.ask(headers::Ask{}, 200);  // again and again, so it is never forgotten
      master.ask(headers::Ask{}, servo);
      if (servo < 15) continue;
      const auto oldest = static_cast<std::uint8_t>(servo - 14);
      CHECK(master.answers_of({servo, oldest, 200, 201}) == Servos{servo, oldest, 200});
    }
  }
}

TEST_CASE("each end listens for its own address, and a service answers whoever asked") {
  McuPeer mcu;
  HostPeer host, other;
  REQUIRE(other.link.set_address(40));
  CHECK(mcu.link.address() == 1);
  CHECK(host.link.address() == 255);
  CHECK(host.link.send(peers::Ping{1}) == Status::ok);
  CHECK(other.link.send(peers::Ping{2}) == Status::ok);
  Bytes answers = mcu.take(host.exchange());
  const Bytes second = mcu.take(other.exchange());
  answers.insert(answers.end(), second.begin(), second.end());
  host.take(answers);
  other.take(answers);
  CHECK(host.handler.pongs == std::vector<std::pair<std::uint32_t, unsigned>>{{1, 1}});
  CHECK(other.handler.pongs == std::vector<std::pair<std::uint32_t, unsigned>>{{2, 1}});
  CHECK(host.link.counters().foreign == 1);
  CHECK(other.link.counters().foreign == 1);
}

TEST_CASE("what an end sends carries the address that it was given, and an address that no field holds is refused") {
  McuPeer mcu;
  HostPeer host;
  CHECK_FALSE(mcu.link.set_address(256));  // the receiver's field has 8 bits
  CHECK(mcu.link.address() == 1);
  REQUIRE(mcu.link.set_address(9));
  peers::Header header = host.link.header();
  CHECK(header.target == 1);
  CHECK(header.source == 255);
  header.target = 9;
  CHECK(host.link.send(peers::Ping{3}, header) == Status::ok);
  header.target = 0;
  CHECK(host.link.send(peers::Ping{4}, header) == Status::ok);
  CHECK(host.link.send(peers::Ping{5}) == Status::ok);  // for 1
  host.take(mcu.take(host.exchange()));
  CHECK(host.handler.pongs == std::vector<std::pair<std::uint32_t, unsigned>>{{3, 9}});
  CHECK(mcu.link.counters().foreign == 1);
}
