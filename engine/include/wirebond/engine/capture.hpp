// Decodes a whole capture to rows of payloads, on several cores. No Python here.
#pragma once

#include <atomic>
#include <cstddef>
#include <cstdint>
#include <utility>
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

/// Append the frame to its rows. `offset`: of its first byte in the capture; `time`: null if there are no times.
void take_row(const ProtocolTable& protocol, const FormatTable& format, const Frame& frame, std::uint64_t offset,
              const double* time, Capture& to);

/// Decode `size` bytes. The result is the same for any number of threads: each decodes a part, and continues into the
/// next one until both have ended the same frame, after which they cannot differ. `done` counts the processed bytes,
/// for a progress display; any thread may read it, and may set `cancelled` to end early.
Capture decode_capture(const ProtocolTable& protocol, const FormatTable& format, const std::uint8_t* bytes,
                       std::size_t size, unsigned threads, std::atomic<std::uint64_t>& done,
                       const std::atomic<bool>& cancelled);

/// The reads in which the bytes of a capture came. Everything that it points to must outlive the decoding.
struct Timing {
  const std::uint64_t* ends = nullptr;  ///< end of each read in the capture; they rise
  const double* times = nullptr;        ///< start of each read, in seconds; they do not fall
  std::size_t count = 0;
  std::uint64_t idle_us = 0;                                     ///< silence that ends an incomplete frame
  std::vector<std::size_t> breaks;                               ///< the port was closed before the read of this index
  std::vector<std::pair<std::size_t, std::int16_t>> expected{};  ///< before this read, this message was requested
};

/// Decode a capture with times, like a decoder that is fed read by read. One thread.
Capture decode_timed(const ProtocolTable& protocol, const FormatTable& format, const std::uint8_t* bytes,
                     const Timing& timing, std::atomic<std::uint64_t>& done, const std::atomic<bool>& cancelled);

}  // namespace wirebond::engine
