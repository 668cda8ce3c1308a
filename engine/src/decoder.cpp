// Converts a stream of bytes to received messages. Waits for nothing, opens nothing; time is an argument.
#include "wirebond/engine/decoder.hpp"

#include <cmath>
#include <stdexcept>
#include <utility>

#include "wirebond/engine/account.hpp"

namespace wirebond::engine {

Decoder::Decoder(std::shared_ptr<const ProtocolTable> protocol, std::shared_ptr<const FormatTable> format,
                 double idle_seconds)
    : protocol_(std::move(protocol)),
      format_(std::move(format)),
      workspace_(workspace_bytes(format_->source())),
      deframer_(format_->source(), workspace_.data(), static_cast<std::uint64_t>(std::ceil(idle_seconds * 1e6))),
      counts_(protocol_->messages().size(), 0),
      sequence_(format_) {}

void Decoder::expect(std::int16_t message, int place, std::optional<std::uint64_t> address) {
  deframer_.expect(message);
  HostAddressing::Rules rules;
  rules.sender_place = address ? place : -1;
  rules.only_last_asked = true;
  addressing_ = HostAddressing(format_->format(), rules);
  if (address) addressing_.asks(message, *address);
}

std::uint64_t Decoder::microseconds(double time) {
  if (time > latest_) latest_ = time;  // a clock that steps back must not count as a long silence
  return static_cast<std::uint64_t>(static_cast<std::int64_t>(std::llround(latest_ * 1e6)));
}

Arrivals Decoder::none() const {
  Arrivals out{std::make_shared<Batch>(), {}};
  out.batch->protocol = protocol_;
  out.batch->format = format_;
  return out;
}

struct Decoder::Recording {
  Decoder& decoder;
  Arrivals& to;
  double time = 0;
  bool keep = true;  ///< false: frames are only counted

  void operator()(const Frame& frame) {
    if (frame.message >= 0) ++decoder.counts_[static_cast<std::size_t>(frame.message)];
    decoder.sequence_.take(frame);
    if (decoder.addressing_.is_foreign(frame)) return decoder.foreign_.add(frame);
    if (!keep) return;
    if (to.batch->bytes.size() > UINT32_MAX / 2) throw std::length_error("more than 2 GiB of frames in one call");
    to.events.push_back(record(frame, time, *to.batch));
  }
};

Arrivals Decoder::feed(const std::uint8_t* bytes, std::size_t size, double time) {
  Arrivals out = none();
  const std::uint64_t now = microseconds(time);
  Recording sink{*this, out, time};
  deframer_.feed(bytes, size, now, sink);
  return out;
}

Arrivals Decoder::idle(double time) {
  Arrivals out = none();
  const std::uint64_t now = microseconds(time);
  Recording sink{*this, out, time};
  deframer_.idle(now, sink);
  return out;
}

Arrivals Decoder::finish() {
  Arrivals out = none();
  Recording sink{*this, out, latest_};
  deframer_.give_up(sink);
  return out;
}

void Decoder::read(const std::uint8_t* bytes, std::size_t size, double time, bool keep, Arrivals& to) {
  const std::uint64_t now = microseconds(time);
  Recording sink{*this, to, time, keep};
  deframer_.idle(now, sink);
  deframer_.feed(bytes, size, now, sink);
}

Node Decoder::account() const {
  const HostAccount& account = deframer_.account();
  return account_node(account, account.unlisted.found(), deframer_.bytes(), deframer_.pending(), *protocol_, counts_,
                      *format_, sequence_.account(), foreign_);
}

}  // namespace wirebond::engine
