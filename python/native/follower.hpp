// Converts a continuing stream of bytes to numpy columns, batch by batch, as columns.hpp does for a whole capture.
#pragma once

#include <nanobind/nanobind.h>

#include <memory>
#include <vector>

#include "decoder.hpp"
#include "wirebond/engine/capture.hpp"
#include "wirebond/engine/protocol.hpp"

namespace wirebond::engine {

/// One direction of a link. One thread at a time. Between two calls it keeps only an incomplete frame.
class Follower {
 public:
  Follower(std::shared_ptr<const ProtocolTable> protocol, std::shared_ptr<const FormatTable> format,
           double idle_seconds);

  /// `reads`: see `decode_timed_columns`, without `idle`; a break after the last read has the index of the next one.
  /// Offsets count from the first byte of all. The tables have `size` beside `offset`.
  nb::dict feed(nb::handle bytes, const nb::dict& reads);
  /// Note that a read that began at `t` found nothing.
  nb::dict idle(double t);
  /// Return the tables of all messages without rows: their columns and types.
  nb::dict tables() const;
  /// Return how many bytes are settled: later ones may become a frame.
  std::uint64_t settled() const { return deframer_.bytes() - deframer_.pending(); }
  /// See `Decoder::stats`; without sequence numbers.
  nb::object stats() const;

 private:
  /// One sink for all functions that feed: the deframer is compiled again for each type of sink.
  struct Collecting;
  Capture empty() const;

  std::shared_ptr<const ProtocolTable> protocol_;
  std::shared_ptr<const FormatTable> format_;
  std::vector<std::uint8_t> workspace_;
  HostDeframer deframer_;
  std::vector<std::uint64_t> counts_;  ///< by message
  double time_ = 0;
};

/// Register it with Python.
void bind_follower(nb::module_& module);

}  // namespace wirebond::engine
