// The counts of a decoder and of a link, with their names as programs and pages see them.
#pragma once

#include <cstdint>
#include <vector>

#include "wirebond/engine/batch.hpp"
#include "wirebond/engine/link_core.hpp"
#include "wirebond/engine/node.hpp"
#include "wirebond/engine/sequence_book.hpp"

namespace wirebond::engine {

/// Return bytes, frames, frame_bytes, unknown_frames, fill_bytes, pending_bytes, discarded_bytes and
/// rejected_candidates by cause, messages by name; sequence: none if frames have no number, or their peers cannot be
/// distinguished, otherwise its counts and `peers`, a list of [address, counts]; unlisted: a list of [id, bytes,
/// frames].
Node account_node(const ByteAccount<std::uint64_t>& account, const UnlistedKinds& unlisted, std::uint64_t bytes,
                  std::uint64_t pending, const ProtocolTable& protocol, const std::vector<std::uint64_t>& counts,
                  const FormatTable& format, const SequenceAccount& sequence, const ForeignCounts& foreign = {});

/// Return the same for what a link received, with `send` and the link's own counts.
Node account_node(const LinkAccount& account, const ProtocolTable& protocol, const FormatTable& receive);

}  // namespace wirebond::engine
