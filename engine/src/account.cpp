// The counts of a decoder and of a link, with their names as programs and pages see them.
#include "wirebond/engine/account.hpp"

#include <utility>

#include "wirebond/engine/fields.hpp"
#include "wirebond/engine/node_values.hpp"

namespace wirebond::engine {

namespace {

// One row per Cause, in its order; the manual has the same names.
constexpr const char* cause_names[cause_count] = {
    "no_start",       "constant_mismatch", "length_out_of_range", "unknown_message", "header_check_mismatch",
    "check_mismatch", "bad_stuffing",      "incomplete",
};

Node::Map counts_map(const SequenceCounts<std::uint64_t>& counts) {
  return {
      {"numbered", counts.numbered}, {"gaps", counts.gaps}, {"repeats", counts.repeats}, {"restarts", counts.restarts}};
}

Node sequence_node(const FormatTable& format, const SequenceAccount& account) {
  if (!account.has_numbers) return {};
  SequenceCounts<std::uint64_t> sum;
  Node::List peers;
  for (const auto& [address, counts] : account.peers) {
    sum.add(counts);
    const std::size_t place = format.format().peer_place;
    if (place == no_header_field) continue;
    peers.push_back(Node::List{decode_element<NodeValues>(format.header()[place], address), Node(counts_map(counts))});
  }
  Node::Map out = counts_map(sum);
  out.emplace_back("peers", std::move(peers));
  return Node(std::move(out));
}

Node by_message(const ProtocolTable& protocol, const std::vector<std::uint64_t>& counts) {
  Node::Map out;
  for (std::size_t i = 0; i < counts.size(); ++i) {
    if (counts[i] != 0) out.emplace_back(protocol.messages()[i].name, counts[i]);
  }
  return Node(std::move(out));
}

}  // namespace

Node account_node(const ByteAccount<std::uint64_t>& account, const UnlistedKinds& unlisted, std::uint64_t bytes,
                  std::uint64_t pending, const ProtocolTable& protocol, const std::vector<std::uint64_t>& counts,
                  const FormatTable& format, const SequenceAccount& sequence, const ForeignCounts& foreign) {
  Node::Map discarded;
  Node::Map rejected;
  for (std::size_t i = 0; i < cause_count; ++i) {
    discarded.emplace_back(cause_names[i], account.discarded_bytes[i]);
    rejected.emplace_back(cause_names[i], account.rejected_candidates[i]);
  }
  Node::List kinds;
  for (std::size_t i = 0; i < unlisted.kind_count(); ++i) {
    const UnlistedKinds::Kind& kind = unlisted.kind(i);
    kinds.push_back(Node::List{kind.id, kind.bytes, kind.frames});
  }
  return Node::Map{{"bytes", bytes},
                   {"frames", account.frames},
                   {"unknown_frames", account.unknown_frames},
                   {"foreign_frames", foreign.frames},
                   {"foreign_bytes", foreign.bytes},
                   {"frame_bytes", account.frame_bytes},
                   {"fill_bytes", account.fill_bytes},
                   {"pending_bytes", pending},
                   {"discarded_bytes", std::move(discarded)},
                   {"rejected_candidates", std::move(rejected)},
                   {"messages", by_message(protocol, counts)},
                   {"sequence", sequence_node(format, sequence)},
                   {"unlisted", std::move(kinds)},
                   {"unlisted_frames", unlisted.frames()}};
}

Node account_node(const LinkAccount& account, const ProtocolTable& protocol, const FormatTable& receive) {
  Node out = account_node(account.receive, account.receive.unlisted.found(), account.bytes, account.pending, protocol,
                          account.counts, receive, account.sequence, account.foreign);
  const HostSendAccount& send = account.send;
  out.add("send", Node::Map{{"offered", send.offered},
                            {"accepted", send.accepted},
                            {"refused_down", send.refused_down},
                            {"refused_full", send.refused_full},
                            {"refused_stopped", send.refused_stopped},
                            {"sent", send.sent},
                            {"sent_bytes", send.sent_bytes},
                            {"queued", send.queued},
                            {"replaced", send.replaced},
                            {"expired", send.expired},
                            {"overruled", send.overruled},
                            {"aborted", send.aborted},
                            {"messages", by_message(protocol, account.sent)}});
  out.add("dropped_messages", account.dropped_messages);
  out.add("late", account.not_acted.late);
  out.add("held_back", account.not_acted.held_back);
  out.add("reconnects", account.reconnects);
  out.add("echoed_bytes", account.echoed);
  out.add("collisions", account.collisions);
  return out;
}

}  // namespace wirebond::engine
