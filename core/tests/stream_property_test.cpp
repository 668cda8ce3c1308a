// Properties of streams: chunking changes nothing, intact frames arrive, both sources agree.
#include <doctest/doctest.h>

#include <algorithm>
#include <cstdint>
#include <random>
#include <vector>

#include "formats.hpp"
#include "recorder.hpp"

using namespace formats;

namespace {

class Random {
 public:
  explicit Random(unsigned seed) : engine_(seed) {}
  unsigned operator()() { return static_cast<unsigned>(engine_()); }

 private:
  std::mt19937 engine_;
};

std::uint8_t any_byte(Random& random) { return static_cast<std::uint8_t>(random()); }

Bytes random_frame(const wirebond::RuntimeSource& source, const MessageRow* rows, std::size_t row_count,
                   Random& random) {
  const MessageRow& row = rows[random() % row_count];
  const std::size_t spread = row.shape.max_payload - row.shape.min_payload;
  Bytes payload(row.shape.min_payload + (spread == 0 ? 0 : random() % (std::min<std::size_t>(spread, 60) + 1)));
  for (auto& byte : payload) byte = random() % 3 == 0 ? 0 : any_byte(random);
  return frame_of(source, row.id, payload);
}

/// Frames, damaged frames, cut frames, runs of the start byte, noise: whatever a line may hold.
template <class Format>
Bytes random_stream(Random& random) {
  const wirebond::RuntimeSource source = run_time<Format>();
  const FrameFormat& format = source.format();
  const std::uint8_t start =
      format.framing != Framing::by_start ? format.opening.first : format.forms[0].constants[0].value;
  Bytes stream;
  const unsigned parts = 1 + random() % 8;
  for (unsigned part = 0; part < parts; ++part) {
    Bytes frame = random_frame(source, Format::rows.data(), Format::rows.size(), random);
    switch (random() % 7) {
      case 0: frame[random() % frame.size()] ^= static_cast<std::uint8_t>(1u << random() % 8); break;
      case 1: frame.resize(random() % frame.size()); break;
      case 2: frame.erase(frame.begin(), frame.begin() + static_cast<std::ptrdiff_t>(random() % frame.size())); break;
      case 3: frame = Bytes(random() % 12, start); break;
      case 4:
        frame.resize(random() % 700);
        for (auto& byte : frame) byte = random() % 4 == 0 ? start : any_byte(random);
        break;
      default: break;
    }
    stream = stream + frame;
  }
  return stream;
}

template <class Source>
void expect_same(const Recorder<Source>& left, const Recorder<Source>& right) {
  REQUIRE(left.frames() == right.frames());
  REQUIRE(left.account().fill_bytes == right.account().fill_bytes);
  for (std::size_t cause = 0; cause < wirebond::cause_count; ++cause) {
    CAPTURE(cause);
    REQUIRE(left.account().discarded_bytes[cause] == right.account().discarded_bytes[cause]);
    REQUIRE(left.account().rejected_candidates[cause] == right.account().rejected_candidates[cause]);
  }
}

template <class Format>
void chunking_changes_nothing() {
  for_both_sources<Format>([](const auto& source) {
    using Source = std::decay_t<decltype(source)>;
    for (unsigned seed = 0; seed < 150; ++seed) {
      CAPTURE(seed);
      Random random(seed);
      const Bytes stream = random_stream<Format>(random);
      Recorder<Source> whole(source);
      whole.feed(stream);
      whole.give_up();
      for (const unsigned chunk : {1u, 2u, 7u, 1 + random() % 200}) {
        CAPTURE(chunk);
        Recorder<Source> pieces(source);
        pieces.feed_in_chunks(stream, chunk);
        pieces.give_up();
        expect_same(whole, pieces);
      }
    }
  });
}

template <class Format>
void sources_agree() {
  for (unsigned seed = 1000; seed < 1150; ++seed) {
    CAPTURE(seed);
    Random random(seed);
    const Bytes stream = random_stream<Format>(random);
    Recorder<Constant<Format>> constant{Constant<Format>{}};
    Recorder<wirebond::RuntimeSource> read(run_time<Format>());
    constant.feed_in_chunks(stream, 64);
    read.feed_in_chunks(stream, 64);
    constant.give_up();
    read.give_up();
    REQUIRE(constant.frames() == read.frames());
    for (std::size_t cause = 0; cause < wirebond::cause_count; ++cause) {
      REQUIRE(constant.account().discarded_bytes[cause] == read.account().discarded_bytes[cause]);
    }
  }
}

/// Noise holds no start byte, and a delimited stream is delimited on both sides: then nothing may overlap a frame.
template <class Format>
void intact_frames_arrive() {
  for_both_sources<Format>([](const auto& source) {
    using Source = std::decay_t<decltype(source)>;
    const FrameFormat& format = source.format();
    const std::uint8_t start =
        format.framing == Framing::by_start ? format.forms[0].constants[0].value : format.opening.first;
    for (unsigned seed = 2000; seed < 2100; ++seed) {
      CAPTURE(seed);
      Random random(seed);
      Bytes stream;
      std::vector<std::pair<std::size_t, Bytes>> sent;
      for (unsigned i = 0; i < 6; ++i) {
        for (unsigned noise = random() % 30; noise > 0; --noise) {
          const std::uint8_t byte = any_byte(random);
          if (byte != start) stream.push_back(byte);
        }
        const Bytes frame = random_frame(run_time<Format>(), Format::rows.data(), Format::rows.size(), random);
        sent.emplace_back(stream.size(), frame);
        stream = stream + frame;
      }
      Recorder<Source> recorder(source);
      recorder.feed_in_chunks(stream, 1 + random() % 40);
      REQUIRE(recorder.frames().size() == sent.size());
      for (std::size_t i = 0; i < sent.size(); ++i) {
        CHECK(recorder.frames()[i].offset == sent[i].first);
        CHECK(recorder.frames()[i].wire == sent[i].second);
        CHECK(recorder.frames()[i].message >= 0);
      }
    }
  });
}

}  // namespace

TEST_CASE("chunking changes no frame, no offset, no account: header check") {
  chunking_changes_nothing<HeaderChecked>();
}
TEST_CASE("chunking changes no frame, no offset, no account: fixed size") { chunking_changes_nothing<FixedSize>(); }
TEST_CASE("chunking changes no frame, no offset, no account: weak sum") { chunking_changes_nothing<WeakSum>(); }
TEST_CASE("chunking changes no frame, no offset, no account: delimited") { chunking_changes_nothing<Delimited>(); }
TEST_CASE("chunking changes no frame, no offset, no account: id last") { chunking_changes_nothing<BigEndian>(); }
TEST_CASE("chunking changes no frame, no offset, no account: doubled") { chunking_changes_nothing<Doubled>(); }
TEST_CASE("chunking changes no frame, no offset, no account: lines") { chunking_changes_nothing<Lines>(); }
TEST_CASE("chunking changes no frame, no offset, no account: strict") { chunking_changes_nothing<Strict>(); }
TEST_CASE("chunking changes no frame, no offset, no account: partly") { chunking_changes_nothing<PartlyStuffed>(); }

TEST_CASE("constant and run-time source agree on any stream") {
  sources_agree<HeaderChecked>();
  sources_agree<FixedSize>();
  sources_agree<WeakSum>();
  sources_agree<Delimited>();
  sources_agree<BigEndian>();
  sources_agree<Doubled>();
  sources_agree<Lines>();
  sources_agree<Strict>();
  sources_agree<PartlyStuffed>();
  sources_agree<PartlyEscaped>();
}

TEST_CASE("intact frames between noise arrive, once, in order, where they were: header check") {
  intact_frames_arrive<HeaderChecked>();
}
TEST_CASE("intact frames between noise arrive, once, in order, where they were: fixed size") {
  intact_frames_arrive<FixedSize>();
}
TEST_CASE("intact frames between noise arrive, once, in order, where they were: weak sum") {
  intact_frames_arrive<WeakSum>();
}
TEST_CASE("intact frames between noise arrive, once, in order, where they were: delimited") {
  intact_frames_arrive<Delimited>();
}
TEST_CASE("intact frames between noise arrive, once, in order, where they were: id last") {
  intact_frames_arrive<BigEndian>();
}
TEST_CASE("intact frames between noise arrive, once, in order, where they were: doubled") {
  intact_frames_arrive<Doubled>();
}
