// The outbox: what goes first, and that the account of frames balances. Concurrency is in tests/concurrency.
#include "wirebond/mcu/outbox.hpp"

#include <doctest/doctest.h>

#include <array>
#include <cstdint>
#include <vector>

using wirebond::Queue;
using wirebond::Refusal;
using wirebond::Run;
using wirebond::SendAccount;

namespace {

template <std::int16_t Index, Queue Waits>
struct Message {
  struct Info {
    static constexpr std::int16_t index = Index;
    static constexpr Queue queue = Waits;
    static constexpr std::size_t max_frame_bytes = 8;
  };
};
using Plain = Message<0, Queue::normal>;
using Alarm = Message<1, Queue::urgent>;
using Pose = Message<2, Queue::latest>;
using Battery = Message<3, Queue::latest>;

struct Config : wirebond::OutboxConfig {
  static constexpr std::size_t ring_bytes = 64;
  static constexpr std::size_t ring_frames = 8;
  static constexpr std::size_t urgent_bytes = 16;
  static constexpr std::size_t urgent_frames = 2;
  using Latest = wirebond::MessageList<Pose, Battery>;
  static constexpr std::size_t accounts = 4;
};
using Outbox = wirebond::Outbox<Config>;

struct Fixture {
  std::array<std::uint8_t, Outbox::memory_bytes> memory{};
  Outbox outbox{memory.data()};

  template <class Sent>
  bool push(std::uint8_t value, std::uint16_t now_ms = 0) {
    auto grant = outbox.reserve_for<Sent>(4, now_ms);
    if (!grant.ok()) return false;
    grant.data()[0] = value;
    grant.commit(4);
    return true;
  }
  /// The first byte of the next run, which leaves at once; 0: none.
  int pop() {
    const Run run = outbox.next(4);
    if (run.size == 0) return 0;
    const int value = run.data[0];
    outbox.sent();
    return value;
  }
};

}  // namespace

TEST_CASE("without a number of frames there is an entry for each 32 bytes, and always a power of two") {
  CHECK(wirebond::default_frames(512) == 16);
  CHECK(wirebond::default_frames(256) == 8);
  CHECK(wirebond::default_frames(32) == 4);
  for (std::size_t bytes = 2; bytes <= 32768; bytes *= 2) {
    const std::size_t frames = wirebond::default_frames(bytes);
    CHECK(frames >= 4);
    CHECK((frames & (frames - 1)) == 0);
  }
}

TEST_CASE("urgent frames go first at every run, the queue and the slots take turns") {
  Fixture at;
  for (std::uint8_t i = 1; i <= 4; ++i) CHECK(at.push<Plain>(i));
  CHECK(at.push<Pose>(31));
  CHECK(at.push<Battery>(32));
  CHECK(at.pop() == 1);
  CHECK(at.push<Alarm>(21));
  CHECK(at.push<Alarm>(22));
  CHECK(at.pop() == 21);
  CHECK(at.pop() == 22);
  const std::vector<int> rest{at.pop(), at.pop(), at.pop(), at.pop(), at.pop(), at.pop()};
  CHECK(rest == std::vector<int>{32, 2, 31, 3, 4, 0});
  CHECK(at.outbox.account().sent == 8);
  CHECK(at.outbox.account().balances());
}

TEST_CASE("an urgent frame waits for no more than the run under way") {
  Fixture at;
  for (std::uint8_t i = 1; i <= 6; ++i) CHECK(at.push<Plain>(i));
  CHECK(at.outbox.next(8).frames == 2);
  CHECK(at.push<Alarm>(21));
  CHECK(at.outbox.next(8).data[0] == 1);
  at.outbox.sent();
  CHECK(at.outbox.next(8).data[0] == 21);
}

TEST_CASE("every frame is in one place of its message's account, and the sum's") {
  Fixture at;
  CHECK(at.push<Plain>(1));
  CHECK(at.push<Plain>(2));
  CHECK(at.push<Pose>(3));
  CHECK(at.push<Pose>(4));
  { auto dropped = at.outbox.reserve_for<Plain>(4); }
  auto out_of_range = at.outbox.reserve_for<Alarm>(4);
  out_of_range.give_back(Refusal::range);
  at.outbox.refuse(Refusal::down, 3);
  auto open = at.outbox.reserve_for<Plain>(4);
  CHECK(at.outbox.next(4).size == 4);
  at.outbox.aborted();
  CHECK(at.outbox.next(4).size == 4);

  const SendAccount plain = at.outbox.account(0);
  CHECK(plain.offered == 4);
  CHECK(plain.accepted == 2);
  CHECK(plain.aborted == 1);
  CHECK(plain.queued == 1);
  CHECK(plain.unfinished == 1);
  CHECK(plain.refused(Refusal::abandoned) == 1);
  CHECK(plain.balances());
  const SendAccount pose = at.outbox.account(2);
  CHECK(pose.replaced == 1);
  CHECK(pose.queued == 1);
  CHECK(pose.balances());
  CHECK(at.outbox.account(1).refused(Refusal::range) == 1);
  CHECK(at.outbox.account(3).refused(Refusal::down) == 1);

  const SendAccount all = at.outbox.account();
  CHECK(all.offered == 8);
  CHECK(all.refused() == 3);
  CHECK(all.balances());
  open.commit(4);
  at.outbox.sent();
  at.outbox.expire_all();
  CHECK(at.outbox.account().queued == 0);
  CHECK(at.outbox.account().expired == 2);
  CHECK(at.outbox.account().balances());
}

TEST_CASE("a frame expires when it is older than max_age, across the wrap of its stamp and in every queue") {
  Fixture at;
  CHECK(at.push<Plain>(1, 65'530));
  CHECK(at.push<Alarm>(2, 65'530));
  CHECK(at.push<Pose>(3, 65'530));
  CHECK(at.push<Plain>(4, 10));
  at.outbox.expire_older(44, 50);
  CHECK(at.outbox.account().expired == 0);
  at.outbox.expire_older(45, 50);
  CHECK(at.outbox.account().expired == 3);
  at.outbox.expire_older(9, 0);  // a stamp that is a little ahead of the consumer's clock is not old
  CHECK(at.pop() == 4);
  CHECK(at.outbox.account().balances());
}

TEST_CASE("the urgent queue has room of its own, and a frame without its queue is refused") {
  Fixture at;
  for (std::uint8_t i = 0; i < 8; ++i) CHECK(at.push<Plain>(i));
  CHECK_FALSE(at.push<Plain>(9));
  CHECK(at.push<Alarm>(1));
  CHECK(at.push<Alarm>(2));
  CHECK_FALSE(at.push<Alarm>(3));
  CHECK(at.outbox.account().refused(Refusal::full) == 2);

  struct Small : wirebond::OutboxConfig {};
  std::array<std::uint8_t, wirebond::Outbox<Small>::memory_bytes> memory{};
  wirebond::Outbox<Small> outbox(memory.data());
  CHECK(outbox.reserve(4, Queue::urgent).refusal() == Refusal::full);
  CHECK(outbox.account().balances());
}

TEST_CASE("frames are finished once, in the order of the wire, from all queues") {
  Fixture at;
  CHECK(at.push<Plain>(1));
  CHECK(at.push<Plain>(2));
  CHECK(at.push<Alarm>(3));
  CHECK(at.push<Pose>(4));
  std::vector<int> finished;
  const auto finish = [&](std::uint8_t* data, std::size_t, std::uint8_t) { finished.push_back(data[0]); };
  for (;;) {
    const Run run = at.outbox.next(100, finish);
    if (run.size == 0) break;
    CHECK(at.outbox.next(100, finish).data == run.data);
    at.outbox.sent();
  }
  CHECK(finished == std::vector<int>{3, 1, 2, 4});
  CHECK(at.outbox.account().balances());
}
