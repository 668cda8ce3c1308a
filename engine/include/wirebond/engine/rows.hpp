// Received payloads by message, one after the other: the source of columns.
#pragma once

#include <cstddef>
#include <cstdint>
#include <vector>

#include "wirebond/engine/protocol.hpp"
#include "wirebond/engine/sequence_book.hpp"
#include "wirebond/stream_deframer.hpp"
#include "wirebond/unlisted.hpp"

namespace wirebond::engine {

/// Payloads of one message, packed one after the other.
struct Rows {
  std::vector<std::uint64_t> offsets;
  std::vector<std::uint32_t> ids;      ///< unknown frames only
  std::vector<std::uint8_t> payloads;  ///< min_payload bytes per row; whole payloads if their size varies
  std::vector<std::size_t> ends;       ///< ends of the payloads, if their size varies
  std::vector<double> times;           ///< in a capture with times: start of the read that completed the frame
  std::vector<std::uint64_t> header;   ///< bits of each header field, one after the other; 0: the frame lacks it
  std::vector<std::uint32_t> sizes;    ///< of the frames on the wire; only if requested

  std::size_t begin_of(std::size_t row) const { return row == 0 ? 0 : ends[row - 1]; }
  /// Append the other's rows from `first` on. `row_bytes`: size of a payload; 0 if it varies. `header_fields`: how many
  /// the format has.
  void append(Rows&& other, std::size_t first, std::size_t row_bytes, std::size_t header_fields);
};

struct Capture {
  std::vector<Rows> messages;  ///< by index of the message in the protocol
  Rows unknown;
  std::vector<SeenNumber> numbers;  ///< of all frames that have one, in their order
  ByteAccount<std::uint64_t> account;
  UnlistedKinds unlisted;
};

/// Return the rows that this frame belongs to.
Rows& rows_for(Capture& capture, const Frame& frame);

/// Return how many bytes each row of the message has; 0: its size varies.
std::size_t row_bytes(const MessageTable& message);

/// Append the frame to its rows. `offset`: of its first byte in the capture; `time`: null if there are no times.
void take_row(const ProtocolTable& protocol, const FormatTable& format, const Frame& frame, std::uint64_t offset,
              const double* time, Capture& to);

}  // namespace wirebond::engine
