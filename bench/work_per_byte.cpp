// Feeds a file to the run-time engine in 64-byte chunks, for callgrind to count.
#include <cstdio>
#include <fstream>
#include <iterator>
#include <vector>

#include "run_time_enterprize.hpp"
#include "wirebond/stream_deframer.hpp"

int main(int argument_count, char** arguments) {
  if (argument_count != 2) {
    std::fprintf(stderr, "usage: %s FILE\n", arguments[0]);
    return 2;
  }
  std::ifstream file(arguments[1], std::ios::binary);
  const std::vector<char> bytes{std::istreambuf_iterator<char>(file), std::istreambuf_iterator<char>()};
  const bench::RunTimeEnterprize format;
  std::vector<std::uint8_t> workspace(wirebond::workspace_bytes(format.source()));
  wirebond::StreamDeframer<wirebond::RuntimeSource, std::uint64_t> deframer(format.source(), workspace.data(), 20000);
  std::uint64_t frames = 0;
  for (std::size_t at = 0; at < bytes.size(); at += 64) {
    const std::size_t size = bytes.size() - at < 64 ? bytes.size() - at : 64;
    deframer.feed(reinterpret_cast<const std::uint8_t*>(bytes.data()) + at, size, 0,
                  [&](const wirebond::Frame&) { ++frames; });
  }
  std::printf("%llu frames\n", static_cast<unsigned long long>(frames));
  return 0;
}
