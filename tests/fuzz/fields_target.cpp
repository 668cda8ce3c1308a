// Fuzz target: the generated field code of every message, over any payload. README.md says what must hold.
#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <memory>
#include <vector>

#include "describe.hpp"
#include "expect.hpp"
#include "messages.hpp"  // written by emit.py
#include "wirebond/receiver.hpp"

namespace {

using Bytes = std::vector<std::uint8_t>;

/// Bytes in memory of just their size, so that a read or a write past them is seen.
class Exact {
 public:
  explicit Exact(std::size_t size) : bytes_(new std::uint8_t[size]), size_(size) {}
  Exact(const std::uint8_t* from, std::size_t size) : Exact(size) { std::copy(from, from + size, bytes_.get()); }
  std::uint8_t* data() { return bytes_.get(); }
  std::size_t size() const { return size_; }

 private:
  std::unique_ptr<std::uint8_t[]> bytes_;
  std::size_t size_;
};

/// The bytes of a message; nothing where the generated code refuses to write it.
template <class Message>
Bytes written(const Message& message) {
  Exact payload(payload_bytes(message));
  if (!write_payload(message, payload.data())) return {};
  return Bytes(payload.data(), payload.data() + payload.size());
}

/// One for all messages, so that a source's deframer is compiled once.
struct Handler {
  std::size_t calls = 0;
  std::int16_t index = -1;
  Bytes payload;

  template <class Message>
  void on(const Message& message) {
    ++calls;
    index = Message::Info::index;
    payload = written(message);
  }
};

/// A message that breaks no rule goes over the wire and comes out as it was.
template <class Message, class Source>
void expect_same_over_the_wire(const Message& message, const Bytes& payload) {
  Exact frame(Message::Info::max_frame_bytes);
  std::size_t size = 0;
  const wirebond::Status status = encode(message, frame.data(), frame.size(), size);
  const bool is_nothing =
      payload.empty() && wirebond::max_frame_bytes(Source{}.format()) == Message::Info::max_payload_bytes;
  if (is_nothing) return;  // a frame without a byte
  EXPECT(status == wirebond::Status::ok, "a message that breaks no rule can be encoded");
  EXPECT(size > 0 && size <= frame.size(), "max_frame_bytes is enough");
  wirebond::Receiver<Source> receiver;
  Handler handler;
  Exact wire(frame.data(), size);
  receiver.feed(wire.data(), wire.size(), 0, handler);
  receiver.idle(Source::idle_us, handler);
  EXPECT(handler.calls == 1 && handler.index == Message::Info::index, "an encoded message is received once");
  EXPECT(handler.payload == payload, "a received message is the one that was sent");

  Exact little(size - 1);
  std::size_t none = 1;
  EXPECT(encode(message, little.data(), little.size(), none) == wirebond::Status::too_small && none == 0,
         "a frame that does not fit is refused");
}

}  // namespace

template <class Message, class Source, bool BoundRoundsPast, bool MayGrow>
void fuzz::check(const std::uint8_t* data, std::size_t size) {
  using Info = typename Message::Info;
  Exact payload(data, size);
  Message message;
  if (!decode(payload.data(), payload.size(), message)) {
    EXPECT(size < Info::min_payload_bytes || Info::min_payload_bytes != Info::max_payload_bytes,
           "a payload that is long enough is decoded");
    return;
  }
  EXPECT(size >= Info::min_payload_bytes, "a payload that is too short is refused");
  const std::size_t known = payload_bytes(message);
  EXPECT(known >= Info::min_payload_bytes && known <= Info::max_payload_bytes, "a message's size is within its bounds");
  EXPECT(MayGrow || known <= size, "no more is decoded than there is");
  const wirebond::Violation found = violations(message);
  if constexpr (wirebond::detail::HasClamp<Message>::value) {
    if (!wirebond::rejects(found)) {
      clamp(message);
      EXPECT(violations(message) == wirebond::Violation::none, "a clamped message breaks no rule");
    }
  }
  const Bytes first = written(message);
  if (wirebond::rejects(found)) return;
  // A bound may round past itself on the wire: what it stands for there is received, and cannot be sent.
  if (BoundRoundsPast && first.empty()) return;
  EXPECT(first.size() == known, "a message that breaks no rule can be written");
  Exact copy(first.data(), first.size());
  Message again;
  EXPECT(decode(copy.data(), copy.size(), again), "what was written can be decoded");
  EXPECT(violations(again) == wirebond::Violation::none, "what was written breaks no rule");
  EXPECT(written(again) == first, "what was decoded is written as it was");
  expect_same_over_the_wire<Message, Source>(message, first);
}

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  if (size < 2) return 0;
  const auto key = static_cast<std::uint16_t>(data[0] | data[1] << 8);
  // The first whose key is not less, around the end: new messages leave most inputs of the corpus with their own.
  const auto end = fuzz::messages.end();
  auto found = std::find_if(fuzz::messages.begin(), end, [&](const auto& entry) { return entry.key >= key; });
  if (found == end) found = fuzz::messages.begin();
  found->check(data + 2, size - 2);
  return 0;
}
