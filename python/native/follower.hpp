// Bytes that go on coming, to numpy columns: what a capture gives at once, batch by batch.
#pragma once

#include <nanobind/nanobind.h>

#include <memory>
#include <vector>

#include "capture.hpp"
#include "decoder.hpp"
#include "protocol.hpp"

namespace wirebond::engine {

/// One direction of a link. One thread at a time. It keeps an incomplete frame, and nothing else, between two calls.
class Follower {
 public:
  Follower(std::shared_ptr<const ProtocolTable> protocol, std::shared_ptr<const FormatTable> format,
           double idle_seconds);

  /// `reads` as for `decode_timed_columns`, without `idle`; a break behind the last read has the index of the next one.
  /// Offsets count from the first byte of all. The tables have `size` beside `offset`.
  nb::dict feed(nb::handle bytes, const nb::dict& reads);
  /// A read that began at `t` found nothing.
  nb::dict idle(double t);
  /// The tables of all messages without a row: which columns there are, and of which type.
  nb::dict tables() const;
  /// How many bytes are settled: what lies behind them may become a frame.
  std::uint64_t settled() const { return deframer_.bytes() - deframer_.pending(); }
  /// As `Decoder::stats`, without sequence numbers.
  nb::dict stats() const;

 private:
  template <class Step>
  nb::dict collect(Step step);

  std::shared_ptr<const ProtocolTable> protocol_;
  std::shared_ptr<const FormatTable> format_;
  std::vector<std::uint8_t> workspace_;
  HostDeframer deframer_;
  std::vector<std::uint64_t> counts_;  ///< by message
  double time_ = 0;
};

/// Make it known to Python.
void bind_follower(nb::module_& module);

}  // namespace wirebond::engine
