// A whole capture to rows of payloads, over several cores. No Python here.
#pragma once

#include <atomic>
#include <cstddef>
#include <cstdint>
#include <vector>

#include "protocol.hpp"
#include "sequence_book.hpp"
#include "wirebond/stream_deframer.hpp"
#include "wirebond/unlisted.hpp"

namespace wirebond::engine {

/// Payloads of one message, packed one behind the other.
struct Rows {
  std::vector<std::uint64_t> offsets;
  std::vector<std::uint32_t> ids;      ///< unknown frames only
  std::vector<std::uint8_t> payloads;  ///< min_payload bytes a row; whole payloads where their size varies
  std::vector<std::size_t> ends;       ///< of the payloads, where their size varies
  std::vector<std::uint64_t> header;   ///< bits of each header field of the format, one behind the other; 0: not there

  std::size_t begin_of(std::size_t row) const { return row == 0 ? 0 : ends[row - 1]; }
  /// Take the other's rows from `first` on behind one's own. `row_bytes`: of a payload; 0 where their size varies.
  /// `header_fields`: how many the format has.
  void append(Rows&& other, std::size_t first, std::size_t row_bytes, std::size_t header_fields);
};

struct Capture {
  std::vector<Rows> messages;  ///< by the message's place in the protocol
  Rows unknown;
  std::vector<SeenNumber> numbers;  ///< of all frames that have one, in their order
  ByteAccount<std::uint64_t> account;
  UnlistedKinds unlisted;
};

/// Decode `size` bytes. The result is the same whatever the number of threads: each decodes a part, and goes on into
/// the next one until both have ended the same frame, from where on they cannot differ. `done` counts the bytes that
/// were looked at, for whoever shows progress; any thread may read it, and may set `cancelled` to end early.
Capture decode_capture(const ProtocolTable& protocol, const FormatTable& format, const std::uint8_t* bytes,
                       std::size_t size, unsigned threads, std::atomic<std::uint64_t>& done,
                       const std::atomic<bool>& cancelled);

}  // namespace wirebond::engine
