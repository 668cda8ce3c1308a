// What received numbers tell: gaps, repeats and restarts, at every width, against a count that goes one by one.
#include "wirebond/sequence.hpp"

#include <doctest/doctest.h>

#include <cstdint>
#include <random>
#include <vector>

using wirebond::SequenceCounts;
using wirebond::SequenceTrack;

namespace {

using Counts = SequenceCounts<std::uint32_t>;

template <class Value>
Counts counts_of(const std::vector<Value>& numbers, Value mask) {
  SequenceTrack<Value> track;
  Counts counts;
  for (const Value number : numbers) track.take(number, mask, counts);
  return counts;
}

/// The same, said without arithmetic that wraps: go up from the number before until the one that came is reached.
Counts slowly(const std::vector<unsigned>& numbers, unsigned range) {
  Counts counts;
  for (std::size_t i = 0; i < numbers.size(); ++i) {
    counts.numbered += 1;
    if (i == 0) continue;
    unsigned steps = 0;
    for (unsigned number = numbers[i - 1]; number != numbers[i]; number = number + 1 == range ? 0 : number + 1) ++steps;
    if (steps == 0) {
      counts.repeats += 1;
    } else if (2 * steps > range) {
      counts.restarts += 1;
    } else {
      counts.gaps += steps - 1;
    }
  }
  return counts;
}

bool same(const Counts& a, const Counts& b) {
  return a.numbered == b.numbered && a.gaps == b.gaps && a.repeats == b.repeats && a.restarts == b.restarts;
}

}  // namespace

TEST_CASE("the first number only says where the count begins") {
  const Counts counts = counts_of<std::uint8_t>({200, 201, 202}, 0xFF);
  CHECK(counts.numbered == 3);
  CHECK(counts.gaps + counts.repeats + counts.restarts == 0);
}

TEST_CASE("what was left out is a gap, also across the end of the range") {
  CHECK(counts_of<std::uint8_t>({254, 1}, 0xFF).gaps == 2);
  CHECK(counts_of<std::uint16_t>({65535, 0, 2}, 0xFFFF).gaps == 1);
  CHECK(counts_of<std::uint32_t>({0xFFFFFF, 1}, 0xFFFFFF).gaps == 1);
  CHECK(counts_of<std::uint32_t>({0xFFFFFFFE, 4}, 0xFFFFFFFF).gaps == 5);
  CHECK(counts_of<std::uint8_t>({6, 1}, 7).gaps == 2);
}

TEST_CASE("a jump of half the range is a gap, and one more is a restart") {
  CHECK(counts_of<std::uint8_t>({0, 128}, 0xFF).gaps == 127);
  CHECK(counts_of<std::uint8_t>({0, 129}, 0xFF).restarts == 1);
  CHECK(counts_of<std::uint8_t>({0, 129}, 0xFF).gaps == 0);
  CHECK(counts_of<std::uint32_t>({0, 0x80000000}, 0xFFFFFFFF).gaps == 0x7FFFFFFF);
  CHECK(counts_of<std::uint32_t>({0, 0x80000001}, 0xFFFFFFFF).restarts == 1);
}

TEST_CASE("behind a restart the count goes on from the new number") {
  const Counts counts = counts_of<std::uint8_t>({90, 91, 0, 1, 3}, 0xFF);
  CHECK(counts.restarts == 1);
  CHECK(counts.gaps == 1);
}

TEST_CASE("a bit that alternates tells a repeat and nothing more") {
  const Counts counts = counts_of<std::uint8_t>({0, 1, 0, 0, 1}, 1);
  CHECK(counts.repeats == 1);
  CHECK(counts.gaps + counts.restarts == 0);
}

TEST_CASE("any numbers of any width up to 9 bits are counted as one by one") {
  std::mt19937 random(11);
  for (unsigned bits = 1; bits <= 9; ++bits) {
    const unsigned range = 1u << bits;
    for (unsigned round = 0; round < 40; ++round) {
      std::vector<unsigned> numbers;
      std::vector<std::uint16_t> narrow;
      for (unsigned i = 0; i < 200; ++i) {
        const unsigned before = numbers.empty() ? 0 : numbers.back();
        const unsigned jump = random() % 4 == 0 ? static_cast<unsigned>(random()) : 1;
        numbers.push_back((before + jump) % range);
        narrow.push_back(static_cast<std::uint16_t>(numbers.back()));
      }
      CHECK(same(counts_of<std::uint16_t>(narrow, static_cast<std::uint16_t>(range - 1)), slowly(numbers, range)));
    }
  }
}
