// A link's settings from the protocol file and the port: values only.
#pragma once

#include <cmath>
#include <cstddef>
#include <cstdint>
#include <memory>
#include <vector>

#include "wirebond/engine/node.hpp"
#include "wirebond/engine/protocol.hpp"
#include "wirebond/host/link.hpp"

namespace wirebond::engine {

/// One message of the file's emergency stop, in its order.
struct StopFrame {
  std::int16_t message = -1;
  std::vector<std::uint8_t> frame;
  std::int16_t reply = -1;
  std::uint64_t every_us = 0;  ///< how often a stop repeats it
  std::uint64_t address = 0;   ///< of its receiver, if frames have one
  bool is_in_stop = true;      ///< see SafeValue
};

/// A message of the emergency stop that the peer sends.
struct StopPayload {
  std::int16_t message;
  std::vector<std::uint8_t> payload;
  std::vector<std::uint8_t> mask;  ///< of its bits that count
  bool is_whole;                   ///< a payload of another size is not it
};

/// What a link takes from the protocol file and the port.
struct LinkSetup {
  std::shared_ptr<const ProtocolTable> protocol;
  std::shared_ptr<const FormatTable> receive;  ///< format of the MCU's frames
  std::shared_ptr<const FormatTable> send;     ///< format of the host's frames
  Pacing pacing;
  std::uint64_t idle_us = 20'000;
  std::uint64_t pause_us = 0;  ///< where silence ends a frame
  std::uint64_t max_age_us = 0;
  bool echoes = false;                  ///< the line returns sent bytes
  std::size_t largest_frame = 0;        ///< bytes of the largest frame that the host sends
  std::vector<std::uint64_t> every_us;  ///< by message; 0: it has no rhythm
  std::vector<bool> keeps_latest;       ///< by message: only the newest frame waits
  std::vector<StopFrame> stop;          ///< empty: the file has none
  HostAddressing::Rules addressing;
  std::size_t more_addresses = 0;       ///< leases, and safe values, for addresses besides the first of each message
  std::vector<DeadlineRule> deadlines;  ///< of the host
  std::vector<StopPayload> peer_stops;  ///< at an MCU
  bool holds_back = true;               ///< a message that may not act is not given to the program either
  std::size_t recent_bytes = 65536;     ///< maximum kept for `recent`, of both directions
};

/// `settings`: the fields of `EngineSettings` in wirebond.link.engine_settings, by name.
LinkSetup link_setup(std::shared_ptr<const ProtocolTable> protocol, std::shared_ptr<const FormatTable> receive,
                     std::shared_ptr<const FormatTable> send, const Node& settings);

/// `safe`: the values of `SafeValue` in wirebond.link.engine_settings, in their order.
StopFrame stop_frame(const Node& safe);

inline std::uint64_t to_us(double seconds) { return static_cast<std::uint64_t>(std::llround(seconds * 1e6)); }

}  // namespace wirebond::engine
