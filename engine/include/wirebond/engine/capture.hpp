// Decodes a whole capture to rows of payloads, on several cores.
#pragma once

#include <atomic>
#include <cstddef>
#include <cstdint>
#include <utility>
#include <vector>

#include "wirebond/engine/rows.hpp"

namespace wirebond::engine {

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
