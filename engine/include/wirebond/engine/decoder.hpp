// Converts a stream of bytes to received messages. Waits for nothing, opens nothing; time is an argument.
#pragma once

#include <cstddef>
#include <cstdint>
#include <memory>
#include <optional>
#include <vector>

#include "wirebond/engine/batch.hpp"
#include "wirebond/engine/node.hpp"
#include "wirebond/engine/sequence_book.hpp"
#include "wirebond/host/addressing.hpp"

namespace wirebond::engine {

/// A format with its deframer. One thread at a time. Times are finite seconds, within 9e12.
class Decoder {
 public:
  Decoder(std::shared_ptr<const ProtocolTable> protocol, std::shared_ptr<const FormatTable> format,
          double idle_seconds);

  Arrivals feed(const std::uint8_t* bytes, std::size_t size, double time);
  /// Note that a read that began at `time` found nothing.
  Arrivals idle(double time);
  /// No byte will ever follow.
  Arrivals finish();
  /// Return a batch for `read`.
  Arrivals none() const;
  /// `idle`, and `feed` with the bytes of one read; append the messages. Without `keep` they are only counted. Throws
  /// std::length_error beyond 2 GiB of frames.
  void read(const std::uint8_t* bytes, std::size_t size, double time, bool keep, Arrivals& to);
  /// `address`: of the header field at `place` of the format's list; replies from others are foreign then.
  void expect(std::int16_t message, int place, std::optional<std::uint64_t> address);
  /// See `account_node`.
  Node account() const;

 private:
  std::uint64_t microseconds(double time);
  /// One sink for all functions that feed. It has a name because the deframer is compiled again for each type of sink,
  /// which takes ten seconds each time.
  struct Recording;

  std::shared_ptr<const ProtocolTable> protocol_;
  std::shared_ptr<const FormatTable> format_;
  std::vector<std::uint8_t> workspace_;
  HostDeframer deframer_;
  std::vector<std::uint64_t> counts_;  ///< by message
  SequenceBook sequence_;
  HostAddressing addressing_;
  ForeignCounts foreign_;
  double latest_ = 0;
};

}  // namespace wirebond::engine
