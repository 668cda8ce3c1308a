// Converts a continuing stream of bytes to numpy columns, batch by batch, as columns.cpp does for a whole capture.
#include "follower.hpp"

#include <nanobind/stl/shared_ptr.h>

#include <algorithm>
#include <cmath>
#include <stdexcept>
#include <utility>

#include "columns.hpp"

namespace wirebond::engine {

using namespace nb::literals;

Follower::Follower(std::shared_ptr<const ProtocolTable> protocol, std::shared_ptr<const FormatTable> format,
                   double idle_seconds)
    : protocol_(std::move(protocol)),
      format_(std::move(format)),
      workspace_(workspace_bytes(format_->source())),
      deframer_(format_->source(), workspace_.data(), static_cast<std::uint64_t>(std::ceil(idle_seconds * 1e6))),
      counts_(protocol_->messages().size(), 0) {}

struct Follower::Collecting {
  Follower& follower;
  Capture found = follower.empty();

  void operator()(const Frame& frame) {
    if (frame.message >= 0) ++follower.counts_[static_cast<std::size_t>(frame.message)];
    take_row(*follower.protocol_, *follower.format_, frame, frame.offset, &follower.time_, found);
    rows_for(found, frame).sizes.push_back(static_cast<std::uint32_t>(frame.wire_size));
  }
};

Capture Follower::empty() const {
  Capture found;
  found.messages.resize(protocol_->messages().size());
  return found;
}

nb::dict Follower::feed(nb::handle bytes, const nb::dict& reads) {
  const BufferView view(bytes);
  const BufferView ends_view(reads["ends"]);
  const BufferView times_view(reads["times"]);
  const auto* const ends = reinterpret_cast<const std::uint64_t*>(ends_view.data());
  const auto* const times = reinterpret_cast<const double*>(times_view.data());
  const std::size_t count = std::min(ends_view.size(), times_view.size()) / sizeof(std::uint64_t);
  const TimingMarks marks = read_marks(reads);
  check_reads(ends, count, view.size());
  Collecting sink{*this};
  auto broken = marks.breaks.begin();
  auto expected = marks.expected.begin();
  std::size_t at = 0;
  for (std::size_t i = 0; i <= count; ++i) {
    for (; broken != marks.breaks.end() && *broken <= i; ++broken) deframer_.give_up(sink);
    if (i == count) break;
    time_ = std::max(time_, times[i]);
    const auto now_us = static_cast<std::uint64_t>(std::llround(time_ * 1e6));
    deframer_.idle(now_us, sink);
    for (; expected != marks.expected.end() && expected->first <= i; ++expected) deframer_.expect(expected->second);
    deframer_.feed(view.data() + at, ends[i] - at, now_us, sink);
    at = ends[i];
  }
  for (; expected != marks.expected.end(); ++expected) deframer_.expect(expected->second);
  return message_tables(*protocol_, *format_, std::move(sink.found));
}

nb::dict Follower::idle(double t) {
  if (!std::isfinite(t) || std::fabs(t) > 9e12) throw std::invalid_argument("the time is no time");
  time_ = std::max(time_, t);
  Collecting sink{*this};
  deframer_.idle(static_cast<std::uint64_t>(std::llround(time_ * 1e6)), sink);
  return message_tables(*protocol_, *format_, std::move(sink.found));
}

nb::dict Follower::tables() const { return message_tables(*protocol_, *format_, empty(), true); }

nb::object Follower::stats() const {
  const HostAccount& account = deframer_.account();
  return to_object(account_node(account, account.unlisted.found(), deframer_.bytes(), deframer_.pending(), *protocol_,
                                counts_, *format_, SequenceBook(format_).account()));
}

void bind_follower(nb::module_& module) {
  nb::class_<Follower>(module, "Follower")
      .def(
          "__init__",
          [](Follower* self, std::shared_ptr<const ProtocolTable> protocol, std::shared_ptr<const FormatTable> format,
             double idle_seconds) { new (self) Follower(std::move(protocol), std::move(format), idle_seconds); },
          "protocol"_a, "format"_a, "idle_seconds"_a)
      .def("feed", &Follower::feed, "bytes"_a, "reads"_a)
      .def("idle", &Follower::idle, "t"_a)
      .def("tables", &Follower::tables)
      .def("settled", &Follower::settled)
      .def("stats", &Follower::stats);
}

}  // namespace wirebond::engine
