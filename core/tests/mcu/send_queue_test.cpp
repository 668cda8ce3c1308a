// The send queue alone: room, order, runs, and what a refusal says. One thread; contexts interleave by hand.
#include "wirebond/mcu/send_queue.hpp"

#include <doctest/doctest.h>

#include <array>
#include <cstdint>
#include <cstring>
#include <utility>
#include <vector>

using wirebond::Refusal;
using wirebond::Run;

namespace {

using Bytes = std::vector<std::uint8_t>;

Bytes operator+(Bytes left, const Bytes& right) {
  left.insert(left.end(), right.begin(), right.end());
  return left;
}

/// Positions of 16 bits as on the MCU, so that they wrap within a test.
using Queue = wirebond::SendQueue<wirebond::CompareAndSwap<std::uint16_t>>;
using Granted = wirebond::Grant<Queue>;

template <std::size_t Capacity, std::size_t Entries>
struct Fixture {
  std::array<std::uint8_t, Capacity> ring{};
  std::array<Queue::Entry, Entries> entries{};
  Queue queue{ring.data(), Capacity, entries.data(), Entries};

  /// A committed frame of `size` bytes of `value`; false where it is refused.
  bool push(std::size_t size, std::uint8_t value, std::uint8_t tag = 0, std::uint16_t stamp = 0) {
    Granted grant = queue.reserve(size, tag, stamp);
    if (!grant.ok()) return false;
    std::memset(grant.data(), value, size);
    grant.commit(size);
    return true;
  }

  /// The next run's bytes; it leaves at once.
  Bytes pop(std::size_t max_bytes = 1000) {
    const Run run = queue.next(max_bytes);
    Bytes bytes(run.data, run.data + run.size);
    queue.end_run();
    return bytes;
  }
};

}  // namespace

TEST_CASE("an entry of the table has 8 bytes with positions of 16 bits") { CHECK(sizeof(Queue::Entry) == 8); }

TEST_CASE("a queue that is exactly full is not empty, and one byte more is refused") {
  Fixture<16, 8> at;
  CHECK(at.queue.next(100).size == 0);
  CHECK(at.push(8, 1));
  CHECK(at.push(8, 2));
  CHECK(at.queue.used_bytes() == 16);
  CHECK(at.queue.reserve(1).refusal() == Refusal::full);
  CHECK(at.pop() == Bytes(8, 1) + Bytes(8, 2));
  CHECK(at.queue.used_bytes() == 0);
  CHECK(at.pop().empty());
  CHECK(at.push(8, 3));
  CHECK(at.pop() == Bytes(8, 3));
}

TEST_CASE("a table that is exactly full refuses, and takes one frame for each that left") {
  Fixture<64, 4> at;
  for (std::uint8_t i = 0; i < 4; ++i) CHECK(at.push(1, i));
  CHECK(at.queue.reserve(1).refusal() == Refusal::full);
  CHECK(at.pop(1) == Bytes{0});
  CHECK(at.push(1, 4));
  CHECK(at.queue.reserve(1).refusal() == Refusal::full);
  CHECK(at.pop() == Bytes{1, 2, 3, 4});
}

TEST_CASE("positions and numbers wrap without a trace") {
  Fixture<16, 4> at;
  for (unsigned i = 0; i < 70'000; ++i) {
    const auto value = static_cast<std::uint8_t>(i);
    REQUIRE(at.push(1 + i % 8, value));
    REQUIRE(at.pop() == Bytes(1 + i % 8, value));
    REQUIRE(at.queue.used_bytes() == 0);
  }
}

TEST_CASE("a frame never crosses the ring's end; what is skipped belongs to it and comes back with it") {
  Fixture<16, 8> at;
  CHECK(at.push(6, 1));
  CHECK(at.push(6, 2));
  CHECK(at.pop(6) == Bytes(6, 1));
  CHECK(at.push(6, 3));  // 4 bytes are left before the end: it begins at 0
  CHECK(at.queue.used_bytes() == 16);
  CHECK(at.queue.reserve(1).refusal() == Refusal::full);
  CHECK(at.pop() == Bytes(6, 2));  // a run ends where the ring does
  CHECK(at.pop() == Bytes(6, 3));
  CHECK(at.queue.used_bytes() == 0);
}

TEST_CASE("half the ring always fits into an empty queue, wherever that begins; more is never granted") {
  for (std::size_t before = 1; before <= 16; ++before) {
    Fixture<32, 4> at;
    REQUIRE(at.push(before, 1));
    REQUIRE(at.pop().size() == before);
    CHECK(at.push(16, 2));
    CHECK(at.pop() == Bytes(16, 2));
    CHECK(at.queue.reserve(17).refusal() == Refusal::full);
  }
  Fixture<32, 4> at;
  CHECK(at.queue.reserve(0).refusal() == Refusal::full);
}

TEST_CASE("a run holds whole frames up to its bound, and one in any case") {
  Fixture<64, 8> at;
  for (std::uint8_t i = 1; i <= 5; ++i) CHECK(at.push(4, i));
  CHECK(at.queue.next(11).size == 8);
  CHECK(at.queue.next(100).size == 8);  // the same again until it ends
  CHECK(at.queue.next(100).frames == 2);
  at.queue.end_run();
  CHECK(at.pop(3) == Bytes(4, 3));
  CHECK(at.pop(8) == Bytes(4, 4) + Bytes(4, 5));
}

TEST_CASE("a finished frame passes an unfinished one, whose place in the order is kept") {
  Fixture<64, 8> at;
  Granted slow = at.queue.reserve(4);
  CHECK(at.push(4, 2));
  CHECK(at.pop() == Bytes(4, 2));
  CHECK(at.push(4, 3));
  std::memset(slow.data(), 1, 4);
  slow.commit(4);
  CHECK(at.pop() == Bytes(4, 1));
  CHECK(at.pop() == Bytes(4, 3));
}

TEST_CASE("passes = false: nothing passes an unfinished frame, and what was given back holds up nobody") {
  Fixture<64, 8> at;
  const auto nothing = [](std::uint8_t*, std::size_t, std::uint8_t) {};
  Granted first = at.queue.reserve(4);
  Granted second = at.queue.reserve(4);
  CHECK(at.push(4, 3));
  CHECK(at.queue.next(100, false, nothing).size == 0);
  first.give_back();
  CHECK(at.queue.next(100, false, nothing).size == 0);
  second.give_back();
  CHECK(at.queue.next(100, false, nothing).size == 4);
}

TEST_CASE("each frame is finished once, in the order of the wire") {
  Fixture<64, 8> at;
  std::uint8_t number = 0;
  const auto count = [&](std::uint8_t* data, std::size_t size, std::uint8_t tag) {
    CHECK(tag == 7);
    data[size - 1] = ++number;
  };
  Granted late = at.queue.reserve(2, 7);
  for (std::uint8_t i = 0; i < 3; ++i) CHECK(at.push(2, 0xEE, 7));
  CHECK(at.queue.next(4, true, count).frames == 2);
  CHECK(at.queue.next(4, true, count).frames == 2);
  CHECK(number == 2);
  at.queue.end_run();
  late.data()[0] = 0xAA;
  late.commit(2);
  CHECK(at.queue.next(4, true, count).frames == 1);
  CHECK(at.pop() == Bytes{0xAA, 3});
  CHECK(at.queue.next(4, true, count).frames == 1);
  CHECK(at.pop() == Bytes{0xEE, 4});
}

TEST_CASE("a frame that is shorter once it is finished leaves no hole in its run, and its room is used again") {
  Fixture<16, 4> at;
  const auto halve = [](std::uint8_t* data, std::size_t size, std::uint8_t) {
    data[size / 2 - 1] = 9;
    return size / 2;
  };
  for (unsigned round = 0; round < 20; ++round) {
    CHECK(at.push(4, 1));
    CHECK(at.push(4, 2));
    CHECK(at.push(4, 3));
    Bytes sent;
    for (Run run = at.queue.next(100, true, halve); run.size != 0; run = at.queue.next(100, true, halve)) {
      CHECK(at.queue.next(100, true, halve).size == run.size);  // finished once, given again as often as asked
      sent.insert(sent.end(), run.data, run.data + run.size);
      at.queue.end_run();
    }
    CHECK(sent == Bytes{1, 9, 2, 9, 3, 9});
    CHECK(at.queue.used_bytes() == 0);
  }
}

TEST_CASE("a refusal tells whether room waits for an unfinished frame or for the line") {
  Fixture<16, 8> at;
  Granted slow = at.queue.reserve(4);
  CHECK(at.push(4, 1));
  CHECK(at.push(8, 2));
  CHECK(at.queue.reserve(4).refusal() == Refusal::full);
  CHECK(at.pop(4) == Bytes(4, 1));
  CHECK(at.queue.reserve(4).refusal() == Refusal::held);
  slow.commit(4);
  CHECK(at.queue.reserve(4).refusal() == Refusal::full);
  CHECK(at.pop(4).size() == 4);
  CHECK(at.queue.used_bytes() == 8);
  CHECK(at.push(4, 3));
}

TEST_CASE("the last frame to be reserved gives back what it did not need; another one's rest stays with it") {
  Fixture<64, 8> at;
  Granted last = at.queue.reserve(20);
  std::memset(last.data(), 1, 20);
  last.commit(5);
  CHECK(at.queue.used_bytes() == 5);
  Granted inner = at.queue.reserve(20);
  CHECK(at.push(4, 3));
  std::memset(inner.data(), 2, 20);
  inner.commit(6);
  CHECK(at.queue.used_bytes() == 29);
  CHECK(at.pop() == Bytes(5, 1) + Bytes(6, 2));  // a rest ends a run
  CHECK(at.pop() == Bytes(4, 3));
  CHECK(at.queue.used_bytes() == 0);
}

TEST_CASE("a grant that ends without a frame leaves none, and its room comes back") {
  Fixture<16, 4> at;
  for (unsigned round = 0; round < 100; ++round) {
    { const Granted dropped = at.queue.reserve(8); }
    Granted empty = at.queue.reserve(3);
    empty.commit(0);
    Granted too_much = at.queue.reserve(3);
    too_much.commit(4);
    CHECK_FALSE(too_much.ok());
    REQUIRE(at.pop().empty());
    REQUIRE(at.queue.used_entries() == 0);
    REQUIRE(at.queue.used_bytes() == 0);
  }
}

TEST_CASE("a grant moves, and only its last holder has it") {
  Fixture<16, 4> at;
  Granted first = at.queue.reserve(4);
  Granted second = std::move(first);
  CHECK_FALSE(first.ok());  // NOLINT: what is left is what is tested
  CHECK(first.size() == 0);
  first.commit(4);
  CHECK(at.queue.unfinished() == 1);
  second.commit(4);
  CHECK(at.queue.unfinished() == 0);
  CHECK(at.queue.finished() == 1);
}

TEST_CASE("old frames expire, but not those on the line, unfinished or new") {
  Fixture<64, 8> at;
  CHECK(at.push(4, 1, 1, 10));
  CHECK(at.queue.next(100).frames == 1);
  CHECK(at.push(4, 2, 2, 10));
  Granted open = at.queue.reserve(4, 3, 10);
  CHECK(at.push(4, 4, 4, 11));
  std::vector<int> tags;
  at.queue.expire([](std::uint16_t stamp) { return stamp == 10; }, [&](std::uint8_t tag) { tags.push_back(tag); });
  CHECK(tags == std::vector<int>{2});
  CHECK(at.queue.is_sending());
  at.queue.end_run([&](std::uint8_t tag) { tags.push_back(tag); });
  CHECK(tags == std::vector<int>{2, 1});
  CHECK(at.pop() == Bytes(4, 4));
  open.commit(4);
  CHECK(at.queue.finished() == 1);
}

TEST_CASE("the peaks are the most bytes and entries that were ever in use") {
  Fixture<64, 8> at;
  CHECK(at.push(10, 1));
  CHECK(at.push(10, 1));
  CHECK(at.pop().size() == 20);
  CHECK(at.push(5, 1));
  CHECK(at.push(5, 1));
  CHECK(at.push(5, 1));
  CHECK(at.queue.peak_bytes() == 20);
  CHECK(at.queue.peak_entries() == 3);
}
