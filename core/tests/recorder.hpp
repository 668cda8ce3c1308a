// A stream deframer under observation: keeps every frame and checks the account after every call.
#pragma once

#include <doctest/doctest.h>

#include <cstdint>
#include <vector>

#include "formats.hpp"
#include "wirebond/stream_deframer.hpp"

namespace formats {

struct Found {
  std::uint64_t offset;
  std::uint32_t id;
  int message;
  Bytes payload;
  Bytes wire;

  bool operator==(const Found& other) const {
    return offset == other.offset && id == other.id && message == other.message && payload == other.payload &&
           wire == other.wire;
  }
};

template <class Source, class Counter = std::uint32_t>
class Recorder {
 public:
  explicit Recorder(const Source& source, Counter idle_us = 20'000)
      : workspace_(wirebond::workspace_bytes(source)), deframer_(source, workspace_.data(), idle_us) {}

  Recorder(const Recorder&) = delete;
  Recorder& operator=(const Recorder&) = delete;

  void feed(const Bytes& bytes, Counter now_us = 0) {
    const Bytes copy(bytes);  // of exactly this size, so that a read past it is seen
    deframer_.feed(copy.data(), copy.size(), now_us, sink_);
    check_account();
  }

  void feed_in_chunks(const Bytes& bytes, std::size_t chunk) {
    for (std::size_t at = 0; at < bytes.size(); at += chunk) {
      const std::size_t end = at + chunk < bytes.size() ? at + chunk : bytes.size();
      feed(Bytes(bytes.begin() + static_cast<std::ptrdiff_t>(at), bytes.begin() + static_cast<std::ptrdiff_t>(end)));
    }
  }

  void expect(std::int16_t index) { deframer_.expect(index); }

  void idle(Counter now_us) {
    deframer_.idle(now_us, sink_);
    check_account();
  }

  void give_up() {
    deframer_.give_up(sink_);
    check_account();
    CHECK(deframer_.pending() == 0);
  }

  const std::vector<Found>& frames() const { return frames_; }
  const wirebond::ByteAccount<Counter>& account() const { return deframer_.account(); }
  std::size_t pending() const { return deframer_.pending(); }
  Counter discarded(wirebond::Cause cause) const { return account().discarded_bytes[static_cast<std::size_t>(cause)]; }
  Counter rejected(wirebond::Cause cause) const {
    return account().rejected_candidates[static_cast<std::size_t>(cause)];
  }

 private:
  void take(const wirebond::Frame& frame) {
    frames_.push_back({frame.offset, frame.id, frame.message, Bytes(frame.payload, frame.payload + frame.payload_size),
                       Bytes(frame.wire, frame.wire + frame.wire_size)});
  }

  void check_account() const {
    REQUIRE(deframer_.bytes() == static_cast<Counter>(account().settled() + deframer_.pending()));
    REQUIRE(account().frames == static_cast<Counter>(frames_.size()));
    Counter frame_bytes = 0;
    Counter unknown = 0;
    for (const Found& found : frames_) {
      frame_bytes = static_cast<Counter>(frame_bytes + found.wire.size());
      if (found.message < 0) ++unknown;
    }
    REQUIRE(account().frame_bytes == frame_bytes);
    REQUIRE(account().unknown_frames == unknown);
  }

  // One type for all three calls, so that the deframer is compiled once for a source.
  struct Sink {
    Recorder& recorder;
    void operator()(const wirebond::Frame& frame) { recorder.take(frame); }
  };

  Bytes workspace_;
  wirebond::StreamDeframer<Source, Counter> deframer_;
  std::vector<Found> frames_;
  Sink sink_{*this};
};

}  // namespace formats
