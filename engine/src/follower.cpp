// Converts a continuing stream of bytes to rows of payloads, batch by batch.
#include "wirebond/engine/follower.hpp"

#include <algorithm>
#include <cmath>
#include <stdexcept>
#include <utility>

#include "wirebond/engine/account.hpp"

namespace wirebond::engine {

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

Capture Follower::feed(const std::uint8_t* bytes, const Reads& reads) {
  Collecting sink{*this};
  auto broken = reads.breaks.begin();
  auto expected = reads.expected.begin();
  std::size_t at = 0;
  for (std::size_t i = 0; i <= reads.count; ++i) {
    for (; broken != reads.breaks.end() && *broken <= i; ++broken) deframer_.give_up(sink);
    if (i == reads.count) break;
    time_ = std::max(time_, reads.times[i]);
    const auto now_us = static_cast<std::uint64_t>(std::llround(time_ * 1e6));
    deframer_.idle(now_us, sink);
    for (; expected != reads.expected.end() && expected->first <= i; ++expected) deframer_.expect(expected->second);
    deframer_.feed(bytes + at, reads.ends[i] - at, now_us, sink);
    at = reads.ends[i];
  }
  for (; expected != reads.expected.end(); ++expected) deframer_.expect(expected->second);
  return std::move(sink.found);
}

Capture Follower::idle(double t) {
  if (!std::isfinite(t) || std::fabs(t) > 9e12) throw std::invalid_argument("the time is not a time");
  time_ = std::max(time_, t);
  Collecting sink{*this};
  deframer_.idle(static_cast<std::uint64_t>(std::llround(time_ * 1e6)), sink);
  return std::move(sink.found);
}

Node Follower::account() const {
  const HostAccount& account = deframer_.account();
  return account_node(account, account.unlisted.found(), deframer_.bytes(), deframer_.pending(), *protocol_, counts_,
                      *format_, SequenceBook(format_).account());
}

}  // namespace wirebond::engine
