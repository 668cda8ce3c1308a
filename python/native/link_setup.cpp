// Reads a link's settings from Python into a LinkSetup.
#include "link_setup.hpp"

#include <nanobind/stl/shared_ptr.h>
#include <nanobind/stl/string.h>

#include <algorithm>
#include <utility>

namespace wirebond::engine {

namespace {

std::vector<std::uint8_t> bytes_of(const nb::bytes& bytes) {
  const auto* const data = static_cast<const std::uint8_t*>(bytes.data());
  return {data, data + bytes.size()};
}

template <class Value>
Value setting(nb::handle settings, const char* name) {
  return nb::cast<Value>(settings.attr(name));
}

}  // namespace

StopFrame stop_frame(nb::handle safe) {
  return {nb::cast<std::int16_t>(safe[0]),  bytes_of(nb::cast<nb::bytes>(safe[1])),
          nb::cast<std::int16_t>(safe[2]),  std::max<std::uint64_t>(to_us(nb::cast<double>(safe[3])), 1),
          nb::cast<std::uint64_t>(safe[4]), nb::cast<bool>(safe[5])};
}

LinkSetup link_setup(std::shared_ptr<const ProtocolTable> protocol, std::shared_ptr<const FormatTable> receive,
                     nb::handle settings) {
  LinkSetup setup;
  setup.protocol = std::move(protocol);
  setup.receive = std::move(receive);
  setup.send = setting<std::shared_ptr<const FormatTable>>(settings, "send");
  const std::uint32_t baud = setting<bool>(settings, "paced") ? setting<std::uint32_t>(settings, "baud") : 0;
  setup.pacing = Pacing(baud, setting<unsigned>(settings, "bits_per_byte"),
                        static_cast<std::uint32_t>(to_us(setting<double>(settings, "send_pause_seconds"))));
  setup.idle_us = to_us(setting<double>(settings, "idle_seconds"));
  setup.pause_us = to_us(setting<double>(settings, "pause_seconds"));
  setup.max_age_us = to_us(setting<double>(settings, "max_age_seconds"));
  setup.echoes = setting<bool>(settings, "echo");
  setup.largest_frame = setting<std::size_t>(settings, "largest_frame");
  for (nb::handle seconds : nb::tuple(settings.attr("every")))
    setup.every_us.push_back(to_us(nb::cast<double>(seconds)));
  for (nb::handle latest : nb::tuple(settings.attr("latest"))) setup.keeps_latest.push_back(nb::cast<bool>(latest));
  for (nb::handle stop : nb::tuple(settings.attr("stop"))) {
    setup.stop.push_back(stop_frame(stop));
  }
  HostAddressing::Rules& rules = setup.addressing;
  const nb::object addressing = settings.attr("addressing");
  rules.receiver_place = setting<int>(addressing, "receiver_place");
  rules.sender_place = setting<int>(addressing, "sender_place");
  rules.own = setting<std::uint64_t>(addressing, "own");
  rules.only_last_asked = setting<bool>(addressing, "only_last_asked");
  for (nb::handle value : nb::tuple(addressing.attr("broadcast"))) {
    rules.broadcast.at(rules.broadcasts++) = nb::cast<std::uint64_t>(value);
  }
  setup.more_addresses = setting<std::size_t>(addressing, "more_addresses");
  for (nb::handle rule : nb::tuple(settings.attr("deadlines"))) {
    setup.deadlines.push_back({nb::cast<std::int16_t>(rule[0]), nb::cast<std::uint32_t>(rule[1]),
                               nb::cast<std::uint8_t>(rule[2]),
                               !nb::cast<bool>(rule[3])  ? Recover::next_message
                               : nb::cast<bool>(rule[4]) ? Recover::held_at_start
                                                         : Recover::explicit_call});
  }
  for (nb::handle stop : nb::tuple(settings.attr("peer_stops"))) {
    const auto bytes_of = [](nb::handle value) {
      const nb::bytes held = nb::cast<nb::bytes>(value);
      const auto* const bytes = reinterpret_cast<const std::uint8_t*>(held.data());
      return std::vector<std::uint8_t>(bytes, bytes + held.size());
    };
    setup.peer_stops.push_back(
        {nb::cast<std::int16_t>(stop[0]), bytes_of(stop[1]), bytes_of(stop[2]), nb::cast<bool>(stop[3])});
  }
  setup.holds_back = setting<bool>(settings, "hold_back");
  setup.recent_bytes = setting<std::size_t>(settings, "recent_bytes");
  return setup;
}

}  // namespace wirebond::engine
