// The MCU's link raises sequence numbers as it hands frames to DMA, and counts those that are missing. One test for
// each way in which a frame waits: not stuffed, under COBS with more than one code, escaped.
#include <doctest/doctest.h>

#include <array>
#include <cstdint>
#include <cstdlib>
#include <random>
#include <vector>

#include "cobs_link.hpp"
#include "escaped_link.hpp"
#include "plain_link.hpp"
#include "scripted_port.hpp"

namespace {

#define WIRE(Name, space, per)                                                                                  \
  struct Name {                                                                                                 \
    using Report = space::Report;                                                                               \
    using Alarm = space::Alarm;                                                                                 \
    using Newest = space::Newest;                                                                               \
    using Command = space::Command;                                                                             \
    using Header = space::Header;                                                                               \
    using FromMcu = space::FromMcu;                                                                             \
    using FromHost = space::FromHost;                                                                           \
    template <class Handler, class Port, class Memory>                                                          \
    using Link = space::McuLink<Handler, Port, Memory>;                                                         \
    using Buffers = space::McuBuffers<1024, 2048, 8>;                                                           \
    static constexpr bool per_message = per;                                                                    \
    static constexpr std::uint32_t range = 1u << (8 * sizeof(Header::sequence));                                \
    static bool encode(const Command& command, const Header& header, std::uint8_t* out, std::size_t& size) {    \
      return space::encode(command, header, out, Command::Info::max_frame_bytes, size) == wirebond::Status::ok; \
    }                                                                                                           \
  }
WIRE(Plain, plain, false);
WIRE(Cobs, cobs, true);
WIRE(Escaped, escaped, false);
#undef WIRE

struct Nothing {};

/// The far end: every frame's message and number.
struct Listener {
  template <class Message, class Header>
  void take(const Message& message, const Header& header) {
    messages.push_back(Message::Info::index);
    numbers.push_back(header.sequence);
    values.push_back(message.number);
  }
  std::vector<int> messages;
  std::vector<std::uint32_t> numbers;
  std::vector<std::uint32_t> values;
};

template <class Wire>
struct Host : Listener {
  void on(const typename Wire::Report& m, const typename Wire::Header& h) { take(m, h); }
  void on(const typename Wire::Alarm& m, const typename Wire::Header& h) { take(m, h); }
  void on(const typename Wire::Newest& m, const typename Wire::Header& h) { take(m, h); }
};

template <class Wire>
struct Bench {
  void poll(std::uint32_t after_us = ms) {
    now_us += after_us;
    link.poll(now_us);
    serve();
  }
  void serve() {
    if (!port.pended) return;
    port.pended = false;
    link.on_pended();
  }
  /// One run leaves and arrives. False: there is none.
  bool leave() {
    serve();
    if (port.run.empty()) return false;
    receiver.feed(port.run.data(), port.run.size(), now_us, host);
    port.run.clear();
    link.on_transmitted();
    return true;
  }
  template <class Message>
  wirebond::Status send(std::size_t bytes = 0) {
    Message message;
    message.number = ++last_value;
    if constexpr (std::is_same_v<Message, typename Wire::Report>) {
      std::vector<std::uint8_t> data(bytes);
      constexpr std::uint8_t likely[] = {0x00, 0x7D, 0x7E, 0x55};
      for (std::uint8_t& byte : data) byte = likely[random() % 4];
      REQUIRE(message.data.assign(data.data(), data.size()));
    }
    return link.send(message);
  }

  std::mt19937 random{7};
  std::uint32_t now_us = 0;
  std::uint32_t last_value = 0;
  ScriptedPort port;
  Nothing handler;
  typename Wire::Buffers buffers{};
  typename Wire::template Link<Nothing, ScriptedPort, typename Wire::Buffers> link{handler, port, buffers};
  Host<Wire> host;
  wirebond::Receiver<typename Wire::FromMcu> receiver;
};

/// Do the numbers rise by one on the wire, from 0 on?
template <class Wire>
bool rise_by_one(const Listener& host) {
  std::array<std::uint32_t, 8> next{};
  bool good = true;
  for (std::size_t i = 0; i < host.numbers.size(); ++i) {
    std::uint32_t& expected = next[Wire::per_message ? static_cast<std::size_t>(host.messages[i]) : 0];
    good = good && host.numbers[i] == expected % Wire::range;
    expected = (host.numbers[i] + 1) % Wire::range;
  }
  return good;
}

template <class Wire>
void numbers_rise_whatever_becomes_of_other_frames() {
  Bench<Wire> at;
  at.poll();
  std::size_t refused = 0;
  for (unsigned round = 0; round < 4000; ++round) {
    switch (at.random() % 8) {
      case 0: refused += at.template send<typename Wire::Alarm>() != wirebond::Status::ok; break;
      case 1: refused += at.template send<typename Wire::Newest>() != wirebond::Status::ok; break;
      case 2: {
        typename Wire::Report wrong;
        wrong.level = 200.0f;  // beyond its range: refused after its room was reserved
        CHECK(at.link.send(wrong) != wirebond::Status::ok);
        break;
      }
      case 3: at.port.refuses_transmit = at.random() % 2 == 0; break;  // a run that is refused is offered again
      case 4:  // what waited for 60 ms has expired, but for a run that the port refused
        at.port.refuses_transmit = true;
        at.leave();
        at.poll(at.random() % 4 == 0 ? 60 * ms : ms);
        at.port.refuses_transmit = false;
        break;
      case 5: at.leave(); break;
      default: refused += at.template send<typename Wire::Report>(at.random() % 280) != wirebond::Status::ok; break;
    }
  }
  at.port.refuses_transmit = false;
  at.poll();
  while (at.leave()) {
  }
  const wirebond::SendAccount account = at.link.send_account();
  CHECK(refused > 0);
  CHECK(account.refused(wirebond::Refusal::range) > 0);
  CHECK(account.refused(wirebond::Refusal::full) > 0);
  CHECK(account.replaced > 0);
  CHECK(account.expired > 0);
  CHECK(account.balances());
  CHECK(at.host.numbers.size() == account.sent);
  CHECK(account.sent > 500);
  CHECK(rise_by_one<Wire>(at.host));
  CHECK(at.receiver.sequence().numbered == account.sent);
  CHECK(at.receiver.sequence().gaps + at.receiver.sequence().repeats + at.receiver.sequence().restarts == 0);
  CHECK(at.receiver.account().frame_bytes + at.receiver.account().fill_bytes == at.receiver.bytes());
}

template <class Wire>
struct Missing {
  std::vector<std::uint8_t> bytes;
  std::uint32_t sent = 0;
  std::uint32_t removed = 0;

  /// One frame of the host, or its place in the count alone.
  void add(bool is_removed) {
    typename Wire::Header header;
    header.sequence = static_cast<decltype(header.sequence)>(sent++);
    removed += is_removed;
    if (is_removed) return;
    std::array<std::uint8_t, Wire::Command::Info::max_frame_bytes> frame;
    std::size_t size = 0;
    REQUIRE(Wire::encode({}, header, frame.data(), size));
    bytes.insert(bytes.end(), frame.begin(), frame.begin() + static_cast<std::ptrdiff_t>(size));
  }
};

/// As tests/test_sequence.py asks it of the host's decoder.
template <class Wire>
void gaps_are_exact(std::uint32_t frames) {
  std::mt19937 random(3);
  Missing<Wire> stream;
  struct Ignored {
  } nobody;
  wirebond::Receiver<typename Wire::FromHost> receiver;
  while (stream.sent < frames) {
    stream.bytes.clear();
    for (unsigned i = 0; i < 1000; ++i) {
      const bool is_end = stream.sent == 0 || stream.sent + 1 == frames;
      stream.add(!is_end && random() % 100 == 0);
    }
    receiver.feed(stream.bytes.data(), stream.bytes.size(), 0, nobody);
  }
  CHECK(stream.removed > frames / 200);
  CHECK(receiver.sequence().numbered == frames - stream.removed);
  CHECK(receiver.sequence().gaps == stream.removed);
  CHECK(receiver.sequence().repeats + receiver.sequence().restarts == 0);
}

}  // namespace

TEST_CASE("numbers rise by one on the wire: frames that are not stuffed") {
  numbers_rise_whatever_becomes_of_other_frames<Plain>();
}
TEST_CASE("numbers of each message rise by one on the wire: COBS, frames of more than 254 bytes among them") {
  numbers_rise_whatever_becomes_of_other_frames<Cobs>();
}
TEST_CASE("numbers rise by one on the wire: frames whose stuffed size depends on their number") {
  numbers_rise_whatever_becomes_of_other_frames<Escaped>();
}

TEST_CASE("the number of a frame that was given a header is the link's all the same") {
  Bench<Plain> at;
  at.poll();
  auto header = at.link.header();
  header.sequence = 99;
  CHECK(at.link.send(plain::Alarm{}, header) == wirebond::Status::ok);
  CHECK(at.link.send(plain::Alarm{}) == wirebond::Status::ok);
  while (at.leave()) {
  }
  CHECK(at.host.numbers == std::vector<std::uint32_t>{0, 1});
}

TEST_CASE("a link counts what is missing of the host's frames") {
  Bench<Escaped> at;
  at.poll();
  Missing<Escaped> stream;
  for (unsigned i = 0; i < 40; ++i) stream.add(i % 10 == 5);
  at.port.arrive(stream.bytes);
  at.link.on_received();
  at.poll();
  CHECK(at.link.sequence().numbered == 36);
  CHECK(at.link.sequence().gaps == 4);
}

TEST_CASE("gaps are exact where one frame of a hundred is missing") {
  const std::uint32_t frames = std::getenv("WIREBOND_LONG") != nullptr ? 1'000'000 : 20'000;
  gaps_are_exact<Plain>(frames);
  gaps_are_exact<Cobs>(frames);
  gaps_are_exact<Escaped>(frames);
}
