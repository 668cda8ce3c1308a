// Own bytes are taken out of what an end hears, and nothing else is.
#include "wirebond/echo.hpp"

#include <doctest/doctest.h>

#include <algorithm>
#include <array>
#include <cstdint>
#include <random>
#include <vector>

using Bytes = std::vector<std::uint8_t>;
using wirebond::Echo;

namespace {

/// An echo with its memory, and what it passed on.
struct Line {
  std::array<std::uint8_t, 64> memory{};
  Echo echo{memory.data(), memory.size()};
  Bytes others;

  bool send(const Bytes& piece) {
    if (!echo.keep(piece.data(), piece.size())) return false;
    echo.sent();
    return true;
  }
  Line& hear(const Bytes& bytes) {
    echo.hear(bytes.data(), bytes.size(), [this](const std::uint8_t* from, std::size_t size) {
      REQUIRE(size != 0);
      others.insert(others.end(), from, from + size);
    });
    return *this;
  }
  void give_up() {
    echo.give_up(
        [this](const std::uint8_t* from, std::size_t size) { others.insert(others.end(), from, from + size); });
  }
};

/// What shall come of a stream, by the rule alone: from each place on, the first piece that fits it as far as it goes.
struct Expected {
  Bytes others;
  std::size_t echoed = 0;
  std::size_t held = 0;
  std::size_t collisions = 0;

  Expected(const std::vector<Bytes>& pieces, const Bytes& heard) {
    std::size_t first = 0;
    for (std::size_t at = 0; at < heard.size();) {
      const auto fits = [&](const Bytes& piece) {
        const std::size_t size = std::min(piece.size(), heard.size() - at);
        return std::equal(piece.begin(), piece.begin() + static_cast<std::ptrdiff_t>(size),
                          heard.begin() + static_cast<std::ptrdiff_t>(at));
      };
      std::size_t piece = first;
      while (piece != pieces.size() && !fits(pieces[piece])) ++piece;
      if (piece == pieces.size()) {
        others.push_back(heard[at++]);
        continue;
      }
      if (pieces[piece].size() > heard.size() - at) {
        held = heard.size() - at;
        return;
      }
      echoed += pieces[piece].size();
      at += pieces[piece].size();
      collisions += piece - first;
      first = piece + 1;
    }
  }
};

}  // namespace

TEST_CASE("own bytes are dropped and counted, whatever the chunks") {
  for (const std::size_t chunk : {1u, 2u, 3u, 100u}) {
    Line line;
    REQUIRE(line.send({1, 2, 3}));
    REQUIRE(line.send({1, 2, 4}));
    const Bytes heard{1, 2, 3, 1, 2, 4, 9, 8};
    for (std::size_t at = 0; at < heard.size(); at += chunk) {
      line.hear({heard.begin() + static_cast<std::ptrdiff_t>(at),
                 heard.begin() + static_cast<std::ptrdiff_t>(std::min(at + chunk, heard.size()))});
    }
    CHECK(line.others == Bytes{9, 8});
    CHECK(line.echo.echoed() == 6);
    CHECK(line.echo.collisions() == 0);
    CHECK_FALSE(line.echo.waits());
  }
}

TEST_CASE("bytes of others that nobody had read before the echo are passed on, also where they begin like it") {
  Line line;
  REQUIRE(line.send({1, 2, 3}));
  line.hear({7, 1, 1, 2, 2, 1, 2, 3, 5});
  CHECK(line.others == Bytes{7, 1, 1, 2, 2, 5});
  CHECK(line.echo.echoed() == 3);
}

TEST_CASE("nothing is held back once nothing is expected, and what is held is passed on with the next byte") {
  Line line;
  REQUIRE(line.send({1, 2, 3}));
  line.hear({1, 2});
  CHECK(line.others.empty());
  CHECK(line.echo.held() == 2);
  line.hear({9});
  CHECK(line.others == Bytes{1, 2, 9});
  CHECK(line.echo.held() == 0);
  line.hear({1, 2, 3, 1});
  CHECK(line.others == Bytes{1, 2, 9, 1});
}

TEST_CASE("a piece that is heard otherwise is a collision once a later one is heard, and its bytes are passed on") {
  Line line;
  REQUIRE(line.send({1, 2, 3}));
  REQUIRE(line.send({1, 2, 4}));
  line.hear({1, 0, 3});
  CHECK(line.echo.collisions() == 0);
  line.hear({1, 2, 4});
  CHECK(line.echo.collisions() == 1);
  CHECK(line.others == Bytes{1, 0, 3});
  CHECK(line.echo.echoed() == 3);
}

TEST_CASE("whoever gives up counts what was not heard, and gets what was held back") {
  Line line;
  REQUIRE(line.send({1, 2, 3}));
  REQUIRE(line.send({4, 5}));
  line.hear({1, 2});
  line.give_up();
  CHECK(line.echo.collisions() == 2);
  CHECK(line.others == Bytes{1, 2});
  line.hear({1, 2, 3});
  CHECK(line.others == Bytes{1, 2, 1, 2, 3});
}

TEST_CASE("what a port did not take is not expected, and a line that is away has no collisions") {
  Line line;
  const Bytes piece{1, 2};
  REQUIRE(line.echo.keep(piece.data(), piece.size()));
  line.echo.refused();
  line.hear({1, 2});
  CHECK(line.others == Bytes{1, 2});
  REQUIRE(line.send({3, 4}));
  line.hear({3});
  line.echo.forget();
  CHECK(line.echo.collisions() == 0);
  CHECK(line.echo.echoed() == 1);
  line.hear({4});
  CHECK(line.others == Bytes{1, 2, 4});
}

TEST_CASE("a piece that finds no room is refused, and fits when something was heard") {
  Line line;
  const Bytes piece(29, 5);
  REQUIRE(line.send(piece));
  REQUIRE(line.send(piece));
  CHECK_FALSE(line.send({1}));
  line.hear(piece);
  CHECK(line.send({1}));
}

TEST_CASE("random pieces in random noise of the same few bytes: what is passed on follows the rule, in any chunks") {
  std::mt19937 draw(7);
  const auto below = [&](std::uint32_t limit) { return static_cast<std::uint32_t>(draw() % limit); };
  for (int round = 0; round < 3000; ++round) {
    Line line;
    for (std::uint32_t skip = below(60); skip != 0; --skip) line.send({1}), line.hear({1});  // begin anywhere
    const std::uint32_t echoed_before = line.echo.echoed();
    std::vector<Bytes> pieces;
    Bytes heard;
    const std::uint32_t letters = 1 + below(3);
    for (std::uint32_t count = below(5); count != 0; --count) {
      Bytes piece(1 + below(8));
      for (std::uint8_t& byte : piece) byte = static_cast<std::uint8_t>(below(letters));
      REQUIRE(line.send(piece));
      pieces.push_back(piece);
      for (std::uint32_t noise = below(6); noise != 0; --noise)
        heard.push_back(static_cast<std::uint8_t>(below(letters)));
      if (below(4) == 0) piece[below(static_cast<std::uint32_t>(piece.size()))] ^= 1;
      if (below(8) != 0) heard.insert(heard.end(), piece.begin(), piece.end());
    }
    for (std::size_t at = 0; at < heard.size();) {
      const std::size_t size = std::min<std::size_t>(1 + below(7), heard.size() - at);
      line.hear(
          {heard.begin() + static_cast<std::ptrdiff_t>(at), heard.begin() + static_cast<std::ptrdiff_t>(at + size)});
      at += size;
    }
    const Expected expected(pieces, heard);
    CHECK(line.others == expected.others);
    CHECK(line.echo.echoed() - echoed_before == expected.echoed);
    CHECK(line.echo.held() == expected.held);
    CHECK(line.echo.collisions() == expected.collisions);
  }
}
