// A receive ring against what really happened: a DMA that writes numbered bytes, events in any order, restarts, laps.
#include "wirebond/mcu/receive_ring.hpp"

#include <doctest/doctest.h>

#include <cstdint>
#include <random>
#include <vector>

namespace {

/// A ring whose DMA remembers the number of each byte that it wrote.
class Dma {
 public:
  explicit Dma(std::size_t size) : bytes(size), numbers(size) {}

  void write(std::size_t count) {
    for (std::size_t i = 0; i < count; ++i) {
      bytes[place] = static_cast<std::uint8_t>(written);
      numbers[place] = written++;
      place = (place + 1) % bytes.size();
    }
  }

  std::vector<std::uint8_t> bytes;
  std::vector<std::uint32_t> numbers;
  std::uint32_t written = 0;
  std::size_t place = 0;
};

/// Read at most `limit` bytes; append their numbers.
void read(wirebond::ReceiveRing& ring, const Dma& dma, std::size_t limit, std::vector<std::uint32_t>& got) {
  ring.look([&] { return dma.place; });
  while (limit != 0) {
    const wirebond::ReceiveRing::Span span = ring.next();
    if (span.size == 0) return;
    const std::size_t taken = span.size < limit ? span.size : limit;
    const std::size_t begin = static_cast<std::size_t>(span.data - dma.bytes.data());
    REQUIRE(begin + span.size <= dma.bytes.size());
    for (std::size_t i = 0; i < taken; ++i) got.push_back(dma.numbers[begin + i]);
    ring.consumed(taken);
    limit -= taken;
  }
}

void check_sums(const wirebond::ReceiveRing& ring, std::size_t received, std::size_t handed_out) {
  const wirebond::ReceiveAccount account = ring.account();
  CHECK(account.received == received);
  CHECK(account.handed_out == handed_out);
  CHECK(account.received == account.handed_out + account.lapped + ring.unread());
}

}  // namespace

TEST_CASE("the interrupt knows whether all that came was read, also behind a restart") {
  Dma dma(16);
  wirebond::ReceiveRing ring(dma.bytes.data(), 16);
  std::vector<std::uint32_t> got;
  CHECK(ring.is_all_read());
  for (int i = 0; i < 20; ++i) {
    dma.write(7);
    ring.advance(dma.place);
    CHECK_FALSE(ring.is_all_read());
    read(ring, dma, 6, got);
    CHECK_FALSE(ring.is_all_read());
    read(ring, dma, 1, got);
    CHECK(ring.is_all_read());
    dma.place = 0;
    ring.restart();
    read(ring, dma, 1, got);
    CHECK(ring.is_all_read());
  }
  CHECK(got.size() == 140);
}

TEST_CASE("bytes come out once, in order, in pieces that do not wrap") {
  Dma dma(16);
  wirebond::ReceiveRing ring(dma.bytes.data(), 16);
  std::vector<std::uint32_t> got;
  for (int i = 0; i < 20; ++i) {
    dma.write(7);
    ring.advance(dma.place);
    read(ring, dma, 100, got);
  }
  REQUIRE(got.size() == 140);
  for (std::size_t i = 0; i < got.size(); ++i) CHECK(got[i] == i);
  check_sums(ring, 140, 140);
}

TEST_CASE("an exactly full ring is neither empty nor lapped") {
  Dma dma(16);
  wirebond::ReceiveRing ring(dma.bytes.data(), 16);
  std::vector<std::uint32_t> got;
  dma.write(8);
  ring.advance(dma.place);
  dma.write(8);
  ring.advance(dma.place);
  read(ring, dma, 100, got);
  CHECK(got.size() == 16);
  CHECK(ring.account().laps == 0);
  check_sums(ring, 16, 16);
}

TEST_CASE("a reader that was lapped goes on with the newest half, and the rest is counted") {
  Dma dma(16);
  wirebond::ReceiveRing ring(dma.bytes.data(), 16);
  for (int i = 0; i < 5; ++i) {
    dma.write(5);
    ring.advance(dma.place);
  }
  std::vector<std::uint32_t> got;
  read(ring, dma, 100, got);
  REQUIRE(got.size() == 8);
  CHECK(got.front() == 17);
  CHECK(ring.account().laps == 1);
  CHECK(ring.account().lapped == 17);
  check_sums(ring, 25, 8);
}

TEST_CASE("a restarted DMA leaves no byte out, and none that never came in, wherever the ring was") {
  for (std::size_t before = 0; before < 40; ++before) {
    Dma dma(16);
    wirebond::ReceiveRing ring(dma.bytes.data(), 16);
    std::vector<std::uint32_t> got;
    for (std::size_t written = 0; written < before; ++written) {
      dma.write(1);
      ring.advance(dma.place);
      read(ring, dma, 100, got);
    }
    ring.restart();
    dma.place = 0;
    CHECK(ring.place() == 0);
    for (int i = 0; i < 5; ++i) {
      dma.write(7);
      ring.advance(dma.place);
      read(ring, dma, 100, got);
    }
    REQUIRE(got.size() == before + 35);
    for (std::size_t i = 0; i < got.size(); ++i) CHECK(got[i] == i);
    check_sums(ring, before + 35, before + 35);
  }
}

TEST_CASE("what the DMA writes while it is read is counted as overtaken") {
  Dma dma(16);
  wirebond::ReceiveRing ring(dma.bytes.data(), 16);
  dma.write(10);
  ring.advance(dma.place);
  ring.look([&] { return dma.place; });
  const wirebond::ReceiveRing::Span span = ring.next();
  dma.write(8);
  ring.advance(dma.place);
  ring.consumed(span.size);
  CHECK(ring.account().overtaken == 10);
}

TEST_CASE("random writes, events, restarts and reads: every byte is read once and in order, or counted") {
  std::mt19937 random(20261121);
  const auto below = [&](unsigned limit) { return static_cast<unsigned>(random() % limit); };
  for (int round = 0; round < 400; ++round) {
    const std::size_t size = std::size_t{8} << below(5);
    Dma dma(size);
    wirebond::ReceiveRing ring(dma.bytes.data(), size);
    std::vector<std::uint32_t> got;
    std::uint32_t seen = 0;
    for (int step = 0; step < 300; ++step) {
      switch (below(6)) {
        case 0:
        case 1:  // the half and full events come at least once a turn
          for (unsigned i = below(4); i > 0; --i) {
            dma.write(below(static_cast<unsigned>(size)));
            ring.advance(dma.place);
          }
          break;
        case 2: dma.write(below(static_cast<unsigned>(size) / 4)), ring.advance(dma.place); break;
        case 3: ring.advance(dma.place); break;  // in vain
        case 4:
          ring.advance(dma.place);
          if (ring.is_all_read()) {
            ring.restart();
            dma.place = 0;
          }
          break;
        default:
          read(ring, dma, below(3) == 0 ? below(static_cast<unsigned>(size)) : 2 * size, got);
          seen = dma.written;
          check_sums(ring, seen, got.size());
          break;
      }
    }
    read(ring, dma, 2 * size, got);
    for (std::size_t i = 1; i < got.size(); ++i) REQUIRE(got[i] > got[i - 1]);
    const wirebond::ReceiveAccount account = ring.account();
    CHECK(account.received == dma.written);
    CHECK(got.size() == account.handed_out);
    CHECK(dma.written == account.handed_out + account.lapped);
    CHECK(account.overtaken == 0);
  }
}
