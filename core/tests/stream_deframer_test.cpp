// Single streams: false starts, silence, delimiters, unknown messages, and which bucket each byte lies in.
#include <doctest/doctest.h>

#include <cstdint>
#include <vector>

#include "formats.hpp"
#include "recorder.hpp"

using namespace formats;
using wirebond::Cause;

namespace {

template <class Source>
using Watched = Recorder<std::decay_t<Source>>;

}  // namespace

// ---- frames found by their start ---------------------------------------------------------------------------------

TEST_CASE("a false start with a long length holds a frame back until the line is idle, no longer") {
  for_both_sources<WeakSum>([](const auto& source) {
    Watched<decltype(source)> recorder(source, 20'000);
    const Bytes frame = frame_of(source, 0x01, {1, 2});
    recorder.feed(Bytes{0x7A, 0x02, 200} + frame, 5'000);
    CHECK(recorder.frames().empty());
    CHECK(recorder.pending() == 3 + frame.size());
    recorder.idle(24'999);
    CHECK(recorder.frames().empty());
    recorder.idle(25'000);
    REQUIRE(recorder.frames().size() == 1);
    CHECK(recorder.frames()[0].offset == 3);
    CHECK(recorder.pending() == 0);
    CHECK(recorder.discarded(Cause::incomplete) == 3);
  });
}

TEST_CASE("a false start holds good frames back by one largest frame at most") {
  for_both_sources<WeakSum>([](const auto& source) {
    Watched<decltype(source)> recorder(source);
    const Bytes frame = frame_of(source, 0x01, {1, 2});
    recorder.feed({0x7A, 0x02, 200});
    for (unsigned i = 0; i < 205; i += static_cast<unsigned>(frame.size())) recorder.feed(frame);
    CHECK(recorder.frames().size() == 205 / frame.size() + 1);
  });
}

TEST_CASE("a pause inside a frame that is shorter than idle does it no harm") {
  for_both_sources<HeaderChecked>([](const auto& source) {
    Watched<decltype(source)> recorder(source, 20'000);
    const Bytes frame = frame_of(source, 0xA1, {1, 2, 3, 4});
    const std::uint32_t start = 0xFFFFFFFFu - 9'000;  // the clock wraps between the two halves
    recorder.feed(Bytes(frame.begin(), frame.begin() + 6), start);
    recorder.idle(start + 19'999);
    CHECK(recorder.pending() == 6);
    recorder.feed(Bytes(frame.begin() + 6, frame.end()), start + 30'000);
    CHECK(recorder.frames().size() == 1);
  });
}

TEST_CASE("a pause inside a frame that is longer than idle gives it up; the next one arrives") {
  for_both_sources<HeaderChecked>([](const auto& source) {
    Watched<decltype(source)> recorder(source, 20'000);
    const Bytes frame = frame_of(source, 0xA1, {1, 2, 3, 4});
    const std::uint32_t start = 0xFFFFFFFFu - 9'000;
    recorder.feed(Bytes(frame.begin(), frame.begin() + 6), start);
    recorder.idle(start + 20'000);
    CHECK(recorder.pending() == 0);
    CHECK(recorder.discarded(Cause::incomplete) == 6);
    recorder.feed(Bytes(frame.begin() + 6, frame.end()) + frame, start + 30'000);
    REQUIRE(recorder.frames().size() == 1);
    CHECK(recorder.frames()[0].offset == frame.size());
  });
}

TEST_CASE("idle on a quiet line does nothing, however often") {
  for_both_sources<HeaderChecked>([](const auto& source) {
    Watched<decltype(source)> recorder(source);
    recorder.idle(0xFFFFFFFFu);
    recorder.feed(frame_of(source, 0xA1, {1, 2, 3, 4}), 10);
    recorder.idle(1'000'000);
    recorder.idle(2'000'000);
    CHECK(recorder.frames().size() == 1);
    CHECK(recorder.account().settled() == 11);
  });
}

TEST_CASE("a frame inside the payload of a damaged one is found") {
  for_both_sources<HeaderChecked>([](const auto& source) {
    Watched<decltype(source)> recorder(source);
    const Bytes inner = frame_of(source, 0xA1, {1, 2, 3, 4});
    Bytes outer = frame_of(source, 0xA2, inner);
    outer.back() ^= 1;
    recorder.feed(outer);
    REQUIRE(recorder.frames().size() == 1);
    CHECK(recorder.frames()[0].offset == 5);
    CHECK(recorder.frames()[0].wire == inner);
    CHECK(recorder.discarded(Cause::check_mismatch) == outer.size() - inner.size());
    CHECK(recorder.rejected(Cause::check_mismatch) == 1);
  });
}

TEST_CASE("a frame whose payload holds a frame is one frame") {
  for_both_sources<HeaderChecked>([](const auto& source) {
    Watched<decltype(source)> recorder(source);
    recorder.feed(frame_of(source, 0xA2, frame_of(source, 0xA1, {1, 2, 3, 4})));
    REQUIRE(recorder.frames().size() == 1);
    CHECK(recorder.frames()[0].id == 0xA2);
  });
}

TEST_CASE("every cause of a discard is told apart") {
  for_both_sources<HeaderChecked>([](const auto& source) {
    Watched<decltype(source)> recorder(source);
    recorder.feed({0x01, 0x02});
    CHECK(recorder.discarded(Cause::no_start) == 2);
    recorder.feed({0xAA, 41, 0xA2, 0, 0});
    CHECK(recorder.discarded(Cause::length_out_of_range) == 5);
    recorder.feed({0xAA, 4, 0xA1, 0, 0});
    CHECK(recorder.discarded(Cause::header_check_mismatch) == 5);
    Bytes damaged = frame_of(source, 0xA1, {1, 2, 3, 4});
    damaged[7] ^= 0x10;
    recorder.feed(damaged);
    CHECK(recorder.discarded(Cause::check_mismatch) == 11);
    recorder.feed({0xAA});
    recorder.give_up();
    CHECK(recorder.discarded(Cause::incomplete) == 1);
  });
  for_both_sources<FixedSize>([](const auto& source) {
    Watched<decltype(source)> recorder(source);
    recorder.feed({0xAA, 0x56});
    CHECK(recorder.rejected(Cause::constant_mismatch) == 1);
    CHECK(recorder.discarded(Cause::constant_mismatch) == 1);
    Bytes wrong_tail = frame_of(source, 0x01, {1, 2, 3, 4});
    wrong_tail.back() = 0x0E;
    recorder.feed(wrong_tail);
    CHECK(recorder.discarded(Cause::constant_mismatch) == 12);
    recorder.feed({0xAA, 0x55, 0x77});
    CHECK(recorder.discarded(Cause::unknown_message) == 3);
  });
}

TEST_CASE("reserved bytes may hold anything that the check covers") {
  for_both_sources<FixedSize>([](const auto& source) {
    Watched<decltype(source)> recorder(source);
    Bytes frame = frame_of(source, 0x01, {1, 2, 3, 4});
    frame[7] ^= 0x5A;
    frame[9] ^= 0x5A;
    recorder.feed(frame);
    CHECK(recorder.frames().size() == 1);
  });
}

TEST_CASE("strong checks deliver unknown ids and longer payloads, weak ones do not") {
  for_both_sources<HeaderChecked>([](const auto& source) {
    Watched<decltype(source)> recorder(source);
    recorder.feed(frame_of(source, 0x7F, {1, 2}));
    recorder.feed(frame_of(source, 0xA1, {1, 2, 3, 4, 5}));  // a newer peer's
    recorder.feed(frame_of(source, 0xA1, {1, 2, 3}));        // too short to be understood
    REQUIRE(recorder.frames().size() == 3);
    CHECK(recorder.frames()[0].message == -1);
    CHECK(recorder.frames()[0].id == 0x7F);
    CHECK(recorder.frames()[1].message == 0);
    CHECK(recorder.frames()[2].message == -1);
    CHECK(recorder.account().unknown_frames == 2);
  });
  for_both_sources<WeakSum>([](const auto& source) {
    Watched<decltype(source)> recorder(source);
    recorder.feed(frame_of(source, 0x7F, {1, 2}));
    recorder.feed(frame_of(source, 0x01, {1, 2, 3}));
    recorder.give_up();
    CHECK(recorder.frames().empty());
    CHECK(recorder.rejected(Cause::unknown_message) == 2);
  });
}

TEST_CASE("ten thousand start bytes in a row leave less than one frame pending") {
  for_both_sources<WeakSum>([](const auto& source) {
    Watched<decltype(source)> recorder(source);
    recorder.feed(Bytes(10'000, 0x7A));
    CHECK(recorder.pending() < wirebond::max_wire_bytes(source.format()));
    CHECK(recorder.frames().empty());
  });
}

TEST_CASE("frames of a chunk that begins with one are handed out in place") {
  const Constant<HeaderChecked> source;
  Bytes workspace(wirebond::workspace_bytes(source));
  wirebond::StreamDeframer<Constant<HeaderChecked>> deframer(source, workspace.data(), 20'000);
  const Bytes frame = frame_of(source, 0xA1, {1, 2, 3, 4});
  const Bytes chunk = frame + frame;
  std::vector<const std::uint8_t*> wires;
  deframer.feed(chunk.data(), chunk.size(), 0, [&](const wirebond::Frame& found) { wires.push_back(found.wire); });
  CHECK(wires == std::vector<const std::uint8_t*>{chunk.data(), chunk.data() + frame.size()});
}

TEST_CASE("two forms are told apart by their constants") {
  static constexpr std::array<MessageRow, 1> rows = {{{1, {0, 1, 2}}}};
  FrameFormat format = WeakSum::make();
  format.max_payload = 2;
  format.form_count = 2;
  format.forms[1] = format.forms[0];
  format.forms[1].constants[0].value = 0x7C;
  format.forms[1].payload_size = PayloadSize::fixed;
  format.forms[1].fixed_payload = 1;
  const wirebond::RuntimeTables tables(format, rows.data(), rows.size());
  Recorder<wirebond::RuntimeSource> recorder{wirebond::RuntimeSource(tables)};
  recorder.feed({0x00, 0x7A, 0x01, 0x02, 0xFF, 0xFF, 0x02, 0x7B, 0x7C, 0x01, 0x55, 0x10, 0x00, 0x7B, 0x7C, 0x01});
  recorder.give_up();
  REQUIRE(recorder.frames().size() == 2);
  CHECK(recorder.frames()[0].payload == Bytes{0xFF, 0xFF});
  CHECK(recorder.frames()[1].payload == Bytes{0x10});
  CHECK(recorder.frames()[1].offset == 8);
}

TEST_CASE("of messages that share an id the expected one is meant, and without a request the one that needs none") {
  static constexpr std::array<MessageRow, 4> rows = {
      {{0x01, {2, 3, 3}, true}, {0x01, {1, 2, 2}, true}, {0x01, {0, 1, 1}}, {0x0300, {3, 1, 1}, true}}};
  const FrameFormat format = WeakSum::make();
  const wirebond::RuntimeTables tables(format, rows.data(), rows.size());
  const wirebond::RuntimeSource source(tables);
  Recorder<wirebond::RuntimeSource> recorder{source};
  const std::vector<Bytes> payloads = {{1}, {1, 2}, {1, 2, 3}};
  for (const std::int16_t expected : std::initializer_list<std::int16_t>{-1, 1, 2, 7, -1}) {
    recorder.expect(expected);
    const std::size_t before = recorder.frames().size();
    for (const Bytes& payload : payloads) recorder.feed(frame_of(source, 0x01, payload));
    recorder.give_up();
    const int meant = expected == 1 || expected == 2 ? expected : 0;
    REQUIRE(recorder.frames().size() == before + 1);
    CHECK(recorder.frames().back().message == meant);
    CHECK(recorder.frames().back().payload == payloads[static_cast<std::size_t>(meant)]);
  }
  CHECK(tables.message(0x0300, 3).index == 3);
  CHECK(tables.message(0x0300, -1).index == -1);
}

// ---- frames between delimiters -----------------------------------------------------------------------------------

TEST_CASE("delimiters between frames are fill, a shared one belongs to the frame it ends") {
  for_both_sources<Delimited>([](const auto& source) {
    Watched<decltype(source)> recorder(source);
    const Bytes frame = frame_of(source, 0x01, {1, 0, 3});
    const Bytes shared(frame.begin() + 1, frame.end());
    recorder.feed(Bytes{0, 0, 0} + frame + shared + Bytes{0, 0} + frame + Bytes{0});
    REQUIRE(recorder.frames().size() == 3);
    CHECK(recorder.frames()[0].offset == 3);
    CHECK(recorder.frames()[0].wire == frame);
    CHECK(recorder.frames()[1].offset == 3 + frame.size());
    CHECK(recorder.frames()[1].wire == shared);
    CHECK(recorder.account().fill_bytes == 5);
    CHECK(recorder.pending() == 1);  // may open the next frame
    recorder.give_up();
    CHECK(recorder.account().fill_bytes == 6);
  });
}

TEST_CASE("garbage before the first delimiter costs itself only") {
  for_both_sources<Delimited>([](const auto& source) {
    Watched<decltype(source)> recorder(source);
    const Bytes frame = frame_of(source, 0x01, {1, 0, 3});
    recorder.feed(Bytes{9, 9, 9, 9, 9} + frame);
    REQUIRE(recorder.frames().size() == 1);
    CHECK(recorder.frames()[0].offset == 5);
    CHECK(recorder.discarded(Cause::bad_stuffing) == 5);
  });
}

TEST_CASE("a block that is longer than any frame is thrown away up to its delimiter, which opens the next") {
  for_both_sources<Delimited>([](const auto& source) {
    Watched<decltype(source)> recorder(source);
    const Bytes frame = frame_of(source, 0x01, {1, 0, 3});
    for (int i = 0; i < 5; ++i) recorder.feed(Bytes(777, 0x11));
    CHECK(recorder.pending() == 0);
    recorder.feed(frame);
    REQUIRE(recorder.frames().size() == 1);
    CHECK(recorder.frames()[0].offset == 5 * 777);
    CHECK(recorder.discarded(Cause::length_out_of_range) == 5 * 777);
    CHECK(recorder.rejected(Cause::length_out_of_range) == 1);
  });
}

TEST_CASE("the largest frame is no longer than that") {
  for_both_sources<Delimited>([](const auto& source) {
    Watched<decltype(source)> recorder(source);
    const Bytes frame = frame_of(source, 0x02, Bytes(300, 0x77));
    recorder.feed_in_chunks(frame + frame, 1);
    CHECK(recorder.frames().size() == 2);
    CHECK(frame_of(source, 0x02, Bytes(301, 0x77)).empty());
  });
}

TEST_CASE("a damaged block gives its delimiter to the next frame") {
  for_both_sources<Delimited>([](const auto& source) {
    Watched<decltype(source)> recorder(source);
    const Bytes frame = frame_of(source, 0x01, {1, 0, 3});
    Bytes damaged = frame;
    damaged[2] ^= 0x40;
    const Bytes shared(frame.begin() + 1, frame.end());
    recorder.feed(damaged + shared);
    REQUIRE(recorder.frames().size() == 1);
    CHECK(recorder.frames()[0].offset == damaged.size() - 1);
    CHECK(recorder.frames()[0].wire == frame);
    CHECK(recorder.discarded(Cause::check_mismatch) == damaged.size() - 1);
  });
}

TEST_CASE("a delimited frame that stops half-way is given up when the line is idle") {
  for_both_sources<Delimited>([](const auto& source) {
    Watched<decltype(source)> recorder(source, 20'000);
    const Bytes frame = frame_of(source, 0x01, {1, 2, 3});
    recorder.feed(Bytes(frame.begin(), frame.begin() + 5), 0xFFFFFFF0u);
    recorder.idle(0xFFFFFFF0u + 19'999);
    CHECK(recorder.pending() == 5);
    recorder.idle(0xFFFFFFF0u + 20'000);
    CHECK(recorder.pending() == 0);
    CHECK(recorder.discarded(Cause::incomplete) == 5);
    recorder.feed(frame, 30'000);
    CHECK(recorder.frames().size() == 1);
  });
}

TEST_CASE("counters of 32 bits wrap and still close") {
  const Constant<HeaderChecked> source;
  Recorder<Constant<HeaderChecked>, std::uint16_t> recorder(source, 20'000);
  for (int i = 0; i < 70; ++i) recorder.feed(Bytes(1'000, 0x11));  // 70 000 bytes through a counter of 16 bits
  CHECK(recorder.discarded(Cause::no_start) == 70'000 - 65'536);
}
