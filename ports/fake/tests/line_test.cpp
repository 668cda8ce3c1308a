// The simulated line: its clock, its faults, its cable, and that every byte has one fate.
#include "wirebond/fake/line.hpp"

#include <doctest/doctest.h>

#include <cstdint>
#include <vector>

using wirebond::fake::Fate;
using wirebond::fake::Fault;
using wirebond::fake::Line;
using wirebond::fake::never;
using Bytes = std::vector<std::uint8_t>;

TEST_CASE("bytes follow each other at the byte clock, and not before they are put") {
  Line line(2'000'000, 11);
  CHECK(line.byte_time() == 5'500);
  CHECK(Line(115'200, 10).byte_time() == 86'806);  // rounded up: never faster than the line
  CHECK(line.put(Bytes{1, 2}, 1'000) == 12'000);
  CHECK(line.put(3, 50'000) == 55'500);
  CHECK(line.read(6'499).empty());
  CHECK(line.read(6'500) == Bytes{1});
  CHECK(line.read(55'499) == Bytes{2});
  CHECK(line.read(55'500) == Bytes{3});
  CHECK(line.next_arrival() == never);
  CHECK(line.put_count() == 3);
  CHECK(line.count(Fate::received) == 3);
  CHECK(line.closes());
}

TEST_CASE("a tty reads damaged bytes like any, and never sees those that were overrun") {
  Line line(115'200, 10);
  line.put(1, 0, Fault::framing);
  line.put(2, 0, Fault::overrun);
  line.put(3, 0);
  const Bytes read = line.read(never - 1);
  CHECK(read.size() == 2);
  CHECK(read.back() == 3);
  CHECK(line.count(Fate::damaged) == 1);
  CHECK(line.count(Fate::overrun) == 1);
  CHECK(line.closes());
}

TEST_CASE("a pulled cable cuts the byte that is half through, and loses those behind it") {
  Line line(1'000'000, 10);
  line.put(Bytes{1, 2, 3, 4}, 0);  // they end at 10, 20, 30 and 40 microseconds
  line.unplug(25'000);
  line.put(5, 50'000);
  line.plug();
  line.put(6, 90'000);
  CHECK(line.bytes()[2].fault == Fault::framing);
  const Bytes read = line.read(never - 1);
  CHECK(read.size() == 4);
  CHECK(read[1] == 2);
  CHECK(read[3] == 6);
  CHECK(line.count(Fate::unplugged) == 2);
  CHECK(line.count(Fate::damaged) == 1);
  CHECK(line.closes());
}

TEST_CASE("what is forgotten stays in the counts, and what travels is kept") {
  Line line(1'000'000, 10);
  line.put(Bytes{1, 2, 3}, 0);
  CHECK(line.read(20'000) == Bytes{1, 2});
  line.forget();
  CHECK(line.bytes().size() == 1);
  CHECK(line.forgotten() == 2);
  CHECK(line.read(30'000) == Bytes{3});
  CHECK(line.count(Fate::received) == 3);
  CHECK(line.closes());
}

TEST_CASE("faults come about as often as they are told to, the same in every run") {
  const auto run = [](std::uint64_t seed) {
    Line line(1'000'000, 10, seed);
    line.faults.framing = 10'000;
    line.faults.noise = 20'000;
    line.faults.overrun = 5'000;
    line.faults.flipped = 30'000;
    for (int i = 0; i < 100'000; ++i) line.put(0x55, 0);
    Bytes read = line.read(never - 1);
    std::uint64_t flipped = 0;
    std::uint64_t framing = 0;
    for (const auto& byte : line.bytes()) {
      flipped += byte.fate == Fate::received && byte.seen != byte.sent ? 1 : 0;
      framing += byte.fault == Fault::framing ? 1 : 0;
    }
    CHECK(framing > 900);
    CHECK(framing < 1'100);
    CHECK(line.count(Fate::damaged) > 2'800);
    CHECK(line.count(Fate::damaged) < 3'200);
    CHECK(line.count(Fate::overrun) > 400);
    CHECK(line.count(Fate::overrun) < 600);
    CHECK(flipped > 2'700);
    CHECK(flipped < 3'100);
    CHECK(line.closes());
    return read;
  };
  const Bytes once = run(7);
  CHECK(once == run(7));
  CHECK(once != run(8));
}
