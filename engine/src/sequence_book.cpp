// Counts from the sequence numbers of received frames, for each peer.
#include "wirebond/engine/sequence_book.hpp"

namespace wirebond::engine {

bool see_number(const FrameFormat& format, const Frame& frame, SeenNumber& seen) {
  if (format.sequence_place == no_header_field || (format.sequence_per_message && frame.message < 0)) return false;
  const Form& form = format.forms[frame.form];
  const Number number = number_at(form, format.sequence_place);
  if (!number.present()) return false;
  const Number peer = number_at(form, format.peer_place);
  seen.peer = peer.present() ? detail::read_wide(peer, frame.bytes, frame.size) : 0;
  seen.number = detail::read_wide(number, frame.bytes, frame.size);
  seen.message = frame.message;
  return true;
}

void SequenceBook::take(const SeenNumber& seen) {
  const auto [found, is_new] = places_.try_emplace(seen.peer, peers_.size());
  if (is_new) {
    if (peers_.size() == max_peers) {
      places_.erase(found);
      return;
    }
    peers_.emplace_back(seen.peer, Peer{});
  }
  Peer& peer = peers_[found->second].second;
  const std::size_t track = format_->format().sequence_per_message ? static_cast<std::size_t>(seen.message) : 0;
  if (peer.tracks.size() <= track) peer.tracks.resize(track + 1);
  peer.tracks[track].take(seen.number, mask_, peer.counts);
}

SequenceAccount SequenceBook::account() const {
  SequenceAccount out;
  out.has_numbers = mask_ != 0;
  for (const auto& [address, peer] : peers_) out.peers.emplace_back(address, peer.counts);
  return out;
}

}  // namespace wirebond::engine
