// Delimiters of two bytes: doubled ones, those that end a line, and what an opening within a frame means.
#include <doctest/doctest.h>

#include <cstdint>

#include "formats.hpp"
#include "recorder.hpp"

using namespace formats;
using wirebond::Cause;

namespace {

template <class Source>
using Watched = Recorder<std::decay_t<Source>>;

}  // namespace

TEST_CASE("the delimiters' first byte is sent twice among the data") {
  for_both_sources<Doubled>([](const auto& source) {
    const Bytes frame = frame_of(source, 0x10, {0x10, 0x03});
    CHECK(frame == Bytes{0x10, 0x02, 0x10, 0x10, 0x10, 0x10, 0x03, 0x03, 0x10, 0x03});
    for (const std::size_t chunk : {1u, 3u, 100u}) {
      Watched<decltype(source)> recorder(source);
      recorder.feed_in_chunks(frame, chunk);
      REQUIRE(recorder.frames().size() == 1);
      CHECK(recorder.frames()[0].payload == Bytes{0x10, 0x03});
      CHECK(recorder.pending() == 0);
    }
  });
}

TEST_CASE("the second of a doubled byte does not open a frame, unless the first one was noise") {
  for_both_sources<Doubled>([](const auto& source) {
    const Bytes inner = frame_of(source, 0x03, {1});
    Watched<decltype(source)> recorder(source);
    recorder.feed(frame_of(source, 0x03, {0x10, 0x02, 0x10, 0x03}));
    CHECK(recorder.frames().size() == 1);
    // A false start whose data ends in the byte that then looks doubled: only the rescan finds the frame.
    recorder.feed(Bytes{0x10, 0x02, 0x03, 0x10} + inner);
    REQUIRE(recorder.frames().size() == 2);
    CHECK(recorder.frames()[1].wire == inner);
    CHECK(recorder.discarded(Cause::check_mismatch) == 4);
  });
}

TEST_CASE("an opening within a frame begins a better candidate, and an impossible pair ends one") {
  for_both_sources<Doubled>([](const auto& source) {
    const Bytes frame = frame_of(source, 0x03, {1, 2});
    Watched<decltype(source)> recorder(source);
    recorder.feed(Bytes{0x10, 0x02, 0x03, 0x01} + frame);
    CHECK(recorder.frames().size() == 1);
    CHECK(recorder.discarded(Cause::incomplete) == 4);
    recorder.feed(Bytes{0x10, 0x02, 0x03, 0x10, 0x41} + frame);
    CHECK(recorder.frames().size() == 2);
    CHECK(recorder.discarded(Cause::bad_stuffing) == 5);
  });
}

TEST_CASE("a bracketed frame that does not end is given up at its greatest size, and no byte waits for more") {
  for_both_sources<Doubled>([](const auto& source) {
    const Bytes frame = frame_of(source, 0x03, {1, 2});
    const std::size_t longest = wirebond::max_wire_bytes(source.format());
    Watched<decltype(source)> recorder(source);
    recorder.feed(Bytes{0x10, 0x02} + Bytes(longest + 50, 0x44));
    CHECK(recorder.pending() == 0);
    CHECK(recorder.discarded(Cause::length_out_of_range) == longest);
    CHECK(recorder.discarded(Cause::no_start) == 52);
    recorder.feed(frame);
    CHECK(recorder.frames().size() == 1);
  });
}

TEST_CASE("a line ends with both bytes, and either of them may stand in it") {
  for_both_sources<Lines>([](const auto& source) {
    const Bytes text = {0x0A, 'a', 0x0D, 'b', 0x0D};
    const Bytes frame = frame_of(source, 0, text);
    for (const std::size_t chunk : {1u, 2u, 100u}) {
      Watched<decltype(source)> recorder(source);
      recorder.feed_in_chunks(frame + frame, chunk);
      REQUIRE(recorder.frames().size() == 2);
      CHECK(recorder.frames()[1].payload == text);
      CHECK(recorder.frames()[1].offset == frame.size());
    }
  });
}

TEST_CASE("a line that is too long costs itself, also when its end comes in two pieces") {
  for_both_sources<Lines>([](const auto& source) {
    const Bytes frame = frame_of(source, 0, {'o', 'k'});
    Watched<decltype(source)> recorder(source);
    recorder.feed(Bytes(100, 'x') + Bytes{0x0D});
    CHECK(recorder.pending() == 1);
    recorder.feed(Bytes{0x0A} + frame);
    REQUIRE(recorder.frames().size() == 1);
    CHECK(recorder.frames()[0].wire == frame);
    CHECK(recorder.discarded(Cause::length_out_of_range) == 102);
  });
}

TEST_CASE("where a delimiter only ends lines, that of a refused line is discarded with it") {
  for_both_sources<Lines>([](const auto& source) {
    const Bytes frame = frame_of(source, 0, {'o', 'k'});
    Bytes wrong = frame;
    wrong[0] ^= 1;
    for (const std::size_t chunk : {1u, 3u, 100u}) {
      Watched<decltype(source)> recorder(source);
      recorder.feed_in_chunks(wrong + frame, chunk);
      REQUIRE(recorder.frames().size() == 1);
      CHECK(recorder.frames()[0].wire == frame);
      CHECK(recorder.frames()[0].offset == wrong.size());
      CHECK(recorder.discarded(Cause::check_mismatch) == wrong.size());
      CHECK(recorder.account().fill_bytes == 0);
    }
  });
}

TEST_CASE("every line end without a line is fill") {
  for_both_sources<Lines>([](const auto& source) {
    const Bytes frame = frame_of(source, 0, {'o', 'k'});
    Watched<decltype(source)> recorder(source);
    recorder.feed_in_chunks(Bytes{0x0D, 0x0A, 0x0D, 0x0A} + frame, 1);
    REQUIRE(recorder.frames().size() == 1);
    CHECK(recorder.account().fill_bytes == 4);
    CHECK(recorder.frames()[0].offset == 4);
  });
}

TEST_CASE("skips_failed: what lies in a frame that fails behind its header is not looked at") {
  for_both_sources<Strict>([](const auto& source) {
    const Bytes inner = frame_of(source, 0x01, {1, 2});
    Bytes outer = frame_of(source, 0x02, inner);
    outer[outer.size() - 2] ^= 1;
    Watched<decltype(source)> recorder(source);
    recorder.feed(outer + inner);
    REQUIRE(recorder.frames().size() == 1);
    CHECK(recorder.frames()[0].offset == outer.size());
    CHECK(recorder.discarded(Cause::check_mismatch) == outer.size());
  });
  for_both_sources<WeakSum>([](const auto& source) {  // recover before trust, unless the file says otherwise
    const Bytes inner = frame_of(source, 0x01, {1, 2});
    Bytes outer = frame_of(source, 0x02, inner);
    outer[outer.size() - 2] ^= 1;
    Watched<decltype(source)> recorder(source);
    recorder.feed(outer + inner);
    CHECK(recorder.frames().size() == 2);
  });
}

TEST_CASE("skips_failed: a false start that fails in its header costs one byte") {
  for_both_sources<Strict>([](const auto& source) {
    const Bytes frame = frame_of(source, 0x01, {1, 2});
    Watched<decltype(source)> recorder(source);
    recorder.feed(Bytes{0x7A} + frame);
    CHECK(recorder.frames().size() == 1);
    CHECK(recorder.discarded(Cause::unknown_message) + recorder.discarded(Cause::length_out_of_range) == 1);
  });
}

TEST_CASE("skips_failed: without its closing delimiter a candidate costs one byte, and what begins in it is found") {
  for_both_sources<StrictDoubled>([](const auto& source) {
    const Bytes frame = frame_of(source, 0x10, {1, 2});
    const std::size_t longest = wirebond::max_wire_bytes(source.format());
    for (const std::size_t between : {std::size_t{0}, std::size_t{1}, longest / 2, longest - 3}) {
      CAPTURE(between);
      const std::size_t before = 2 + between;  // at most the frame's first byte is the last one of the candidate
      Watched<decltype(source)> recorder(source);
      recorder.feed(Bytes{0x10, 0x02} + Bytes(between, 0x41) + frame);
      REQUIRE(recorder.frames().size() == 1);
      CHECK(recorder.frames()[0].offset == before);
      CHECK(recorder.account().settled() == before + recorder.account().frame_bytes);
      CHECK(recorder.account().fill_bytes == 0);
    }
  });
}

TEST_CASE("skips_failed: an incomplete frame is given up with all that it held") {
  for_both_sources<Strict>([](const auto& source) {
    const Bytes inner = frame_of(source, 0x01, {1, 2});
    const Bytes outer = frame_of(source, 0x02, inner + inner);
    Watched<decltype(source)> recorder(source, 20'000);
    recorder.feed(Bytes(outer.begin(), outer.end() - 3), 0);
    recorder.idle(20'000);
    CHECK(recorder.frames().empty());
    CHECK(recorder.discarded(Cause::incomplete) == outer.size() - 3);
  });
}
