// Received frames as they were, until a language asks for their values.
#pragma once

#include <cstddef>
#include <cstdint>
#include <memory>
#include <vector>

#include "wirebond/engine/protocol.hpp"
#include "wirebond/examine.hpp"
#include "wirebond/stream_deframer.hpp"
#include "wirebond/unlisted.hpp"

namespace wirebond::engine {

/// The bytes of all messages of one call; messages that point into it keep it alive.
struct Batch {
  std::shared_ptr<const ProtocolTable> protocol;
  std::shared_ptr<const FormatTable> format;
  std::vector<std::uint8_t> bytes;
  std::vector<std::uint64_t> headers;  ///< bits of a frame's header fields, if the format has some
};

/// One frame that passed. Places are indexes in Batch::bytes.
struct Event {
  std::uint32_t wire_at = 0;
  std::uint32_t wire_size = 0;
  std::uint32_t payload_at = 0;
  std::uint32_t payload_size = 0;
  std::uint32_t id = 0;
  std::int16_t message = -1;
  std::uint8_t form = 0;
  std::uint32_t header_at = 0;
  std::uint64_t offset = 0;
  double time = 0;
};

/// Messages that came together.
struct Arrivals {
  std::shared_ptr<Batch> batch;
  std::vector<Event> events;
};

/// Append the frame's bytes to the batch and describe it.
Event record(const Frame& frame, double time, Batch& batch);

/// Frames for another address: counted, and not delivered.
struct ForeignCounts {
  std::uint64_t frames = 0;
  std::uint64_t bytes = 0;

  void add(const Frame& frame) {
    frames += 1;
    bytes += frame.wire_size;
  }
};

using HostDeframer = StreamDeframer<RuntimeSource, std::uint64_t, HostAccount>;

}  // namespace wirebond::engine
