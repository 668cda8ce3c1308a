#include "packing.hpp"

#include <cstdint>
#include <cstring>
#include <string>
#include <vector>

namespace wirebond::engine {

namespace {

// A record, little-endian, without gaps. After this head: the header fields' bits (u64 each), the frame, the payload.
struct Head {
  std::uint32_t size = 0;  ///< of the record after this field
  double time = 0;
  std::uint64_t offset = 0;
  std::uint32_t id = 0;
  std::int16_t message = -1;
  std::uint8_t form = 0;
  std::uint8_t header_count = 0;
  std::uint32_t wire_size = 0;
  std::uint32_t payload_size = 0;
};
constexpr std::size_t size_bytes = 4;
constexpr std::size_t head_bytes = 36;

static_assert(__BYTE_ORDER__ == __ORDER_LITTLE_ENDIAN__, "the records of a machine with the other byte order");

/// Convert each member of a head in its order: to bytes, or from them.
template <class HeadType, class Step>
void each_member(HeadType& head, Step step) {
  step(head.size);
  step(head.time);
  step(head.offset);
  step(head.id);
  step(head.message);
  step(head.form);
  step(head.header_count);
  step(head.wire_size);
  step(head.payload_size);
}

void append(std::vector<std::uint8_t>& out, const void* bytes, std::size_t size) {
  const auto* first = static_cast<const std::uint8_t*>(bytes);
  out.insert(out.end(), first, first + size);
}

[[noreturn]] void refuse(std::size_t at, const char* why) {
  throw nb::value_error(("the record at byte " + std::to_string(at) + " " + why).c_str());
}

std::size_t header_count(const FormatTable& format, std::uint8_t form) {
  return format.format().forms[form].header_count;
}

/// Read a record's head, and check it for this protocol.
Head read_head(const BufferView& records, std::size_t at, const ProtocolTable& protocol, const FormatTable& format) {
  if (records.size() - at < head_bytes) refuse(at, "is cut short");
  Head head;
  const std::uint8_t* next = records.data() + at;
  each_member(head, [&](auto& member) {
    std::memcpy(&member, next, sizeof member);
    next += sizeof member;
  });
  if (head.form >= format.format().form_count || head.header_count != header_count(format, head.form))
    refuse(at, "has a form that the frames of this protocol do not have");
  const std::uint64_t parts = head_bytes - size_bytes + 8ull * head.header_count + head.wire_size + head.payload_size;
  if (parts != head.size) refuse(at, "has another size than its parts");
  if (records.size() - at - size_bytes < head.size) refuse(at, "is cut short");
  const auto known = static_cast<std::ptrdiff_t>(protocol.messages().size());
  if (head.message < -1 || head.message >= known) refuse(at, "is of a message that the protocol does not have");
  if (head.message >= 0 && head.payload_size < protocol.messages()[static_cast<std::size_t>(head.message)].min_payload)
    refuse(at, "has a payload that is too short for its message");
  return head;
}

}  // namespace

nb::bytes pack_messages(nb::list messages) {
  std::vector<std::uint8_t> out;
  for (nb::handle each : messages) {
    const Message& message = nb::cast<const Message&>(each);
    const Event& event = message.event();
    const Batch& batch = message.batch();
    Head head;
    head.time = event.time;
    head.offset = event.offset;
    head.id = event.id;
    head.message = event.message;
    head.form = event.form;
    head.header_count = static_cast<std::uint8_t>(header_count(*batch.format, event.form));
    head.wire_size = event.wire_size;
    head.payload_size = event.payload_size;
    head.size = static_cast<std::uint32_t>(head_bytes - size_bytes + 8u * head.header_count) + head.wire_size +
                head.payload_size;
    each_member(head, [&](const auto& member) { append(out, &member, sizeof member); });
    append(out, batch.headers.data() + event.header_at, 8u * head.header_count);
    append(out, batch.bytes.data() + event.wire_at, event.wire_size);
    append(out, batch.bytes.data() + event.payload_at, event.payload_size);
  }
  return nb::bytes(reinterpret_cast<const char*>(out.data()), out.size());
}

nb::list unpack_messages(std::shared_ptr<const ProtocolTable> protocol, std::shared_ptr<const FormatTable> format,
                         nb::handle records, double shift, nb::object stamper) {
  const BufferView view(records);
  Arrivals found{std::make_shared<Batch>(), {}};
  Batch* const batch = found.batch.get();
  for (std::size_t at = 0; at < view.size();) {
    const Head head = read_head(view, at, *protocol, *format);
    const std::uint8_t* next = view.data() + at + head_bytes;
    Event event;
    event.header_at = static_cast<std::uint32_t>(batch->headers.size());
    for (std::size_t i = 0; i < head.header_count; ++i, next += 8) {
      std::uint64_t bits = 0;
      std::memcpy(&bits, next, sizeof bits);
      batch->headers.push_back(bits);
    }
    event.wire_at = static_cast<std::uint32_t>(batch->bytes.size());
    event.wire_size = head.wire_size;
    event.payload_at = event.wire_at + head.wire_size;
    event.payload_size = head.payload_size;
    append(batch->bytes, next, std::size_t{head.wire_size} + head.payload_size);
    event.id = head.id;
    event.message = head.message;
    event.form = head.form;
    event.offset = head.offset;
    event.time = head.time + shift;
    found.events.push_back(event);
    at += size_bytes + head.size;
  }
  batch->protocol = std::move(protocol);
  batch->format = std::move(format);
  return to_list(found, stamper);
}

}  // namespace wirebond::engine
