// Slots of `latest` messages: who wins, what is counted, and that DMA's cell is left alone.
#include "wirebond/mcu/latest_slots.hpp"

#include <doctest/doctest.h>

#include <array>
#include <cstdint>

using wirebond::Refusal;
using wirebond::Run;

namespace {

using Slots = wirebond::LatestSlots<wirebond::CompareAndSwap<std::uint16_t>, 3, 8, 4>;

struct Fixture {
  std::array<std::uint8_t, Slots::memory_bytes> memory{};
  Slots slots{memory.data()};

  Slots::Ticket take(std::size_t slot, std::size_t size, std::uint16_t stamp = 0) {
    Slots::Ticket ticket;
    REQUIRE(slots.take(slot, size, stamp, ticket) == Refusal::none);
    return ticket;
  }
  bool push(std::size_t slot, std::uint8_t value, std::uint16_t stamp = 0) {
    const Slots::Ticket ticket = take(slot, 1, stamp);
    ticket.data[0] = value;
    return slots.commit(ticket, 1);
  }
};

}  // namespace

TEST_CASE("only the newest frame of a slot is sent, and each that it replaces is reported") {
  Fixture at;
  CHECK_FALSE(at.push(0, 1));
  CHECK(at.push(0, 2));
  CHECK(at.push(0, 3));
  CHECK(at.slots.finished(0) == 1);
  const Run run = at.slots.next(0);
  CHECK(run.size == 1);
  CHECK(run.data[0] == 3);
  CHECK(at.slots.next(0).size == 0);
  at.slots.end_run(0);
  CHECK(at.slots.finished(0) == 0);
}

TEST_CASE("the frame that DMA reads is not touched, however many follow") {
  Fixture at;
  at.push(0, 1);
  const Run run = at.slots.next(0);
  for (std::uint8_t i = 2; i < 100; ++i) at.push(0, i);
  CHECK(run.data[0] == 1);
  CHECK(at.slots.finished(0) == 2);
  at.slots.end_run(0);
  CHECK(at.slots.next(0).data[0] == 99);
}

TEST_CASE("the newest value is the one whose sender began last: an older one that commits behind it is dropped") {
  for (const bool has_left : {false, true}) {
    CAPTURE(has_left);
    Fixture at;
    const Slots::Ticket older = at.take(0, 1);  // interrupted here
    CHECK_FALSE(at.push(0, 2));
    if (has_left) {
      CHECK(at.slots.next(0).data[0] == 2);
      at.slots.end_run(0);
    }
    older.data[0] = 1;
    CHECK(at.slots.commit(older, 1));  // it was replaced itself
    CHECK(at.slots.unfinished(0) == 0);
    CHECK(at.slots.finished(0) == (has_left ? 0 : 1));
    if (!has_left) CHECK(at.slots.next(0).data[0] == 2);
    CHECK(at.slots.next(0).size == 0);
  }
}

TEST_CASE("senders that are interrupted by each other and give up leave the order of the others as it was") {
  Fixture at;
  const Slots::Ticket oldest = at.take(0, 1);
  const Slots::Ticket middle = at.take(0, 1);
  const Slots::Ticket newest = at.take(0, 1);
  SUBCASE("the newest gives up") {
    at.slots.abandon(newest);
    oldest.data[0] = 1;
    CHECK_FALSE(at.slots.commit(oldest, 1));
    middle.data[0] = 2;
    CHECK(at.slots.commit(middle, 1));
    CHECK(at.slots.next(0).data[0] == 2);
  }
  SUBCASE("the one in the middle gives up") {
    at.slots.abandon(middle);
    newest.data[0] = 3;
    CHECK_FALSE(at.slots.commit(newest, 1));
    oldest.data[0] = 1;
    CHECK(at.slots.commit(oldest, 1));
    CHECK(at.slots.next(0).data[0] == 3);
  }
  SUBCASE("the oldest gives up, and begins again as the newest") {
    at.slots.abandon(oldest);
    const Slots::Ticket again = at.take(0, 1);
    CHECK(again.cell == oldest.cell);
    newest.data[0] = 3;
    CHECK_FALSE(at.slots.commit(newest, 1));
    again.data[0] = 4;
    CHECK(at.slots.commit(again, 1));
    middle.data[0] = 2;
    CHECK(at.slots.commit(middle, 1));
    CHECK(at.slots.next(0).data[0] == 4);
  }
}

TEST_CASE("one frame on the wire, one that waits, a sender that is suspended: the newest value is sent, not refused") {
  Fixture at;
  at.push(0, 1);
  CHECK(at.slots.next(0).size == 1);              // on the wire
  const Slots::Ticket suspended = at.take(0, 1);  // a task, in the middle of its send
  at.push(0, 3);                                  // waits
  Slots::Ticket newest;
  REQUIRE(at.slots.take(0, 1, 0, newest) == Refusal::none);
  CHECK(newest.replaces);
  newest.data[0] = 4;
  CHECK_FALSE(at.slots.commit(newest, 1));
  suspended.data[0] = 2;
  CHECK(at.slots.commit(suspended, 1));
  at.slots.end_run(0);
  CHECK(at.slots.next(0).data[0] == 4);
  at.slots.end_run(0);
  CHECK(at.slots.next(0).size == 0);
}

TEST_CASE("a writer is refused where writers have all cells but the one on the wire, and a cell given back is free") {
  Fixture at;
  at.push(0, 1);
  CHECK(at.slots.next(0).size == 1);
  const Slots::Ticket first = at.take(0, 8);
  const Slots::Ticket second = at.take(0, 8);
  Slots::Ticket refused;
  CHECK(at.slots.take(0, 8, 0, refused) == Refusal::held);
  CHECK(at.slots.unfinished(0) == 2);
  at.slots.abandon(first);
  at.slots.abandon(second);
  CHECK(at.slots.unfinished(0) == 0);
  CHECK_FALSE(at.push(1, 9));  // the other slot was never concerned
  CHECK_FALSE(at.push(0, 3));
  CHECK(at.slots.take(1, 5, 0, refused) == Refusal::full);
  CHECK(at.slots.take(1, 0, 0, refused) == Refusal::full);
}

TEST_CASE("a waiting frame expires by its stamp; the one on the line does not") {
  Fixture at;
  at.push(0, 1, 10);
  CHECK(at.slots.next(0).size == 1);
  at.push(0, 2, 20);
  const auto is_20 = [](std::uint16_t stamp) { return stamp == 20; };
  const auto is_10 = [](std::uint16_t stamp) { return stamp == 10; };
  CHECK_FALSE(at.slots.expire(0, is_10));
  CHECK(at.slots.expire(0, is_20));
  CHECK_FALSE(at.slots.expire(0, is_20));
  CHECK(at.slots.finished(0) == 1);
  at.slots.end_run(0);
  CHECK(at.slots.next(0).size == 0);
}
