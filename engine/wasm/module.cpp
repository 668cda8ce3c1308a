// The engine as a WebAssembly module: one protocol, with a decoder and a follower for each end. The host's link is in
// link.cpp.
//
// JavaScript gives bytes in `input`, and every function answers with a result: a MessagePack value at the address that
// it returns, of `result_size` bytes, until the next call. It is a map with `ok`, or with `error` (`message`: a value
// is refused; `engine`: our own mistake) and `text`. Times are microseconds as doubles, of a clock that never steps
// back. Each export is one call of the engine.
#include <algorithm>
#include <array>
#include <cstddef>
#include <cstdint>
#include <cstring>
#include <limits>
#include <memory>
#include <optional>
#include <stdexcept>
#include <string>
#include <utility>
#include <vector>

#include "session.hpp"
#include "wirebond/engine/spans.hpp"

namespace wirebond::engine {

std::vector<std::uint8_t> input;
std::vector<std::uint8_t> result;
std::unique_ptr<Session> session;

Session& open_session() {
  if (session == nullptr) throw std::logic_error("no protocol is open");
  return *session;
}

const std::shared_ptr<const FormatTable>& format_of(unsigned sender) {
  const auto& format = open_session().formats.at(sender);
  if (format == nullptr) throw std::logic_error("the protocol has no frames of this sender");
  return format;
}

const std::uint8_t* give(const Node& node) {
  result.clear();
  pack(node, result);
  return result.data();
}

std::vector<std::uint8_t> frame_of(unsigned sender, const Node& asked) {
  const FormatTable& format = *format_of(sender);
  const auto index = asked[0].as<std::size_t>();
  const GivenHeader header = encode_header<NodeValues>(format, asked[2]);
  const MessageTable& message = session->protocol->messages().at(index);
  return seal_frame(format, *session->protocol, index, encode_fields<NodeValues>(message, asked[1]), header);
}

Node to_node(const Batch& batch, const Event& event) {
  const std::uint8_t* const bytes = batch.bytes.data();
  Node::Map out{{"t", event.time}, {"offset", event.offset}, {"id", event.id}};
  const std::uint8_t* const wire = bytes + event.wire_at;
  out.emplace_back("raw", Node::Bytes(wire, wire + event.wire_size));
  const std::uint64_t* const header = batch.headers.data() + event.header_at;
  out.emplace_back("header", decode_header<NodeValues>(*batch.format, event.form, header));
  if (event.message < 0) {
    out.emplace_back("name", "unknown");
    out.emplace_back("fields", Node::Map{});
    out.emplace_back("violations", Node::List{});
    return Node(std::move(out));
  }
  const MessageTable& message = batch.protocol->messages()[static_cast<std::size_t>(event.message)];
  const std::uint8_t* const payload = bytes + event.payload_at;
  out.emplace_back("name", message.name);
  out.emplace_back("sender", message.sender);
  out.emplace_back("fields", decode_fields<NodeValues>(message, payload, event.payload_size));
  std::vector<std::string> found = find_violations(message, payload, event.payload_size);
  add_header_violations(*batch.format, event.form, header, found);
  Node::List violations;
  for (std::string& one : found) violations.emplace_back(std::move(one));
  out.emplace_back("violations", std::move(violations));
  return Node(std::move(out));
}

namespace {

std::shared_ptr<const FormatTable> format_from(const Node& tables, const char* sender) {
  const Node& table = tables[sender];
  if (table.is_none()) return nullptr;
  return std::make_shared<FormatTable>(unpacked(table.bytes().data(), table.bytes().size()));
}

Node to_list(const Arrivals& arrivals) {
  Node::List out;
  for (const Event& event : arrivals.events) out.push_back(to_node(*arrivals.batch, event));
  return Node(std::move(out));
}

Decoder& decoder_of(unsigned sender) {
  auto& decoder = open_session().decoders.at(sender);
  if (decoder == nullptr) {
    decoder = std::make_unique<Decoder>(session->protocol, format_of(sender), session->idle_seconds);
  }
  return *decoder;
}

Follower& follower_of(unsigned sender) {
  auto& follower = open_session().followers.at(sender);
  if (follower == nullptr) {
    follower = std::make_unique<Follower>(session->protocol, format_of(sender), session->idle_seconds);
  }
  return *follower;
}

/// Ignores values that are not numbers: a page reads those from single messages.
struct NothingKept {
  void value(std::size_t, const FieldTable& field, std::size_t place, std::uint64_t promised, Walk& walk) {
    static_cast<void>(decode_field<NodeValues>(field, place, promised, walk));
  }
  void none(std::size_t) {}
};

std::size_t address_of(const void* memory) { return reinterpret_cast<std::size_t>(memory); }

/// Return the columns of each message, with the memory of earlier rows.
std::vector<MessageColumns>& open_columns() {
  if (open_session().columns.empty()) {
    for (const MessageTable& message : session->protocol->messages()) {
      MessageColumns& of = session->columns.emplace_back();
      of.columns = columns_of(message);
      of.values.resize(of.columns.size());
    }
  }
  return session->columns;
}

void fill(const MessageTable& message, const Rows& rows, MessageColumns& of) {
  for (Column& column : of.columns) {
    column.places.clear();
    column.numbers.clear();
  }
  NothingKept nothing;
  read_rows(message, rows, of.columns, nothing);
  for (std::size_t i = 0; i < of.columns.size(); ++i) {
    Column& column = of.columns[i];
    if (column.holds_values()) continue;
    const FieldTable& field = *column.field;
    std::vector<double>& values = of.values[i];
    if (field.digits) {
      values = column.numbers;
      continue;
    }
    values.resize(rows.offsets.size() * field.count);
    if (column.may_lack) std::fill(values.begin(), values.end(), std::numeric_limits<double>::quiet_NaN());
    const auto number = [&](std::uint64_t bits) { return value_of(field, bits); };
    const auto truth = [](std::uint64_t bits) { return bits != 0 ? 1.0 : 0.0; };
    if (field.kind == FieldKind::boolean) {
      fill_column(column, rows, message.min_payload, values.data(), truth);
    } else {
      fill_column(column, rows, message.min_payload, values.data(), number);
    }
  }
}

void put(std::size_t word) {
  const auto number = static_cast<std::uint32_t>(word);
  const auto* const bytes = reinterpret_cast<const std::uint8_t*>(&number);
  result.insert(result.end(), bytes, bytes + sizeof number);
}

/// Describe the rows of the last call in words of 32 bits: for each message with rows its index (of unknown ones the
/// number of messages), their number, the addresses of their times (doubles, seconds), of their offsets in all bytes
/// (64 bits), of their sizes on the wire (32 bits), and of its columns (doubles) in the order of `columns`.
const std::uint8_t* rows_as_words() {
  result.clear();
  const std::size_t known = session->rows.messages.size();
  for (std::size_t i = 0; i <= known; ++i) {
    const Rows& rows = i < known ? session->rows.messages[i] : session->rows.unknown;
    if (rows.offsets.empty()) continue;
    put(i);
    put(rows.offsets.size());
    put(address_of(rows.times.data()));
    put(address_of(rows.offsets.data()));
    put(address_of(rows.sizes.data()));
    if (i == known) continue;
    MessageColumns& of = open_columns()[i];
    fill(session->protocol->messages()[i], rows, of);
    for (std::size_t column = 0; column < of.columns.size(); ++column) {
      if (!of.columns[column].holds_values()) put(address_of(of.values[column].data()));
    }
  }
  return result.data();
}

}  // namespace

extern "C" {

/// Return the address of `size` bytes for the next call.
WIREBOND_EXPORT(input) std::uint8_t* wirebond_input(std::size_t size) {
  input.resize(size);
  return input.data();
}

WIREBOND_EXPORT(result_size) std::size_t wirebond_result_size() { return result.size(); }

/// Input: a map of `protocol`, `mcu`, `host`, `either` (tables in bytes; none: there is none) and `idle_seconds`. Ends
/// the session that was open.
WIREBOND_EXPORT(open) const std::uint8_t* wirebond_open() {
  return answered([] {
    const Node tables = given();
    auto opened = std::make_unique<Session>();
    const Node::Bytes& protocol = tables["protocol"].bytes();
    opened->protocol = std::make_shared<ProtocolTable>(unpacked(protocol.data(), protocol.size()));
    for (std::size_t i = 0; i < sender_names.size(); ++i) opened->formats[i] = format_from(tables, sender_names[i]);
    opened->idle_seconds = tables["idle_seconds"].as<double>();
    session = std::move(opened);
    return Node();
  });
}

// ---- single messages

/// Input: bytes. Result: the messages that they completed.
WIREBOND_EXPORT(feed) const std::uint8_t* wirebond_feed(unsigned sender, double t) {
  return answered([&] { return to_list(decoder_of(sender).feed(input.data(), input.size(), t * 1e-6)); });
}

WIREBOND_EXPORT(idle) const std::uint8_t* wirebond_idle(unsigned sender, double t) {
  return answered([&] { return to_list(decoder_of(sender).idle(t * 1e-6)); });
}

WIREBOND_EXPORT(finish) const std::uint8_t* wirebond_finish(unsigned sender) {
  return answered([&] { return to_list(decoder_of(sender).finish()); });
}

/// From now on this message is meant, where several have one id; -1: none.
WIREBOND_EXPORT(expect) const std::uint8_t* wirebond_expect(unsigned sender, int message) {
  return answered([&] {
    decoder_of(sender).expect(static_cast<std::int16_t>(message), -1, std::nullopt);
    return Node();
  });
}

WIREBOND_EXPORT(account) const std::uint8_t* wirebond_account(unsigned sender) {
  return answered([&] { return decoder_of(sender).account(); });
}

/// Forget the state of this sender's decoder and follower.
WIREBOND_EXPORT(restart) const std::uint8_t* wirebond_restart(unsigned sender) {
  return answered([&] {
    open_session().decoders.at(sender) = nullptr;
    open_session().followers.at(sender) = nullptr;
    return Node();
  });
}

/// Input: a list of the message's index, its values by name, and header values by name. Result: the frame.
WIREBOND_EXPORT(encode) const std::uint8_t* wirebond_encode(unsigned sender) {
  return answered([&] { return Node(frame_of(sender, given())); });
}

/// Input: header values by name. Result: the bits of each header field.
WIREBOND_EXPORT(header_bits) const std::uint8_t* wirebond_header_bits(unsigned sender) {
  return answered([&] {
    const FormatTable& format = *format_of(sender);
    const GivenHeader bits = encode_header<NodeValues>(format, given());
    Node::List out;
    for (std::size_t i = 0; i < format.header().size(); ++i) out.emplace_back(bits.values[i]);
    return Node(std::move(out));
  });
}

/// Input: the bytes of one frame. Result: the messages in it, as if it had come alone. `expected`: the message that is
/// meant, where several have one id; -1: none.
WIREBOND_EXPORT(read) const std::uint8_t* wirebond_read(unsigned sender, double t, int expected) {
  return answered([&] {
    Decoder alone(open_session().protocol, format_of(sender), session->idle_seconds);
    if (expected >= 0) alone.expect(static_cast<std::int16_t>(expected), -1, std::nullopt);
    Node::List out;
    for (const Arrivals& arrivals : {alone.feed(input.data(), input.size(), t * 1e-6), alone.finish()}) {
      for (const Event& event : arrivals.events) out.push_back(to_node(*arrivals.batch, event));
    }
    return Node(std::move(out));
  });
}

/// Input: the bytes of one frame. Result: a map of `message`, `form` (its number), `payload` (see payload_on_wire:
/// place and size, or null) and `spans` (see spans_of), each a list of name, level, place and size; if the bytes are no
/// frame, a map of `account`, whose causes say why.
WIREBOND_EXPORT(explain) const std::uint8_t* wirebond_explain(unsigned sender, int expected) {
  return answered([&] {
    Decoder alone(open_session().protocol, format_of(sender), session->idle_seconds);
    if (expected >= 0) alone.expect(static_cast<std::int16_t>(expected), -1, std::nullopt);
    for (const Arrivals& arrivals : {alone.feed(input.data(), input.size(), 0), alone.finish()}) {
      if (arrivals.events.empty()) continue;
      const Event& event = arrivals.events.front();
      Node::List spans;
      for (Span& span : spans_of(*arrivals.batch, event)) {
        spans.push_back(Node::List{std::move(span.name), span.level, span.at, span.size});
      }
      const std::optional<Place> place = payload_on_wire(*arrivals.batch, event);
      Node payload;
      if (place) payload = Node::List{place->at, place->size};
      return Node(Node::Map{{"message", to_node(*arrivals.batch, event)},
                            {"form", event.form},
                            {"payload", std::move(payload)},
                            {"spans", std::move(spans)}});
    }
    return Node(Node::Map{{"account", alone.account()}});
  });
}

// ---- many messages

/// Result: by message the columns of its numbers: a list of names, and how many numbers there are in each row.
WIREBOND_EXPORT(columns) const std::uint8_t* wirebond_columns() {
  return answered([] {
    Node::List out;
    for (const MessageColumns& of : open_columns()) {
      Node::List names;
      for (const Column& column : of.columns) {
        if (column.holds_values()) continue;
        names.push_back(Node::List{column.name, column.field->digits ? 1u : column.field->count});
      }
      out.emplace_back(std::move(names));
    }
    return Node(std::move(out));
  });
}

/// Input: for each of `count` reads when it began (a double), then for each where it ends in the bytes (a double), then
/// the bytes. Result: see `rows_as_words`; the addresses are good until the next call.
WIREBOND_EXPORT(follow) const std::uint8_t* wirebond_follow(unsigned sender, std::size_t count) {
  std::vector<double> numbers(2 * count);
  std::memcpy(numbers.data(), input.data(), numbers.size() * sizeof(double));
  std::vector<std::uint64_t> ends(count);
  for (std::size_t i = 0; i < count; ++i) {
    numbers[i] *= 1e-6;
    ends[i] = us(numbers[count + i]);
  }
  Reads reads;
  reads.ends = ends.data();
  reads.times = numbers.data();
  reads.count = count;
  Follower& follower = follower_of(sender);
  session->rows = follower.feed(input.data() + numbers.size() * sizeof(double), reads);
  return rows_as_words();
}

/// The port was closed here. Result: see `rows_as_words`.
WIREBOND_EXPORT(follow_break) const std::uint8_t* wirebond_follow_break(unsigned sender) {
  Reads reads;
  reads.breaks = {0};
  session->rows = follower_of(sender).feed(nullptr, reads);
  return rows_as_words();
}

/// The next frame answers a request: this message is meant, where several have one id.
WIREBOND_EXPORT(follow_expect) void wirebond_follow_expect(unsigned sender, int message) {
  Reads reads;
  reads.expected = {{0, static_cast<std::int16_t>(message)}};
  follower_of(sender).feed(nullptr, reads);
}

/// How many bytes are settled: later ones may become a frame.
WIREBOND_EXPORT(settled) double wirebond_settled(unsigned sender) {
  return static_cast<double>(follower_of(sender).settled());
}

/// A read that began at `t` found nothing. Result: see `rows_as_words`.
WIREBOND_EXPORT(follow_idle) const std::uint8_t* wirebond_follow_idle(unsigned sender, double t) {
  Follower& follower = follower_of(sender);
  session->rows = follower.idle(t * 1e-6);
  return rows_as_words();
}

}  // extern "C"

}  // namespace wirebond::engine
