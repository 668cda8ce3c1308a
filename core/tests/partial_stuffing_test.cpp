// Frames of which only a part is stuffed, with checks taken before and after that.
#include <doctest/doctest.h>

#include <cstdint>

#include "formats.hpp"
#include "recorder.hpp"

using namespace formats;
using wirebond::Cause;

namespace {

/// Whether each frame comes back as it was, with payloads of every size and of bytes that stuffing moves.
template <class Format>
void frames_come_back() {
  for_both_sources<Format>([](const auto& source) {
    for (std::size_t size = 0; size <= 300; ++size) {
      CAPTURE(size);
      Bytes payload(size, 0x5A);
      for (std::size_t i = 0; i < size; i += 7) payload[i] = i % 2 == 0 ? 0x00 : 0x7D;
      const Bytes frame = frame_of(source, 0x11, payload);
      REQUIRE(frame.size() >= size + 5);
      CHECK(frame[1] == 0x11);
      CHECK(frame[frame.size() - 2] == 0xFE);
      std::uint8_t sum = 0;
      for (std::size_t i = 1; i + 3 < frame.size(); ++i) sum = static_cast<std::uint8_t>(sum ^ frame[i]);
      CHECK(frame[frame.size() - 3] == sum);
      if (sum == 0) continue;  // it cuts its frame
      Recorder<std::decay_t<decltype(source)>> recorder(source);
      recorder.feed_in_chunks(frame, 5);
      REQUIRE(recorder.frames().size() == 1);
      CHECK(recorder.frames()[0].payload == payload);
    }
  });
}

}  // namespace

TEST_CASE("the bytes beside the stuffed ones are sent as they are: COBS") { frames_come_back<PartlyStuffed>(); }
TEST_CASE("the bytes beside the stuffed ones are sent as they are: escapes") { frames_come_back<PartlyEscaped>(); }

TEST_CASE("COBS of a part, byte by byte") {
  for_both_sources<PartlyStuffed>([](const auto& source) {
    // Payload 07 00, exclusive-or 07; COBS: 02 07 02 07; exclusive-or of 10 02 07 02 07: 10.
    CHECK(frame_of(source, 0x10, {0x07, 0x00}) == Bytes{0x00, 0x10, 0x02, 0x07, 0x02, 0x07, 0x10, 0xFE, 0x00});
  });
}

TEST_CASE("a check over the bytes as they are sent is looked at, and the one before stuffing too") {
  for_both_sources<PartlyStuffed>([](const auto& source) {
    const Bytes good = frame_of(source, 0x10, {0x07, 0x00});
    for (const std::size_t at : {3u, 6u}) {  // a byte of the payload; the outer check alone
      Bytes bad = good;
      bad[at] ^= 0x40;
      if (at == 3) bad[6] ^= 0x40;  // the outer check holds again: the inner one is left
      Recorder<std::decay_t<decltype(source)>> recorder(source);
      recorder.feed(bad);
      CHECK(recorder.frames().empty());
      CHECK(recorder.discarded(Cause::check_mismatch) != 0);
    }
  });
}

TEST_CASE("a block too short for the bytes beside the stuffed ones is refused") {
  for_both_sources<PartlyStuffed>([](const auto& source) {
    Recorder<std::decay_t<decltype(source)>> recorder(source);
    recorder.feed({0x00, 0x10, 0xFE, 0x00});
    CHECK(recorder.frames().empty());
    CHECK(recorder.discarded(Cause::bad_stuffing) == 3);
  });
}
