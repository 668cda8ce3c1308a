// What a frame costs the run-time engine: a loop for callgrind to count, and interleaved timings against the limit.
// Work of a decoded frame: found in 64-byte chunks, all checks, statistics, one event record; no field is extracted.
#include <algorithm>
#include <chrono>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <deque>
#include <fstream>
#include <string>
#include <vector>

#include "run_time_enterprize.hpp"
#include "wirebond/encoder.hpp"
#include "wirebond/stream_deframer.hpp"

namespace {

using Bytes = std::vector<std::uint8_t>;
using wirebond::CrcMethod;

constexpr std::size_t chunk = 64;
constexpr std::size_t prefix = 5;  // AA, length, id, header check
constexpr int pairs = 9;

struct Event {
  std::uint64_t offset;
  double time;
  std::uint32_t length;
  std::uint32_t id;
};

struct Recorder {
  Event* next;
  double time;

  void operator()(const wirebond::Frame& frame) {
    *next++ = {frame.offset, time, static_cast<std::uint32_t>(frame.wire_size), frame.id};
  }
};

Bytes read(const char* path) {
  std::ifstream file(path, std::ios::binary | std::ios::ate);
  Bytes bytes(static_cast<std::size_t>(file.tellg()));
  file.seekg(0);
  file.read(reinterpret_cast<char*>(bytes.data()), static_cast<std::streamsize>(bytes.size()));
  return bytes;
}

class Decode {
 public:
  explicit Decode(CrcMethod method)
      : format_(method),
        workspace_(wirebond::workspace_bytes(format_.source())),
        deframer_(format_.source(), workspace_.data(), 20000) {}

  /// Frames found. The stream may be fed again and again: it holds whole frames.
  std::size_t run(const Bytes& stream, std::vector<Event>& events, double time) {
    Recorder record{events.data(), time};
    for (std::size_t at = 0; at < stream.size(); at += chunk) {
      deframer_.feed(stream.data() + at, std::min(chunk, stream.size() - at), 0, record);
    }
    return static_cast<std::size_t>(record.next - events.data());
  }

 private:
  bench::RunTimeEnterprize format_;
  Bytes workspace_;
  wirebond::StreamDeframer<wirebond::RuntimeSource, std::uint64_t> deframer_;
};

/// The least that a decoder of this format must do: both checks of each frame, and one copy of its bytes.
class Limit {
 public:
  explicit Limit(CrcMethod method) : format_(method) {}

  std::size_t run(const Bytes& stream, std::size_t frame_size, Bytes& copy) const {
    const wirebond::RuntimeSource source = format_.source();
    std::size_t good = 0;
    for (std::size_t at = 0; at < stream.size(); at += frame_size) {
      const std::uint8_t* const frame = stream.data() + at;
      std::uint64_t reg = source.check_update(0, source.check_begin_of(0), frame, prefix - 2);
      const bool header_holds = source.check_end_of(0, reg) == wirebond::load<std::uint16_t>(frame + prefix - 2);
      reg = source.check_update(0, reg, frame + prefix - 2, frame_size - prefix);
      good += header_holds && source.check_end_of(0, reg) == wirebond::load<std::uint16_t>(frame + frame_size - 2);
      std::memcpy(copy.data() + at, frame, frame_size);
    }
    return good;
  }

 private:
  bench::RunTimeEnterprize format_;
};

double seconds_since(std::chrono::steady_clock::time_point start) {
  return std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count();
}

/// Median over interleaved pairs of decode time over limit time, and the method that made the limit.
int time_over_limit(const Bytes& stream, std::size_t frame_size, int rounds) {
  const std::size_t frames = stream.size() / frame_size;
  std::vector<Event> events(frames);
  Bytes copy(stream.size());
  Decode decode(CrcMethod::automatic);
  const std::pair<const char*, CrcMethod> methods[] = {
      {"byte table", CrcMethod::byte_table}, {"slicing-16", CrcMethod::slicing}, {"carry-less", CrcMethod::carry_less}};
  std::deque<Limit> limits;
  for (const auto& [name, method] : methods) limits.emplace_back(method);
  std::vector<double> ratios;
  std::size_t wrong = 0;
  for (int pair = 0; pair < pairs + 1; ++pair) {  // the first warms up
    auto start = std::chrono::steady_clock::now();
    for (int i = 0; i < rounds; ++i) wrong += decode.run(stream, events, i) != frames;
    const double decoding = seconds_since(start);
    double fastest = 1e9;
    std::size_t winner = 0;
    for (std::size_t m = 0; m < limits.size(); ++m) {
      start = std::chrono::steady_clock::now();
      for (int i = 0; i < rounds; ++i) wrong += limits[m].run(stream, frame_size, copy) != frames;
      const double limit = seconds_since(start);
      if (limit < fastest) {
        fastest = limit;
        winner = m;
      }
    }
    const double per_frame = 1e9 / (static_cast<double>(frames) * rounds);
    std::printf("pair %d: decode %.1f ns, limit %.1f ns (%s)\n", pair, decoding * per_frame, fastest * per_frame,
                methods[winner].first);
    if (pair > 0) ratios.push_back(decoding / fastest);
  }
  std::sort(ratios.begin(), ratios.end());
  std::printf("ratio %.4f\n", ratios[ratios.size() / 2]);
  return wrong == 0 ? 0 : 1;
}

/// Seal payloads that lie in place, as a sender's queue holds them.
int encode(const Bytes& stream, std::size_t frame_size, int rounds) {
  const bench::RunTimeEnterprize format;
  const wirebond::RuntimeSource source = format.source();
  Bytes frame(stream.begin(), stream.begin() + static_cast<std::ptrdiff_t>(frame_size));
  const std::uint32_t id = frame[2];
  std::size_t wrong = 0;
  for (int i = 0; i < rounds; ++i) {
    frame[prefix] = static_cast<std::uint8_t>(i);
    wrong += wirebond::seal(source, frame.data(), frame.size(), id, frame_size - prefix - 2) != frame_size;
  }
  return wrong == 0 ? 0 : 1;
}

}  // namespace

int main(int argument_count, char** arguments) {
  if (argument_count != 5) {
    std::fprintf(stderr, "usage: %s decode|decode_table|encode|over_limit FILE FRAME_BYTES ROUNDS\n", arguments[0]);
    return 2;
  }
  const std::string work = arguments[1];
  const Bytes stream = read(arguments[2]);
  const std::size_t frame_size = std::strtoul(arguments[3], nullptr, 10);
  const int rounds = std::atoi(arguments[4]);
  if (work == "over_limit") return time_over_limit(stream, frame_size, rounds);
  if (work == "encode") return encode(stream, frame_size, rounds);
  Decode decode(work == "decode" ? CrcMethod::automatic : CrcMethod::slicing);
  std::vector<Event> events(stream.size() / frame_size);
  std::size_t wrong = 0;
  for (int i = 0; i < rounds; ++i) wrong += decode.run(stream, events, i) != events.size();
  return wrong == 0 ? 0 : 1;
}
