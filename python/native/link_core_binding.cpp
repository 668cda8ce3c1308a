// A LinkCore and its results as Python sees them. No rule of a link.
#include "link_core_binding.hpp"

#include <nanobind/stl/optional.h>
#include <nanobind/stl/shared_ptr.h>
#include <nanobind/stl/string.h>
#include <nanobind/stl/vector.h>

#include <cstddef>
#include <cstdint>
#include <optional>
#include <utility>

#include "decoder.hpp"
#include "objects.hpp"
#include "wirebond/engine/account.hpp"

namespace wirebond::engine {

namespace {

/// A core whose messages are stamped.
struct StampedCore : LinkCore {
  using LinkCore::LinkCore;
  nb::object stamper;  ///< of received messages; see Message
};

}  // namespace

LinkSetup link_setup(std::shared_ptr<const ProtocolTable> protocol, std::shared_ptr<const FormatTable> receive,
                     nb::handle settings) {
  return link_setup(std::move(protocol), std::move(receive),
                    nb::cast<std::shared_ptr<const FormatTable>>(nb::object(settings.attr("send"))),
                    unpacked(nb::cast<nb::bytes>(settings.attr("table")())));
}

nb::list to_list(const std::deque<Arrivals>& taken, const nb::object& stamper) {
  nb::list out;
  for (const Arrivals& arrivals : taken) out.extend(to_list(arrivals, stamper));
  return out;
}

nb::tuple to_tuple(const TapCopy& taken) {
  static constexpr const char* names[] = {"received",    "sent",        "port_up",         "port_down",
                                          "stopped",     "released",    "deadline_struck", "deadline_ended",
                                          "lease_begun", "lease_ended", "noted",           "port_settings"};
  nb::list pieces;
  std::size_t at = 0;
  for (const TapPiece& piece : taken.pieces) {
    const auto* const bytes = reinterpret_cast<const char*>(taken.bytes.data() + at);
    pieces.append(nb::make_tuple(names[static_cast<std::size_t>(piece.kind)], piece.before_us, piece.t_us,
                                 nb::bytes(bytes, piece.size)));
    at += piece.size;
  }
  return nb::make_tuple(pieces, taken.loss.pieces, taken.loss.received_bytes, taken.loss.sent_bytes);
}

nb::tuple to_tuple(const RecentCopy& recent) {
  static constexpr const char* names[] = {"received",  "sent",           "port_up",
                                          "port_down", "port_collision", "port_settings"};
  nb::list pieces;
  std::size_t at = 0;
  for (const RecentPiece& piece : recent.pieces) {
    const auto* const bytes = reinterpret_cast<const char*>(recent.bytes.data() + at);
    pieces.append(
        nb::make_tuple(names[static_cast<std::size_t>(piece.kind)], piece.t_us, nb::bytes(bytes, piece.size)));
    at += piece.size;
  }
  return nb::make_tuple(pieces, recent.dropped_bytes);
}

nb::list to_list(const std::deque<LinkChange>& changes) {
  static constexpr const char* names[] = {"struck", "ended", "port_up", "port_down"};
  nb::list out;
  for (const LinkChange& change : changes) {
    out.append(nb::make_tuple(names[static_cast<std::size_t>(change.kind)], change.t_us, change.action));
  }
  return out;
}

void bind_link_core(nb::module_& m) {
  nb::class_<StampedCore>(m, "LinkCore", "A link under virtual time: every time is an argument, in microseconds.")
      .def(
          "__init__",
          [](StampedCore* self, std::shared_ptr<const ProtocolTable> protocol,
             std::shared_ptr<const FormatTable> receive, nb::handle settings, std::uint64_t now) {
            new (self) StampedCore(link_setup(std::move(protocol), std::move(receive), settings), now);
          },
          nb::arg("protocol"), nb::arg("receive"), nb::arg("settings"), nb::arg("now"))
      .def(
          "send",
          [](StampedCore& self, std::int16_t message, nb::bytes frame, std::int16_t reply, std::uint64_t now,
             bool takes_number, std::uint64_t address) {
            return answer_of(self.outbox().send(message, static_cast<const std::uint8_t*>(frame.data()), frame.size(),
                                                reply, takes_number, now, address));
          },
          nb::arg("message"), nb::arg("frame"), nb::arg("reply"), nb::arg("now"), nb::arg("takes_number") = true,
          nb::arg("address") = 0)
      .def(
          "repeat",
          [](StampedCore& self, std::int16_t message, nb::bytes frame, double hold, std::int16_t reply,
             std::uint64_t now, bool takes_number, std::uint64_t address) {
            const SendResult result =
                self.outbox().repeat(message, static_cast<const std::uint8_t*>(frame.data()), frame.size(), reply,
                                     takes_number, to_us(hold), now, address);
            self.note_changes(now);
            return answer_of(result);
          },
          nb::arg("message"), nb::arg("frame"), nb::arg("hold"), nb::arg("reply"), nb::arg("now"),
          nb::arg("takes_number") = true, nb::arg("address") = 0)
      .def(
          "note_safe", [](StampedCore& self, nb::tuple safe) { return self.note_safe(stop_frame(to_node(safe))); },
          nb::arg("safe"))
      .def(
          "end_safely",
          [](StampedCore& self, std::int16_t message, std::uint64_t address) {
            return self.outbox().end_safely(message, address);
          },
          nb::arg("message"), nb::arg("address"))
      .def(
          "end_if_moved",
          [](StampedCore& self, std::int16_t message, std::uint64_t address) {
            return self.outbox().end_if_moved(message, address);
          },
          nb::arg("message"), nb::arg("address"))
      .def("hand_over_motion", [](StampedCore& self) { self.outbox().hand_over_motion(); })
      .def("end_motion", [](StampedCore& self) { self.outbox().end_motion(); })
      .def(
          "set_address",
          [](StampedCore& self, std::uint64_t address) { self.link().addressing().set_address(address); },
          nb::arg("address"))
      .def(
          "listen_to_all", [](StampedCore& self, bool all) { self.link().addressing().listen_to_all(all); },
          nb::arg("all"))
      .def(
          "stop_repeating",
          [](StampedCore& self, std::int16_t message, std::optional<std::uint64_t> address) {
            if (address) return self.outbox().stop_repeating(message, *address);
            self.outbox().stop_repeating(message);
          },
          nb::arg("message"), nb::arg("address") = nb::none())
      .def(
          "stop",
          [](StampedCore& self, std::uint64_t now) {
            self.outbox().stop(now);
            self.note_changes(now, "stopped");
          },
          nb::arg("now"))
      .def("release_stop", [](StampedCore& self) { self.outbox().release_stop(); })
      .def("is_stopped", [](StampedCore& self) { return self.outbox().is_stopped(); })
      .def("close", [](StampedCore& self) { self.outbox().close(); })
      .def(
          "end",
          [](StampedCore& self, std::uint64_t now) {
            self.note_changes(now, "closed");
            self.port_down(now, {});
            self.outbox().end();
          },
          nb::arg("now"))
      .def("is_empty", [](StampedCore& self) { return self.outbox().is_empty(); })
      .def(
          "port_up", [](StampedCore& self, std::uint64_t now) { self.port_up(now); }, nb::arg("now"))
      .def(
          "port_down", [](StampedCore& self, std::uint64_t now, const std::string& why) { self.port_down(now, why); },
          nb::arg("now"), nb::arg("why") = "")
      .def(
          "received",
          [](StampedCore& self, nb::bytes bytes, std::uint64_t before, std::uint64_t after) {
            self.received(static_cast<const std::uint8_t*>(bytes.data()), bytes.size(), before, after, true);
          },
          nb::arg("bytes"), nb::arg("before"), nb::arg("after"))
      .def(
          "idle", [](StampedCore& self, std::uint64_t now) { self.idle(now); }, nb::arg("now"))
      .def(
          "poll", [](StampedCore& self, std::uint64_t now) { self.poll(now); }, nb::arg("now"))
      .def(
          "to_write",
          [](StampedCore& self, std::uint64_t now, bool together) {
            const Outgoing out = self.to_write(now, together);
            return nb::bytes(reinterpret_cast<const char*>(out.bytes), out.size);
          },
          nb::arg("now"), nb::arg("together") = false)
      .def(
          "hand_over",
          [](StampedCore& self, std::uint64_t now) {
            const std::vector<std::uint8_t> bytes = self.hand_over(now);
            return nb::bytes(bytes.data(), bytes.size());
          },
          nb::arg("now"))
      .def(
          "written", [](StampedCore& self, std::size_t size, std::uint64_t now) { self.written(size, now); },
          nb::arg("size"), nb::arg("now"))
      .def("is_blocked", [](StampedCore& self) { return self.link().is_blocked(); })
      .def(
          "driver_holds",
          [](StampedCore& self, std::size_t size, std::uint64_t now) { self.link().driver_holds(size, now); },
          nb::arg("size"), nb::arg("now"))
      .def(
          "next_due", [](StampedCore& self, std::uint64_t now) { return self.next_due(now); }, nb::arg("now"))
      .def("has_arrivals", [](StampedCore& self) { return self.has_arrivals(); })
      .def("has_news", [](StampedCore& self) { return self.has_news(); })
      .def("set_stamper", [](StampedCore& self, nb::object stamper) { self.stamper = std::move(stamper); })
      .def("changes", [](StampedCore& self) { return to_list(self.take_changes()); })
      .def("receive", [](StampedCore& self) { return to_list(self.take(), self.stamper); })
      .def("recent", [](StampedCore& self) { return to_tuple(self.recent().copy()); })
      .def(
          "open_tap",
          [](StampedCore& self, std::size_t capacity, std::uint64_t now) { return self.open_tap(capacity, now); },
          nb::arg("capacity"), nb::arg("now"))
      .def(
          "take_tap", [](StampedCore& self, int tap) { return to_tuple(self.take_tap(tap)); }, nb::arg("tap"))
      .def(
          "close_tap", [](StampedCore& self, int tap) { self.close_tap(tap); }, nb::arg("tap"))
      .def(
          "note", [](StampedCore& self, const std::string& text, std::uint64_t now) { self.note(text, now); },
          nb::arg("text"), nb::arg("now"))
      .def("stats",
           [](StampedCore& self) { return to_object(account_node(self.account(), self.protocol(), self.receives())); })
      .def(
          "state", [](StampedCore& self, std::uint64_t now) { return name_of(self.link().state(now)); }, nb::arg("now"))
      .def("struck_deadlines", [](StampedCore& self) { return self.struck_deadlines(); })
      .def(
          "recover_deadline",
          [](StampedCore& self, std::uint8_t action, std::uint64_t now) { self.recover_deadline(action, now); },
          nb::arg("action"), nb::arg("now"));
}

}  // namespace wirebond::engine
