// Decodes a file with one protocol's core deframer and prints every frame and where each byte went. For tests that
// compare this with the engine and with the slow decoder; build.py compiles it.
//
//   decode FILE CHUNK [SEED [EXPECTED]]     CHUNK bytes at a time; 0: sizes of 1 to 300 by SEED. EXPECTED: index of the
//                                           reply that a request asked for before
//
// Lines: `frame OFFSET WIRE_HEX ID MESSAGE_INDEX` for each frame, then `NAME VALUE` for the account.
//
// Given by build.py: PROTOCOL_HEADER, PROTOCOL (its namespace), SENDER (FromHost or FromMcu), RUN_TIME (0 or 1).
#include <cstdint>
#include <cstdio>
#include <cstdlib>
#include <random>
#include <vector>

#include PROTOCOL_HEADER

#include "message_rows.hpp"
#include "print.hpp"
#include "wirebond/host/runtime_source.hpp"
#include "wirebond/stream_deframer.hpp"

namespace {

using Sender = PROTOCOL::SENDER;
#if RUN_TIME
using Source = wirebond::RuntimeSource;
#else
using Source = Sender;
#endif

#if RUN_TIME
/// The rows with the rules over payloads that the generated source has, where it has some.
template <class Generated>
auto rows_of() {
  auto rows = message_rows;
  if constexpr (wirebond::detail::HasPayloadRules<Generated>::value) {
    for (auto& row : rows) row.rules = Generated{}.payload_rules(row.shape.index);
  }
  return rows;
}
#endif

Source make_source() {
#if RUN_TIME
  static const wirebond::FrameFormat format =
      wirebond::widened(Sender{}.format());  // the very value that the constant source folds
  static const auto rows = rows_of<Sender>();
  static const wirebond::RuntimeTables tables(format, rows.data(), rows.size(), wirebond::CrcMethod::automatic, matches,
                                              matches_late);
  return Source(tables);
#else
  return {};
#endif
}

struct Printer {
  void operator()(const wirebond::Frame& frame) const { conformance::print_frame(frame); }
};

int decode(std::FILE* file, std::size_t chunk, unsigned seed, std::int16_t expected) {
  const Source source = make_source();
  std::vector<std::uint8_t> workspace(wirebond::workspace_bytes(source));
  wirebond::StreamDeframer<Source, std::uint64_t> deframer(source, workspace.data(), Sender::idle_us);
  deframer.expect(expected);
  std::mt19937 random(seed);
  Printer printer;
  while (true) {
    std::vector<std::uint8_t> bytes(chunk != 0 ? chunk : 1 + random() % 300);  // of its own, so that overruns are seen
    const std::size_t size = std::fread(bytes.data(), 1, bytes.size(), file);
    if (size == 0) break;
    bytes.resize(size);
    deframer.feed(bytes.data(), bytes.size(), 0, printer);
    if (!conformance::account_closes(deframer)) return 1;
  }
  if (std::ferror(file) != 0) {
    std::perror("cannot read on");
    return 1;
  }
  deframer.give_up(printer);
  conformance::print_account(deframer);
  return 0;
}

}  // namespace

int main(int count, char** arguments) {
  if (count < 3 || count > 5) {
    std::fprintf(stderr, "usage: %s FILE CHUNK [SEED [EXPECTED]]\n", arguments[0]);
    return 2;
  }
  std::FILE* const file = std::fopen(arguments[1], "rb");
  if (file == nullptr) {
    std::perror(arguments[1]);
    return 2;
  }
  const std::size_t chunk = std::strtoul(arguments[2], nullptr, 10);
  const unsigned seed = count >= 4 ? static_cast<unsigned>(std::strtoul(arguments[3], nullptr, 10)) : 1;
  const auto expected = static_cast<std::int16_t>(count == 5 ? std::strtol(arguments[4], nullptr, 10) : -1);
  const int result = decode(file, chunk, seed, expected);
  std::fclose(file);
  return result;
}
