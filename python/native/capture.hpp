// A whole capture to rows of payloads, over several cores. No Python here.
#pragma once

#include <atomic>
#include <cstddef>
#include <cstdint>
#include <utility>
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
  std::vector<double> times;           ///< of a capture with times: when the read began that completed the frame
  std::vector<std::uint64_t> header;   ///< bits of each header field of the format, one behind the other; 0: not there
  std::vector<std::uint32_t> sizes;    ///< of the frames on the wire; only where somebody asks for them

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

/// The rows that this frame belongs to.
Rows& rows_for(Capture& capture, const Frame& frame);

/// Append the frame to its rows. `offset`: of its first byte in the capture; `time`: null where there are no times.
void take_row(const ProtocolTable& protocol, const FormatTable& format, const Frame& frame, std::uint64_t offset,
              const double* time, Capture& to);

/// Decode `size` bytes. The result is the same whatever the number of threads: each decodes a part, and goes on into
/// the next one until both have ended the same frame, from where on they cannot differ. `done` counts the bytes that
/// were looked at, for whoever shows progress; any thread may read it, and may set `cancelled` to end early.
Capture decode_capture(const ProtocolTable& protocol, const FormatTable& format, const std::uint8_t* bytes,
                       std::size_t size, unsigned threads, std::atomic<std::uint64_t>& done,
                       const std::atomic<bool>& cancelled);

/// How the bytes of a capture came: read by read. What it points to outlives the decoding.
struct Timing {
  const std::uint64_t* ends = nullptr;  ///< of each read, in the capture; they rise
  const double* times = nullptr;        ///< when it began, in seconds; they do not fall
  std::size_t count = 0;
  std::uint64_t idle_us = 0;                                     ///< silence that ends an incomplete frame
  std::vector<std::size_t> breaks;                               ///< the port was away before the read of this index
  std::vector<std::pair<std::size_t, std::int16_t>> expected{};  ///< before this read, this message was asked for
};

/// The same for a capture with times, as a decoder that is fed read by read sees it. One thread.
Capture decode_timed(const ProtocolTable& protocol, const FormatTable& format, const std::uint8_t* bytes,
                     const Timing& timing, std::atomic<std::uint64_t>& done, const std::atomic<bool>& cancelled);

}  // namespace wirebond::engine
