// Counts missing frames from the sequence numbers of received ones. Numbers in, counts out; no byte.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <type_traits>

#include "wirebond/examine.hpp"
#include "wirebond/format.hpp"
#include "wirebond/placed_number.hpp"
#include "wirebond/source.hpp"
#include "wirebond/unroll.hpp"

namespace wirebond {

/// Counters modulo their type. A number is compared with the one before it from the same peer; the first number of a
/// peer only starts the comparison.
template <class Counter>
struct SequenceCounts {
  Counter numbered = 0;  ///< frames whose number was compared
  Counter gaps = 0;      ///< missing frames: numbers that were skipped
  Counter repeats = 0;   ///< frames with the number of the frame before
  Counter restarts = 0;  ///< jumps beyond half the range of numbers: the peer restarted, missing frames are unknown

  void add(const SequenceCounts& other) {
    numbered += other.numbered;
    gaps += other.gaps;
    repeats += other.repeats;
    restarts += other.restarts;
  }
};

/// Keeps the newest number of one counter of a peer. `Value` holds every number of the field, whose bits are `mask`.
/// With n bits, at most 2^(n-1) - 1 missing frames in a row can be distinguished from a restart.
template <class Value>
class SequenceTrack {
 public:
  template <class Counter>
  WIREBOND_INLINE void take(Value number, Value mask, SequenceCounts<Counter>& counts) {
    const auto step = static_cast<Value>(static_cast<Value>(number - newest_) & mask);
    newest_ = number;
    counts.numbered += 1;
    if (!has_begun_) {
      has_begun_ = true;
    } else if (step == 0) {
      counts.repeats += 1;
    } else if (step - 1 > mask / 2) {
      counts.restarts += 1;
    } else {
      counts.gaps += static_cast<Counter>(step - 1);
    }
  }

 private:
  Value newest_ = 0;
  bool has_begun_ = false;
};

/// Return the bits of the sequence number; 0 if no form of the format has one.
template <class Format>
constexpr std::uint64_t sequence_mask(const Format& format) {
  for (std::size_t i = 0; i < format.form_count; ++i) {
    const Number number = number_at(format.forms[i], format.sequence_place);
    if (number.present()) return number.mask;
  }
  return 0;
}

namespace detail {

/// Read this header field of a frame whose format is a constant. Returns false if its form has none.
template <class Source, std::size_t Place, class Value>
WIREBOND_INLINE bool read_at(const Frame& frame, Value& value) {
  constexpr Source source{};
  return !every<true, part_counts<Source>.forms>(
      0, source.format().form_count, [&](std::size_t i) WIREBOND_INLINE_LAMBDA {
        const Number number = field_numbers<Source, Place>[i];
        if (!number.present() || frame.form != i) return true;
        value = static_cast<Value>(read_wide(number, frame.bytes, frame.size));
        return false;
      });
}

/// Return how many counters a sender has: one, or one for each message of the protocol.
template <class Source>
constexpr std::size_t sequence_counters() {
  if constexpr (Source{}.format().sequence_per_message) {
    return Source::message_count;
  } else {
    return 1;
  }
}

template <class Source>
constexpr bool has_sequence() {
  if constexpr (folds<Source>(0)) {
    return sequence_mask(Source{}.format()) != 0;
  } else {
    return false;
  }
}

template <std::uint64_t Mask>
using HoldsMask =
    std::conditional_t<(Mask <= 0xFF), std::uint8_t,
                       std::conditional_t<(Mask <= 0xFFFF), std::uint16_t,
                                          std::conditional_t<(Mask <= 0xFFFFFFFF), std::uint32_t, std::uint64_t>>>;

}  // namespace detail

/// Counts frames that one end misses, where the format is a constant. Takes no memory and no instruction if frames have
/// no sequence number.
///
/// Where frames name their sender (`address: sender`) the last `peers` senders are counted apart; if there are more,
/// the one silent longest is forgotten and starts over when it is heard again. Where each message has its own numbers,
/// frames of unknown messages are ignored.
template <class Source, bool = detail::has_sequence<Source>()>
class SequenceWatch {
 public:
  static constexpr SequenceCounts<std::uint32_t> sequence() { return {}; }

 protected:
  static constexpr void note(const Frame&) {}
};

template <class Source>
class SequenceWatch<Source, true> {
 public:
  const SequenceCounts<std::uint32_t>& sequence() const { return counts_; }

 protected:
  WIREBOND_NOINLINE void note(const Frame& frame) {
    constexpr FormatRules format = Source{}.format();
    if (format.sequence_per_message && frame.message < 0) return;
    const std::size_t message = format.sequence_per_message ? static_cast<std::size_t>(frame.message) : 0;
    Value number = 0;
    if (!detail::read_at<Source, format.sequence_place>(frame, number)) return;
    peer_of(frame).tracks[message].take(number, mask, counts_);
  }

 private:
  using Value = detail::HoldsMask<sequence_mask(Source{}.format())>;
  static constexpr auto mask = static_cast<Value>(sequence_mask(Source{}.format()));
  static constexpr bool tells_peers = Source{}.format().peer_place != no_header_field;
  static constexpr std::size_t peers = tells_peers ? 4 : 1;
  static constexpr std::size_t track_count = detail::sequence_counters<Source>();

  struct Peer {
    std::uint64_t address = 0;
    std::array<SequenceTrack<Value>, track_count> tracks{};
  };
  struct OnlyPeer {
    std::array<SequenceTrack<Value>, track_count> tracks{};
  };

  auto& peer_of([[maybe_unused]] const Frame& frame) {
    if constexpr (!tells_peers) {
      return peers_[0];
    } else {
      std::uint64_t address = 0;
      static_cast<void>(detail::read_at<Source, Source{}.format().peer_place>(frame, address));
      std::size_t at = 0;
      while (at + 1 < peers && at < heard_ && peers_[at].address != address) ++at;
      Peer found = peers_[at];
      if (at >= heard_ || found.address != address) found = Peer{address, {}};
      if (at >= heard_) heard_ = static_cast<std::uint8_t>(at + 1);
      for (; at > 0; --at) peers_[at] = peers_[at - 1];  // the one heard last is first
      return peers_[0] = found;
    }
  }

  std::array<std::conditional_t<tells_peers, Peer, OnlyPeer>, peers> peers_{};
  std::uint8_t heard_ = 0;
  SequenceCounts<std::uint32_t> counts_{};
};

}  // namespace wirebond
