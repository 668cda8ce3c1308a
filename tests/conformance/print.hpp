// What the conformance programs print, a line each; tests/conformance/build.py reads it. Nothing is decoded here.
#pragma once

#include <cinttypes>
#include <cstddef>
#include <cstdint>
#include <cstdio>

#include "wirebond/examine.hpp"

namespace conformance {

constexpr const char* cause_names[wirebond::cause_count] = {
    "no_start",       "constant_mismatch", "length_out_of_range", "unknown_message", "header_check_mismatch",
    "check_mismatch", "bad_stuffing",      "incomplete",
};

inline void print_hex(const std::uint8_t* bytes, std::size_t size) {
  for (std::size_t i = 0; i < size; ++i) std::printf("%02x", bytes[i]);
}

/// `frame OFFSET WIRE_HEX ID MESSAGE_INDEX`
inline void print_frame(const wirebond::Frame& frame) {
  std::printf("frame %" PRIu64 " ", frame.offset);
  print_hex(frame.wire, frame.wire_size);
  std::printf(" %" PRIu32 " %d\n", frame.id, frame.message);
}

/// False, and a sentence on stderr, where a stream deframer does not know where each byte went.
template <class StreamDeframer>
bool account_closes(const StreamDeframer& deframer) {
  if (deframer.bytes() == deframer.account().settled() + deframer.pending()) return true;
  std::fprintf(stderr, "the account does not close after %" PRIu64 " bytes\n", deframer.bytes());
  return false;
}

/// `NAME VALUE` for each sum.
template <class StreamDeframer>
void print_account(const StreamDeframer& deframer) {
  const auto& account = deframer.account();
  std::printf("bytes %" PRIu64 "\n", deframer.bytes());
  std::printf("frames %" PRIu64 "\n", account.frames);
  std::printf("unknown_frames %" PRIu64 "\n", account.unknown_frames);
  std::printf("frame_bytes %" PRIu64 "\n", account.frame_bytes);
  std::printf("fill_bytes %" PRIu64 "\n", account.fill_bytes);
  std::printf("pending_bytes %zu\n", deframer.pending());
  for (std::size_t i = 0; i < wirebond::cause_count; ++i) {
    std::printf("discarded.%s %" PRIu64 "\n", cause_names[i], account.discarded_bytes[i]);
    std::printf("rejected.%s %" PRIu64 "\n", cause_names[i], account.rejected_candidates[i]);
  }
}

}  // namespace conformance
