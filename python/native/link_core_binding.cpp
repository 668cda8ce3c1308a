// A LinkCore and its results as Python sees them. No rule of a link.
#include <nanobind/stl/optional.h>
#include <nanobind/stl/shared_ptr.h>
#include <nanobind/stl/string.h>
#include <nanobind/stl/vector.h>

#include <cstddef>
#include <cstdint>
#include <deque>
#include <memory>
#include <optional>
#include <utility>

#include "link_core.hpp"

namespace wirebond::engine {

const char* name_of(HostLinkState state) {
  switch (state) {
    case HostLinkState::down: return "down";
    case HostLinkState::stale: return "stale";
    case HostLinkState::up: break;
  }
  return "up";
}

nb::dict to_dict(const LinkAccount& account, const ProtocolTable& protocol, const FormatTable& receive) {
  nb::dict send;
  send["offered"] = account.send.offered;
  send["accepted"] = account.send.accepted;
  send["refused_down"] = account.send.refused_down;
  send["refused_full"] = account.send.refused_full;
  send["refused_stopped"] = account.send.refused_stopped;
  send["sent"] = account.send.sent;
  send["sent_bytes"] = account.send.sent_bytes;
  send["queued"] = account.send.queued;
  send["replaced"] = account.send.replaced;
  send["expired"] = account.send.expired;
  send["overruled"] = account.send.overruled;
  send["aborted"] = account.send.aborted;
  nb::dict messages;
  for (std::size_t i = 0; i < account.sent.size(); ++i) {
    if (account.sent[i] != 0) messages[protocol.messages()[i].name.c_str()] = account.sent[i];
  }
  send["messages"] = messages;
  nb::dict out = account_dict(account.receive, account.receive.unlisted.found(), account.bytes, account.pending,
                              protocol, account.counts, receive, account.sequence, account.foreign);
  out["send"] = send;
  out["dropped_messages"] = account.dropped_messages;
  out["late"] = account.not_acted.late;
  out["held_back"] = account.not_acted.held_back;
  out["reconnects"] = account.reconnects;
  out["echoed_bytes"] = account.echoed;
  out["collisions"] = account.collisions;
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
  nb::class_<LinkCore>(m, "LinkCore", "A link under virtual time: every time is an argument, in microseconds.")
      .def(
          "__init__",
          [](LinkCore* self, std::shared_ptr<const ProtocolTable> protocol, std::shared_ptr<const FormatTable> receive,
             nb::handle settings, std::uint64_t now) {
            new (self) LinkCore(link_setup(std::move(protocol), std::move(receive), settings), now);
          },
          nb::arg("protocol"), nb::arg("receive"), nb::arg("settings"), nb::arg("now"))
      .def(
          "send",
          [](LinkCore& self, std::int16_t message, nb::bytes frame, std::int16_t reply, std::uint64_t now,
             bool takes_number, std::uint64_t address) {
            return answer_of(self.outbox().send(message, static_cast<const std::uint8_t*>(frame.data()), frame.size(),
                                                reply, takes_number, now, address));
          },
          nb::arg("message"), nb::arg("frame"), nb::arg("reply"), nb::arg("now"), nb::arg("takes_number") = true,
          nb::arg("address") = 0)
      .def(
          "repeat",
          [](LinkCore& self, std::int16_t message, nb::bytes frame, double hold, std::int16_t reply, std::uint64_t now,
             bool takes_number, std::uint64_t address) {
            const SendResult result =
                self.outbox().repeat(message, static_cast<const std::uint8_t*>(frame.data()), frame.size(), reply,
                                     takes_number, to_us(hold), now, address);
            self.note_changes(now);
            return answer_of(result);
          },
          nb::arg("message"), nb::arg("frame"), nb::arg("hold"), nb::arg("reply"), nb::arg("now"),
          nb::arg("takes_number") = true, nb::arg("address") = 0)
      .def(
          "note_safe", [](LinkCore& self, nb::tuple safe) { return self.note_safe(stop_frame(safe)); }, nb::arg("safe"))
      .def(
          "end_safely",
          [](LinkCore& self, std::int16_t message, std::uint64_t address) {
            return self.outbox().end_safely(message, address);
          },
          nb::arg("message"), nb::arg("address"))
      .def(
          "end_if_moved",
          [](LinkCore& self, std::int16_t message, std::uint64_t address) {
            return self.outbox().end_if_moved(message, address);
          },
          nb::arg("message"), nb::arg("address"))
      .def("hand_over_motion", [](LinkCore& self) { self.outbox().hand_over_motion(); })
      .def("end_motion", [](LinkCore& self) { self.outbox().end_motion(); })
      .def(
          "set_address", [](LinkCore& self, std::uint64_t address) { self.link().addressing().set_address(address); },
          nb::arg("address"))
      .def(
          "listen_to_all", [](LinkCore& self, bool all) { self.link().addressing().listen_to_all(all); },
          nb::arg("all"))
      .def(
          "stop_repeating",
          [](LinkCore& self, std::int16_t message, std::optional<std::uint64_t> address) {
            if (address) return self.outbox().stop_repeating(message, *address);
            self.outbox().stop_repeating(message);
          },
          nb::arg("message"), nb::arg("address") = nb::none())
      .def(
          "stop",
          [](LinkCore& self, std::uint64_t now) {
            self.outbox().stop(now);
            self.note_changes(now, "stopped");
          },
          nb::arg("now"))
      .def("release_stop", [](LinkCore& self) { self.outbox().release_stop(); })
      .def("is_stopped", [](LinkCore& self) { return self.outbox().is_stopped(); })
      .def("close", [](LinkCore& self) { self.outbox().close(); })
      .def(
          "end",
          [](LinkCore& self, std::uint64_t now) {
            self.note_changes(now, "closed");
            self.port_down(now, {});
            self.outbox().end();
          },
          nb::arg("now"))
      .def("is_empty", [](LinkCore& self) { return self.outbox().is_empty(); })
      .def("port_up", &LinkCore::port_up, nb::arg("now"))
      .def("port_down", &LinkCore::port_down, nb::arg("now"), nb::arg("why") = "")
      .def(
          "received",
          [](LinkCore& self, nb::bytes bytes, std::uint64_t before, std::uint64_t after) {
            self.received(static_cast<const std::uint8_t*>(bytes.data()), bytes.size(), before, after, true);
          },
          nb::arg("bytes"), nb::arg("before"), nb::arg("after"))
      .def("idle", &LinkCore::idle, nb::arg("now"))
      .def(
          "poll", [](LinkCore& self, std::uint64_t now) { self.poll(now); }, nb::arg("now"))
      .def(
          "to_write",
          [](LinkCore& self, std::uint64_t now, bool together) {
            const Outgoing out = self.to_write(now, together);
            return nb::bytes(reinterpret_cast<const char*>(out.bytes), out.size);
          },
          nb::arg("now"), nb::arg("together") = false)
      .def(
          "hand_over", [](LinkCore& self, std::uint64_t now) { return self.hand_over(now); }, nb::arg("now"))
      .def(
          "written", [](LinkCore& self, std::size_t size, std::uint64_t now) { self.written(size, now); },
          nb::arg("size"), nb::arg("now"))
      .def("is_blocked", [](LinkCore& self) { return self.link().is_blocked(); })
      .def(
          "driver_holds",
          [](LinkCore& self, std::size_t size, std::uint64_t now) { self.link().driver_holds(size, now); },
          nb::arg("size"), nb::arg("now"))
      .def(
          "next_due", [](LinkCore& self, std::uint64_t now) { return self.next_due(now); }, nb::arg("now"))
      .def("has_arrivals", &LinkCore::has_arrivals)
      .def("has_news", &LinkCore::has_news)
      .def("set_stamper", [](LinkCore& self, nb::object stamper) { self.stamper = std::move(stamper); })
      .def("changes", [](LinkCore& self) { return to_list(self.take_changes()); })
      .def("receive",
           [](LinkCore& self) {
             nb::list out;
             for (const Arrivals& arrivals : self.take())
               out.extend(to_list(arrivals.batch, arrivals.events, self.stamper));
             return out;
           })
      .def("recent", [](LinkCore& self) { return to_tuple(self.recent().copy()); })
      .def("open_tap", &LinkCore::open_tap, nb::arg("capacity"), nb::arg("now"))
      .def(
          "take_tap", [](LinkCore& self, int tap) { return to_tuple(self.take_tap(tap)); }, nb::arg("tap"))
      .def("close_tap", &LinkCore::close_tap, nb::arg("tap"))
      .def("note", &LinkCore::note, nb::arg("text"), nb::arg("now"))
      .def("stats", [](LinkCore& self) { return to_dict(self.account(), self.protocol(), self.receives()); })
      .def(
          "state", [](LinkCore& self, std::uint64_t now) { return name_of(self.link().state(now)); }, nb::arg("now"))
      .def("struck_deadlines", &LinkCore::struck_deadlines)
      .def(
          "recover_deadline",
          [](LinkCore& self, std::uint8_t action, std::uint64_t now) { self.recover_deadline(action, now); },
          nb::arg("action"), nb::arg("now"));
}

}  // namespace wirebond::engine
