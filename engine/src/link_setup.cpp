// Reads a link's settings from a table into a LinkSetup.
#include "wirebond/engine/link_setup.hpp"

#include <algorithm>
#include <utility>

namespace wirebond::engine {

StopFrame stop_frame(const Node& safe) {
  return {safe[0].as<std::int16_t>(),  safe[1].bytes(),
          safe[2].as<std::int16_t>(),  std::max<std::uint64_t>(to_us(safe[3].as<double>()), 1),
          safe[4].as<std::uint64_t>(), safe[5].as<bool>()};
}

LinkSetup link_setup(std::shared_ptr<const ProtocolTable> protocol, std::shared_ptr<const FormatTable> receive,
                     std::shared_ptr<const FormatTable> send, const Node& settings) {
  LinkSetup setup;
  setup.protocol = std::move(protocol);
  setup.receive = std::move(receive);
  setup.send = std::move(send);
  const std::uint32_t baud = settings["paced"].as<bool>() ? settings["baud"].as<std::uint32_t>() : 0;
  setup.pacing = Pacing(baud, settings["bits_per_byte"].as<unsigned>(),
                        static_cast<std::uint32_t>(to_us(settings["send_pause_seconds"].as<double>())));
  setup.idle_us = to_us(settings["idle_seconds"].as<double>());
  setup.pause_us = to_us(settings["pause_seconds"].as<double>());
  setup.max_age_us = to_us(settings["max_age_seconds"].as<double>());
  setup.echoes = settings["echo"].as<bool>();
  setup.largest_frame = settings["largest_frame"].as<std::size_t>();
  for (const Node& seconds : settings["every"].list()) setup.every_us.push_back(to_us(seconds.as<double>()));
  for (const Node& latest : settings["latest"].list()) setup.keeps_latest.push_back(latest.as<bool>());
  for (const Node& stop : settings["stop"].list()) setup.stop.push_back(stop_frame(stop));
  HostAddressing::Rules& rules = setup.addressing;
  const Node& addressing = settings["addressing"];
  rules.receiver_place = addressing["receiver_place"].as<int>();
  rules.sender_place = addressing["sender_place"].as<int>();
  rules.own = addressing["own"].as<std::uint64_t>();
  rules.only_last_asked = addressing["only_last_asked"].as<bool>();
  for (const Node& value : addressing["broadcast"].list()) {
    rules.broadcast.at(rules.broadcasts++) = value.as<std::uint64_t>();
  }
  setup.more_addresses = addressing["more_addresses"].as<std::size_t>();
  for (const Node& rule : settings["deadlines"].list()) {
    setup.deadlines.push_back({rule[0].as<std::int16_t>(), rule[1].as<std::uint32_t>(), rule[2].as<std::uint8_t>(),
                               !rule[3].as<bool>()  ? Recover::next_message
                               : rule[4].as<bool>() ? Recover::held_at_start
                                                    : Recover::explicit_call});
  }
  for (const Node& stop : settings["peer_stops"].list()) {
    setup.peer_stops.push_back({stop[0].as<std::int16_t>(), stop[1].bytes(), stop[2].bytes(), stop[3].as<bool>()});
  }
  setup.holds_back = settings["hold_back"].as<bool>();
  setup.recent_bytes = settings["recent_bytes"].as<std::size_t>();
  return setup;
}

}  // namespace wirebond::engine
