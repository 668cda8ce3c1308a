// Converts a continuing stream of bytes to rows of payloads, batch by batch.
#pragma once

#include <cstddef>
#include <cstdint>
#include <memory>
#include <utility>
#include <vector>

#include "wirebond/engine/batch.hpp"
#include "wirebond/engine/node.hpp"
#include "wirebond/engine/rows.hpp"

namespace wirebond::engine {

/// The reads in which some bytes came, and events between them.
struct Reads {
  const std::uint64_t* ends = nullptr;  ///< end of each read in the bytes; they do not fall
  const double* times = nullptr;        ///< start of each read, in seconds
  std::size_t count = 0;
  std::vector<std::size_t>
      breaks{};  ///< the port was closed before the read of this index; `count`: after the last one
  std::vector<std::pair<std::size_t, std::int16_t>> expected{};  ///< before this read, this message was requested
};

/// One direction of a link. One thread at a time. Between two calls it keeps only an incomplete frame.
class Follower {
 public:
  Follower(std::shared_ptr<const ProtocolTable> protocol, std::shared_ptr<const FormatTable> format,
           double idle_seconds);

  /// Return the frames that these bytes completed. Offsets count from the first byte of all; rows have sizes.
  Capture feed(const std::uint8_t* bytes, const Reads& reads);
  /// Note that a read that began at `t` found nothing. Throws std::invalid_argument if `t` is not a time.
  Capture idle(double t);
  /// Return the rows of no bytes.
  Capture empty() const;
  /// Return how many bytes are settled: later ones may become a frame.
  std::uint64_t settled() const { return deframer_.bytes() - deframer_.pending(); }
  /// See `account_node`; without sequence numbers.
  Node account() const;

  const ProtocolTable& protocol() const { return *protocol_; }
  const FormatTable& format() const { return *format_; }

 private:
  /// One sink for all functions that feed: the deframer is compiled again for each type of sink.
  struct Collecting;

  std::shared_ptr<const ProtocolTable> protocol_;
  std::shared_ptr<const FormatTable> format_;
  std::vector<std::uint8_t> workspace_;
  HostDeframer deframer_;
  std::vector<std::uint64_t> counts_;  ///< by message
  double time_ = 0;
};

}  // namespace wirebond::engine
