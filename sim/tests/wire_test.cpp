// The simulated wire: its pace, its adapter, its faults and its cable, and that it tells the truth about every byte.
#include "wirebond/sim/wire.hpp"

#include <doctest/doctest.h>

#include <cstdint>
#include <initializer_list>
#include <vector>

using wirebond::sim::Faults;
using wirebond::sim::Gaps;
using wirebond::sim::never;
using wirebond::sim::Random;
using wirebond::sim::ScriptedFault;
using wirebond::sim::Time;
using wirebond::sim::Wire;
using wirebond::sim::WireSettings;
using Bytes = std::vector<std::uint8_t>;
using Kind = ScriptedFault::Kind;

namespace {

WireSettings two_megabaud() {
  WireSettings settings;
  settings.baud = 2'000'000;
  settings.bits_per_byte = 11;
  return settings;
}

Time put(Wire& wire, const Bytes& bytes, Time now) { return wire.put(bytes.data(), bytes.size(), now); }

Bytes read(Wire& wire, Time now) {
  Bytes all;
  wire.read(now, [&](const std::uint8_t* bytes, std::size_t size) { all.insert(all.end(), bytes, bytes + size); });
  CHECK(wire.counts().closes());
  return all;
}

/// What comes out of a wire that carries bytes 0, 1, 2 ...; 13 at a time.
Bytes carried(Wire& wire, std::size_t size) {
  Bytes out;
  Time now = 0;
  for (std::size_t i = 0; i < size;) {
    Bytes run;
    for (; run.size() < 13 && i < size; ++i) run.push_back(static_cast<std::uint8_t>(i));
    now = put(wire, run, now);
    const Bytes got = read(wire, now);
    out.insert(out.end(), got.begin(), got.end());
  }
  const Bytes rest = read(wire, never - 1);
  out.insert(out.end(), rest.begin(), rest.end());
  return out;
}

/// FNV-1a.
std::uint64_t digest(const Bytes& bytes) {
  std::uint64_t hash = 0xCBF29CE484222325u;
  for (const std::uint8_t byte : bytes) hash = (hash ^ byte) * 0x100000001B3u;
  return hash;
}

}  // namespace

TEST_CASE("bytes leave at the pace of the line, and follow each other without a gap") {
  Wire wire(two_megabaud());
  CHECK(put(wire, {1, 2}, 1'000) == 12'000);
  CHECK(put(wire, {3}, 1'000) == 17'500);
  CHECK(put(wire, {4}, 50'000) == 55'500);
  CHECK(wire.next_handover() == 6'500);
  CHECK(read(wire, 6'499).empty());
  CHECK(read(wire, 6'500) == Bytes{1});
  CHECK(read(wire, 17'499) == Bytes{2});
  CHECK(read(wire, 55'499) == Bytes{3});
  CHECK(wire.next_handover() == 55'500);
  CHECK(read(wire, 55'500) == Bytes{4});
  CHECK(wire.next_handover() == never);
}

TEST_CASE("rounding does not add up over bytes that follow each other") {
  WireSettings settings;  // 115 200 baud: 86.805... microseconds a byte
  Wire wire(settings);
  Time end = 0;
  for (int i = 0; i < 115'200; ++i) end = put(wire, {0x55}, 0);
  CHECK(end == 10'000'000'000);
}

TEST_CASE("each run costs its restart gap, also when the line is still busy") {
  WireSettings settings = two_megabaud();
  settings.restart_gap = 3'000;
  Wire wire(settings);
  CHECK(put(wire, {1}, 0) == 8'500);
  CHECK(put(wire, {2}, 8'500) == 17'000);
  CHECK(put(wire, {3}, 10'000) == 25'500);
}

TEST_CASE("an adapter hands over in batches, and later than their time by no more than the jitter") {
  WireSettings settings = two_megabaud();
  settings.batch = 1'000'000;
  Wire wire(settings);
  put(wire, Bytes(200, 7), 0);  // 1.1 ms
  CHECK(wire.next_handover() == 1'000'000);
  CHECK(read(wire, 999'999).empty());
  CHECK(read(wire, 1'000'000).size() == 181);
  CHECK(wire.next_handover() == 2'000'000);
  CHECK(read(wire, 1'999'999).empty());
  CHECK(read(wire, 2'000'000).size() == 19);

  settings.jitter = 300'000;
  Wire late(settings);
  bool has_been_late = false;
  for (Time batch = 1; batch < 200; ++batch) {
    put(late, {1}, (batch - 1) * settings.batch);
    const Time at = late.next_handover();
    CHECK(at >= batch * settings.batch);
    CHECK(at <= batch * settings.batch + settings.jitter);
    has_been_late = has_been_late || at > batch * settings.batch;
    CHECK(read(late, at - 1).empty());
    CHECK(read(late, at).size() == 1);
  }
  CHECK(has_been_late);
}

TEST_CASE("a fault that is written down happens at its byte, and what it touches is known") {
  Wire wire(two_megabaud());
  wire.script({2, Kind::drop, 0});
  wire.script({1, Kind::flip, 0x80});
  wire.script({4, Kind::insert, 99});
  put(wire, {1, 2, 3}, 0);
  put(wire, {4, 5, 6}, 0);
  CHECK(read(wire, never - 1) == Bytes{1, 0x82, 4, 99, 5, 6});
  CHECK_FALSE(wire.was_touched(0, 1));
  CHECK(wire.was_touched(1, 2));
  CHECK(wire.was_touched(2, 4));
  CHECK_FALSE(wire.was_touched(4, 6));  // the byte that nobody sent came before it
  CHECK(wire.counts().put == 6);
  CHECK(wire.counts().dropped == 1);
  CHECK(wire.counts().inserted == 1);
}

TEST_CASE("a byte that nobody sent touches the frame that it comes into") {
  Wire wire(two_megabaud());
  wire.script({1, Kind::insert, 99});
  put(wire, {1, 2, 3}, 0);
  CHECK(read(wire, never - 1) == Bytes{1, 99, 2, 3});
  CHECK(wire.was_touched(0, 3));
}

TEST_CASE("a split lets the line pause and touches nothing") {
  WireSettings settings = two_megabaud();
  settings.faults.split_pause = 2'000'000;
  Wire wire(settings);
  wire.script({0, Kind::split, 0});
  CHECK(put(wire, {1, 2}, 0) == 5'500 + 2'000'000 + 5'500);
  CHECK(read(wire, 1'000'000) == Bytes{1});
  CHECK(read(wire, never - 1) == Bytes{2});
  CHECK_FALSE(wire.was_touched(0, 2));
  CHECK(wire.counts().splits == 1);
}

TEST_CASE("a pulled cable loses what is on the line and what is put until it is back") {
  Wire wire(two_megabaud());
  put(wire, {1, 2, 3, 4}, 0);  // they end at 5.5, 11, 16.5 and 22 microseconds
  wire.unplug(12'000);
  put(wire, {5}, 30'000);
  wire.plug();
  put(wire, {6}, 60'000);
  CHECK(read(wire, never - 1) == Bytes{1, 2, 6});
  CHECK(wire.counts().unplugged == 3);
  CHECK_FALSE(wire.was_touched(0, 2));
  CHECK(wire.was_touched(2, 4));
  CHECK(wire.was_touched(4, 5));
  CHECK_FALSE(wire.was_touched(5, 6));
}

TEST_CASE("a byte that meets two runs of another end becomes another byte, once") {
  Wire wire(two_megabaud());
  put(wire, {1, 2, 3, 4}, 0);  // they end at 5.5, 11, 16.5 and 22 microseconds
  wire.collide(1'000, 7'000);
  wire.collide(7'000, 12'000);
  const std::uint8_t collision = 0x5A;
  CHECK(read(wire, never - 1) == Bytes{1 ^ collision, 2 ^ collision, 3 ^ collision, 4});
  CHECK(wire.counts().collided == 3);
  CHECK(wire.was_touched(0, 3));
  CHECK_FALSE(wire.was_touched(3, 4));
}

TEST_CASE("an adapter that is pulled out keeps nothing, and what it had was touched") {
  WireSettings settings;
  settings.baud = 1'000'000;
  settings.batch = 1'000'000;
  Wire wire(settings);
  put(wire, {1, 2, 3}, 0);  // taken off the line at 10, 20 and 30 us, and not handed over yet
  wire.unplug_adapter(25'000);
  CHECK(wire.next_handover() == never);
  wire.plug();
  put(wire, {4, 5}, 2'000'000);
  CHECK(read(wire, never - 1) == Bytes{4, 5});
  CHECK(wire.counts().unplugged == 3);
  CHECK(wire.counts().closes());
  CHECK(wire.was_touched(0, 1));
  CHECK(wire.was_touched(1, 3));
  CHECK_FALSE(wire.was_touched(3, 5));
}

TEST_CASE("each byte that came is known by its number at the sender") {
  Wire wire{WireSettings{}};
  wire.follow();
  wire.script({2, Kind::drop, 0});
  wire.script({4, Kind::insert, 0x55});
  wire.script({5, Kind::flip, 1});
  put(wire, {10, 11, 12, 13, 14, 15, 16}, 0);
  REQUIRE(read(wire, never - 1) == Bytes{10, 11, 13, 0x55, 14, 14, 16});
  const std::uint64_t origins[] = {0, 1, 3, 3, 4, 5, 6};  // the inserted one counts to the byte before it
  for (std::uint64_t i = 0; i < 7; ++i) CHECK(wire.origin_of(i) == origins[i]);
}

TEST_CASE("gaps have the mean of their chance, from seldom to always") {
  for (const std::uint64_t chance : {std::uint64_t{10'000'000}, std::uint64_t{1'000'000'000},
                                     std::uint64_t{100'000'000'000}, std::uint64_t{500'000'000'000}}) {
    const Gaps gaps(chance);
    Random random(3);
    double sum = 0;
    for (int i = 0; i < 100'000; ++i) sum += static_cast<double>(gaps.next(random));
    const double p = static_cast<double>(chance) * 1e-12;
    const double mean = (1 - p) / p;
    CHECK(sum / 1e5 > mean * 0.98);
    CHECK(sum / 1e5 < mean * 1.02);
  }
  Random random(1);
  CHECK(Gaps(wirebond::sim::certain).next(random) == 0);
  CHECK(Gaps(0).next(random) == wirebond::sim::no_place);
}

TEST_CASE("faults come as often as they should, and each byte that changed is one that was touched") {
  WireSettings settings = two_megabaud();
  settings.faults.bit_errors = 100'000'000;  // 1e-4 a bit
  Wire wire(settings);
  constexpr std::size_t size = 1'000'000;
  const Bytes out = carried(wire, size);
  CHECK(out.size() == size);
  CHECK(wire.counts().bit_errors > 900);
  CHECK(wire.counts().bit_errors < 1'300);
  std::size_t changed = 0;
  std::size_t unknown = 0;
  for (std::size_t i = 0; i < size; ++i) {
    if (out[i] == static_cast<std::uint8_t>(i)) continue;
    ++changed;
    unknown += wire.was_touched(i, i + 1) ? 0 : 1;
  }
  CHECK(changed > 800);
  CHECK(unknown == 0);
}

TEST_CASE("the same seed brings the same faults, on every machine") {
  WireSettings settings = two_megabaud();
  settings.faults.bit_errors = 20'000'000;
  settings.faults.bursts = 100'000'000;
  settings.faults.drops = 1'000'000'000;
  settings.faults.inserts = 1'000'000'000;
  settings.faults.splits = 1'000'000'000;
  settings.seed = 7;
  Wire wire(settings);
  const Bytes out = carried(wire, 300'000);
  CHECK(digest(out) == 4658323298574064915u);
  CHECK(wire.counts().bursts > 15);
  CHECK(wire.counts().burst_bytes == 16 * wire.counts().bursts);
  CHECK(wire.counts().dropped > 200);
  CHECK(wire.counts().inserted > 200);
  CHECK(wire.counts().splits > 200);
  settings.seed = 8;
  Wire other(settings);
  CHECK(carried(other, 300'000) != out);
}
