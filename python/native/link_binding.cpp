// A Link as Python sees it: its port by name, and nothing of it in a forked child.
#include <nanobind/stl/optional.h>
#include <nanobind/stl/shared_ptr.h>
#include <nanobind/stl/string.h>
#include <nanobind/stl/vector.h>
#include <pthread.h>

#include <atomic>
#include <cstddef>
#include <cstdint>
#include <memory>
#include <optional>
#include <string>
#include <utility>

#include "link.hpp"
#include "without_gil.hpp"

namespace wirebond::engine {

namespace {

/// Count the forks on the way to this process. Called each time, where a system call would be too slow.
unsigned forks() {
  static std::atomic<unsigned> count{0};
  static const int registered = ::pthread_atfork(nullptr, nullptr, [] { count.fetch_add(1); });
  static_cast<void>(registered);
  return count.load(std::memory_order_relaxed);
}

/// A Link that a forked child does not touch: the child has neither its thread nor its locks.
class LinkHandle {
 public:
  LinkHandle(LinkSetup setup, std::unique_ptr<Opener> opener, bool waits_for_port)
      : link_(std::make_unique<Link>(std::move(setup), std::move(opener), waits_for_port)), forks_(forks()) {}
  ~LinkHandle() { leave_in_child(); }

  /// Null in a forked child.
  Link* get() {
    leave_in_child();
    return link_.get();
  }

  Link& operator*() {
    Link* const link = get();
    if (link != nullptr) return *link;
    const nb::object type = nb::module_::import_("wirebond.errors").attr("LinkDownError");
    PyErr_SetString(type.ptr(),
                    "this link belongs to the process that opened it, and this one is its fork; open the "
                    "port in the process that uses it");
    throw nb::python_error();
  }

  void leave_in_child() {
    if (link_ == nullptr || forks() == forks_) return;
    link_->abandon();
    static_cast<void>(link_.release());  // its destructor would wait for a thread that does not exist here
  }

 private:
  std::unique_ptr<Link> link_;
  unsigned forks_;
};

/// `resolve` is called without locks, and no link's thread exists any more when the interpreter ends: so the thread may
/// wait for the GIL here.
Resolve calling(nb::callable resolve) {
  return [resolve = std::move(resolve)](PortProblem& problem) -> std::string {
    const nb::gil_scoped_acquire gil;
    try {
      return nb::cast<std::string>(resolve());
    } catch (nb::python_error& error) {
      problem = {nb::cast<std::string>(nb::str(error.value())), 0};
      const nb::object code = nb::getattr(error.value(), "errno", nb::none());
      if (!code.is_none()) problem.code = nb::cast<int>(code);
      return {};
    }
  };
}

/// `port`: `name`; for a tty also `root`, the folder with the system's files, and `resolve` if its path may change; or
/// `host` and `service` for TCP.
std::unique_ptr<Opener> opener_of(const nb::dict& port, nb::handle settings) {
  auto name = nb::cast<std::string>(port["name"]);
  if (port.contains("host")) {
    return tcp_opener(std::move(name), nb::cast<std::string>(port["host"]), nb::cast<std::string>(port["service"]));
  }
  posix::SerialSettings serial;
  const auto parity = nb::cast<std::string>(settings.attr("parity"));
  serial.baud = nb::cast<std::uint32_t>(settings.attr("baud"));
  serial.data_bits = nb::cast<std::uint8_t>(settings.attr("data_bits"));
  serial.parity = parity == "even" ? posix::Parity::even : parity == "odd" ? posix::Parity::odd : posix::Parity::none;
  serial.stop_bits = nb::cast<std::uint8_t>(settings.attr("stop_bits"));
  auto root = nb::cast<std::string>(port["root"]);
  if (port.contains("resolve")) {
    return moving_serial_opener(std::move(name), calling(nb::cast<nb::callable>(port["resolve"])), serial,
                                std::move(root));
  }
  return serial_opener(std::move(name), serial, std::move(root));
}

/// Convert it for `wirebond.link.line.line_from`.
nb::object to_dict(const std::optional<LineReport>& line) {
  if (!line) return nb::none();
  static constexpr const char* parities[] = {"none", "even", "odd"};
  static constexpr const char* answers[] = {"not_offered", "refused", "accepted"};
  const posix::SerialReport& serial = line->serial;
  nb::dict out;
  out["baud"] = serial.actual.baud;
  out["asked_baud"] = line->asked_baud;
  out["data_bits"] = serial.actual.data_bits;
  out["parity"] = parities[static_cast<std::size_t>(serial.actual.parity)];
  out["stop_bits"] = serial.actual.stop_bits;
  out["is_exclusive"] = serial.is_exclusive;
  out["low_latency"] = answers[static_cast<std::size_t>(serial.low_latency)];
  if (line->timer.before_ms >= 0) {
    out["latency_timer"] =
        nb::make_tuple(line->timer.path, line->timer.before_ms, line->timer.now_ms, line->timer.code);
  }
  return out;
}

}  // namespace

void bind_link(nb::module_& m) {
  nb::class_<LinkHandle>(m, "Link")
      .def(
          "__init__",
          [](LinkHandle* self, std::shared_ptr<const ProtocolTable> protocol,
             std::shared_ptr<const FormatTable> receive, nb::dict port, nb::handle settings) {
            LinkSetup setup = link_setup(std::move(protocol), std::move(receive), settings);
            new (self) LinkHandle(std::move(setup), opener_of(port, settings), nb::cast<bool>(port["waits"]));
          },
          nb::arg("protocol"), nb::arg("receive"), nb::arg("port"), nb::arg("settings"))
      .def(
          "send",
          [](LinkHandle& self, std::int16_t message, nb::bytes frame, std::int16_t reply, bool takes_number,
             std::uint64_t address) { return answer_of((*self).send(message, frame, reply, takes_number, address)); },
          nb::arg("message"), nb::arg("frame"), nb::arg("reply"), nb::arg("takes_number"), nb::arg("address"))
      .def(
          "send_all", [](LinkHandle& self, nb::list frames) { return (*self).send_all(frames); }, nb::arg("frames"))
      .def(
          "repeat",
          [](LinkHandle& self, std::int16_t message, nb::bytes frame, double hold, std::int16_t reply,
             bool takes_number, std::uint64_t address) {
            return answer_of((*self).repeat(message, frame, hold, reply, takes_number, address));
          },
          nb::arg("message"), nb::arg("frame"), nb::arg("hold"), nb::arg("reply"), nb::arg("takes_number"),
          nb::arg("address"))
      .def(
          "note_safe", [](LinkHandle& self, nb::tuple safe) { return (*self).note_safe(safe); }, nb::arg("safe"))
      .def(
          "end_safely",
          [](LinkHandle& self, std::int16_t message, std::uint64_t address) {
            return (*self).end_safely(message, address);
          },
          nb::arg("message"), nb::arg("address"))
      .def(
          "end_if_moved",
          [](LinkHandle& self, std::int16_t message, std::uint64_t address) {
            return (*self).end_if_moved(message, address);
          },
          nb::arg("message"), nb::arg("address"))
      .def("hand_over", [](LinkHandle& self) { (*self).hand_over(); })
      .def("end_motion", [](LinkHandle& self) { (*self).end_motion(); })
      .def(
          "set_address", [](LinkHandle& self, std::uint64_t address) { (*self).set_address(address); },
          nb::arg("address"))
      .def(
          "listen_to_all", [](LinkHandle& self, bool all) { (*self).listen_to_all(all); }, nb::arg("all"))
      .def(
          "stop_repeating",
          [](LinkHandle& self, std::int16_t message, std::optional<std::uint64_t> address) {
            (*self).stop_repeating(message, address);
          },
          nb::arg("message"), nb::arg("address") = nb::none())
      .def("stop", [](LinkHandle& self) { return (*self).stop(); })
      .def("release_stop", [](LinkHandle& self) { (*self).release_stop(); })
      .def("is_stopped", [](LinkHandle& self) { return (*self).is_stopped(); })
      .def(
          "receive", [](LinkHandle& self, double timeout) { return (*self).receive(timeout); }, nb::arg("timeout"))
      .def(
          "attend", [](LinkHandle& self, double timeout) { return (*self).attend(timeout); }, nb::arg("timeout"))
      .def("recall", [](LinkHandle& self) { (*self).recall(); })
      .def(
          "wait_unattended", [](LinkHandle& self, double timeout) { (*self).wait_unattended(timeout); },
          nb::arg("timeout"))
      .def("set_stamper", [](LinkHandle& self, nb::object stamper) { (*self).set_stamper(std::move(stamper)); })
      .def("changes", [](LinkHandle& self) { return (*self).changes(); })
      .def("line", [](LinkHandle& self) { return to_dict((*self).line()); })
      .def("stats", [](LinkHandle& self) { return (*self).stats(); })
      .def("recent", [](LinkHandle& self) { return (*self).recent(); })
      .def(
          "open_tap", [](LinkHandle& self, std::size_t capacity) { return (*self).open_tap(capacity); },
          nb::arg("capacity"))
      .def(
          "take_tap", [](LinkHandle& self, int tap) { return (*self).take_tap(tap); }, nb::arg("tap"))
      .def(
          "close_tap", [](LinkHandle& self, int tap) { (*self).close_tap(tap); }, nb::arg("tap"))
      .def(
          "note", [](LinkHandle& self, const std::string& text) { (*self).note(text); }, nb::arg("text"))
      .def("state", [](LinkHandle& self) { return (*self).state(); })
      .def("why", [](LinkHandle& self) { return (*self).why(); })
      .def("is_closed", [](LinkHandle& self) { return (*self).is_closed(); })
      .def("struck_deadlines", [](LinkHandle& self) { return (*self).struck_deadlines(); })
      .def(
          "recover_deadline", [](LinkHandle& self, std::uint8_t action) { (*self).recover_deadline(action); },
          nb::arg("action"))
      .def("begin_close",
           [](LinkHandle& self) {
             if (Link* const link = self.get()) link->begin_close();
           })
      .def("close",
           [](LinkHandle& self) {
             if (Link* const link = self.get()) link->close();  // a forked child has nothing to close
           })
      .def("after_fork", &LinkHandle::leave_in_child);
  m.def("hold_waiting_threads", &WithoutGil::hold_waiting_threads);
  m.def("settle_threads", &WithoutGil::settle);
  m.def("after_fork", &WithoutGil::after_fork);
}

}  // namespace wirebond::engine
