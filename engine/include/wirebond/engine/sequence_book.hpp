// Counts from the sequence numbers of received frames, for each peer.
#pragma once

#include <cstddef>
#include <cstdint>
#include <memory>
#include <unordered_map>
#include <utility>
#include <vector>

#include "wirebond/engine/protocol.hpp"
#include "wirebond/examine.hpp"
#include "wirebond/sequence.hpp"

namespace wirebond::engine {

/// The number of one frame, and its peer.
struct SeenNumber {
  std::uint64_t peer = 0;
  std::uint64_t number = 0;
  std::int16_t message = -1;
};

/// Read the frame's number. Returns false if it has none that is counted.
bool see_number(const FrameFormat& format, const Frame& frame, SeenNumber& seen);

/// Counts of all peers, in the order in which they were first heard.
struct SequenceAccount {
  bool has_numbers = false;
  std::vector<std::pair<std::uint64_t, SequenceCounts<std::uint64_t>>> peers;
};

/// One thread at a time.
class SequenceBook {
 public:
  static constexpr std::size_t max_peers = 4096;  ///< frames of further peers are not counted

  explicit SequenceBook(std::shared_ptr<const FormatTable> format) : format_(std::move(format)) {}

  void take(const Frame& frame) {
    SeenNumber seen;
    if (see_number(format_->format(), frame, seen)) take(seen);
  }
  void take(const SeenNumber& seen);

  SequenceAccount account() const;

 private:
  struct Peer {
    SequenceCounts<std::uint64_t> counts;
    std::vector<SequenceTrack<std::uint64_t>> tracks;  ///< one, or one for each message that was heard, by index
  };

  std::shared_ptr<const FormatTable> format_;
  std::uint64_t mask_ = sequence_mask(format_->format());
  std::unordered_map<std::uint64_t, std::size_t> places_;  ///< of peers
  std::vector<std::pair<std::uint64_t, Peer>> peers_;
};

}  // namespace wirebond::engine
