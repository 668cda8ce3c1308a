// The engine as a WebAssembly module: one protocol, a decoder and a follower for each end, and the host's link.
//
// JavaScript gives bytes in `input`, and every function answers with a result: a MessagePack value at the address that
// it returns, of `result_size` bytes, until the next call. It is a map with `ok`, or with `error` (`message`: a value
// is refused; `engine`: our own mistake) and `text`. Times are microseconds as doubles, of a clock that never steps
// back. One file: each export is one call of the engine.
#include <algorithm>
#include <array>
#include <cstddef>
#include <cstdint>
#include <exception>
#include <limits>
#include <memory>
#include <stdexcept>
#include <string>
#include <utility>
#include <vector>

#include "wirebond/engine/account.hpp"
#include "wirebond/engine/columns.hpp"
#include "wirebond/engine/decoder.hpp"
#include "wirebond/engine/follower.hpp"
#include "wirebond/engine/header.hpp"
#include "wirebond/engine/link_core.hpp"
#include "wirebond/engine/node_values.hpp"

#define WIREBOND_EXPORT(name) __attribute__((export_name(#name)))

namespace wirebond::engine {

namespace {

/// Whose frames: the index of a format.
enum Sender : unsigned { mcu, host, either };
constexpr std::array<const char*, 3> sender_names = {"mcu", "host", "either"};

/// The numbers in the rows of one message.
struct MessageColumns {
  std::vector<Column> columns;
  std::vector<std::vector<double>> values;  ///< of each column
};

/// Everything of one protocol.
struct Session {
  std::shared_ptr<const ProtocolTable> protocol;
  std::array<std::shared_ptr<const FormatTable>, sender_names.size()> formats;  ///< null: the file has none
  double idle_seconds = 0;
  std::array<std::unique_ptr<Decoder>, sender_names.size()> decoders;
  std::array<std::unique_ptr<Follower>, sender_names.size()> followers;
  Capture rows;                         ///< of the last call of a follower
  std::vector<MessageColumns> columns;  ///< made of them, by message
  std::unique_ptr<LinkCore> link;
};

std::vector<std::uint8_t> input;
std::vector<std::uint8_t> result;
std::unique_ptr<Session> session;

std::uint64_t us(double time) { return time < 0 ? 0 : static_cast<std::uint64_t>(time); }

Session& open_session() {
  if (session == nullptr) throw std::logic_error("no protocol is open");
  return *session;
}

LinkCore& open_link() {
  if (open_session().link == nullptr) throw std::logic_error("no link is open");
  return *session->link;
}

const std::shared_ptr<const FormatTable>& format_of(unsigned sender) {
  const auto& format = open_session().formats.at(sender);
  if (format == nullptr) throw std::logic_error("the protocol has no frames of this sender");
  return format;
}

/// Call `work`, and keep what it returns or throws as the result.
template <class Work>
const std::uint8_t* answered(Work work) {
  Node answer;
  try {
    answer = Node::Map{{"ok", work()}};
  } catch (const MessageError& refused) {
    answer = Node::Map{{"error", "message"}, {"text", refused.what()}};
  } catch (const std::exception& mistake) {
    answer = Node::Map{{"error", "engine"}, {"text", mistake.what()}};
  }
  result.clear();
  pack(answer, result);
  return result.data();
}

Node given() { return unpacked(input.data(), input.size()); }

std::shared_ptr<const FormatTable> format_from(const Node& tables, const char* sender) {
  const Node& table = tables[sender];
  if (table.is_none()) return nullptr;
  return std::make_shared<FormatTable>(unpacked(table.bytes().data(), table.bytes().size()));
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

/// Ignores what is no number: a page reads that from single messages.
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

/// Describe the rows of the last call in words of 32 bits: for each message with rows its index, their number, the
/// address of their times (doubles, seconds), and the addresses of its columns (doubles) in the order of `columns`.
const std::uint8_t* rows_as_words() {
  result.clear();
  for (std::size_t i = 0; i < session->rows.messages.size(); ++i) {
    const Rows& rows = session->rows.messages[i];
    if (rows.offsets.empty()) continue;
    MessageColumns& of = open_columns()[i];
    fill(session->protocol->messages()[i], rows, of);
    put(i);
    put(rows.offsets.size());
    put(address_of(rows.times.data()));
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
/// what was open.
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

/// Forget what the decoder and the follower of this sender have seen.
WIREBOND_EXPORT(restart) const std::uint8_t* wirebond_restart(unsigned sender) {
  return answered([&] {
    open_session().decoders.at(sender) = nullptr;
    open_session().followers.at(sender) = nullptr;
    return Node();
  });
}

/// Input: a list of the message's index, its values by name, and header values by name. Result: the frame.
WIREBOND_EXPORT(encode) const std::uint8_t* wirebond_encode(unsigned sender) {
  return answered([&] {
    const Node asked = given();
    const FormatTable& format = *format_of(sender);
    const auto index = asked[0].as<std::size_t>();
    const GivenHeader header = encode_header<NodeValues>(format, asked[2]);
    return Node(seal_frame(format, *session->protocol, index,
                           encode_fields<NodeValues>(session->protocol->messages().at(index), asked[1]), header));
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

/// Input: bytes of one read. Result: see `rows_as_words`; the addresses are good until the next call.
WIREBOND_EXPORT(follow) const std::uint8_t* wirebond_follow(unsigned sender, double t) {
  const std::uint64_t end = input.size();
  const double time = t * 1e-6;
  Reads reads;
  reads.ends = &end;
  reads.times = &time;
  reads.count = 1;
  Follower& follower = follower_of(sender);
  session->rows = follower.feed(input.data(), reads);
  return rows_as_words();
}

/// A read found nothing.
WIREBOND_EXPORT(follow_idle) const std::uint8_t* wirebond_follow_idle(unsigned sender, double t) {
  Follower& follower = follower_of(sender);
  session->rows = follower.idle(t * 1e-6);
  return rows_as_words();
}

// ---- the host's link

/// Input: the settings, as `EngineSettings` of Python has them.
WIREBOND_EXPORT(link_open) const std::uint8_t* wirebond_link_open(double now) {
  return answered([&] {
    const Node settings = given();
    const auto& receive = format_of(mcu);
    open_session().link =
        std::make_unique<LinkCore>(link_setup(session->protocol, receive, format_of(host), settings), us(now));
    return Node();
  });
}

WIREBOND_EXPORT(port_up) void wirebond_port_up(double now) { open_link().port_up(us(now)); }

/// Input: why, as a text in UTF-8.
WIREBOND_EXPORT(port_down) void wirebond_port_down(double now) {
  open_link().port_down(us(now), std::string(input.begin(), input.end()));
}

/// Input: the bytes of a read that began at `before` and ended at `after`.
WIREBOND_EXPORT(received) void wirebond_received(double before, double after) {
  open_link().received(input.data(), input.size(), us(before), us(after), true);
}

WIREBOND_EXPORT(link_idle) void wirebond_link_idle(double began) { open_link().idle(us(began)); }

WIREBOND_EXPORT(poll) void wirebond_poll(double now) { open_link().poll(us(now)); }

/// When to call `poll` and `to_write` again; infinite: only bytes matter.
WIREBOND_EXPORT(next_due) double wirebond_next_due(double now) {
  const std::uint64_t due = open_link().next_due(us(now));
  return due == ~std::uint64_t{0} ? std::numeric_limits<double>::infinity() : static_cast<double>(due);
}

/// Result: the bytes that may be written now. Without a value: just the address, and `result_size`.
WIREBOND_EXPORT(to_write) const std::uint8_t* wirebond_to_write(double now, int together) {
  const Outgoing out = open_link().to_write(us(now), together != 0);
  result.assign(out.bytes, out.bytes + out.size);
  return result.data();
}

WIREBOND_EXPORT(written) void wirebond_written(std::size_t size, double now) { open_link().written(size, us(now)); }

/// Input: as for `encode`, then the index of the reply (-1: none), whether it takes its sequence number as it leaves,
/// its address (bits on the wire), and seconds of a lease (0: it is sent once). Result: 0 to 3, in the order of
/// SendResult.
WIREBOND_EXPORT(send) const std::uint8_t* wirebond_send(double now) {
  return answered([&] {
    const Node asked = given();
    const FormatTable& format = *format_of(host);
    const auto index = asked[0].as<std::size_t>();
    const GivenHeader header = encode_header<NodeValues>(format, asked[2]);
    const std::vector<std::uint8_t> frame =
        seal_frame(format, *session->protocol, index,
                   encode_fields<NodeValues>(session->protocol->messages().at(index), asked[1]), header);
    const auto message = static_cast<std::int16_t>(index);
    const auto reply = asked[3].as<std::int16_t>();
    const bool takes_number = asked[4].as<bool>();
    const auto address = asked[5].as<std::uint64_t>();
    const double hold = asked[6].as<double>();
    LinkCore& link = open_link();
    const SendResult sent =
        hold == 0 ? link.outbox().send(message, frame.data(), frame.size(), reply, takes_number, us(now), address)
                  : link.outbox().repeat(message, frame.data(), frame.size(), reply, takes_number, to_us(hold), us(now),
                                         address);
    link.note_changes(us(now));
    return Node(answer_of(sent));
  });
}

/// Input: a safe value, in the order of `SafeValue` of Python. Result: false if there is no room.
WIREBOND_EXPORT(note_safe) const std::uint8_t* wirebond_note_safe() {
  return answered([] { return Node(open_link().note_safe(stop_frame(given()))); });
}

WIREBOND_EXPORT(end_safely) int wirebond_end_safely(int message, double address) {
  return open_link().outbox().end_safely(static_cast<std::int16_t>(message), static_cast<std::uint64_t>(address));
}

WIREBOND_EXPORT(end_motion) void wirebond_end_motion() { open_link().outbox().end_motion(); }

WIREBOND_EXPORT(stop) void wirebond_stop(double now) {
  open_link().outbox().stop(us(now));
  open_link().note_changes(us(now), "stopped");
}

WIREBOND_EXPORT(release_stop) void wirebond_release_stop() { open_link().outbox().release_stop(); }

WIREBOND_EXPORT(is_stopped) int wirebond_is_stopped() { return open_link().outbox().is_stopped(); }

/// End leases with their safe values, and accept nothing more. What is queued may still leave.
WIREBOND_EXPORT(close) void wirebond_close() { open_link().outbox().close(); }

WIREBOND_EXPORT(is_empty) int wirebond_is_empty() { return open_link().outbox().is_empty(); }

/// 0 to 2, in the order of HostLinkState.
WIREBOND_EXPORT(state) int wirebond_state(double now) { return static_cast<int>(open_link().link().state(us(now))); }

/// Result: messages since the last call.
WIREBOND_EXPORT(receive) const std::uint8_t* wirebond_receive() {
  return answered([] {
    Node::List out;
    for (const Arrivals& arrivals : open_link().take()) {
      for (const Event& event : arrivals.events) out.push_back(to_node(*arrivals.batch, event));
    }
    return Node(std::move(out));
  });
}

/// Result: see `account_node`.
WIREBOND_EXPORT(link_account) const std::uint8_t* wirebond_link_account() {
  return answered([] {
    LinkCore& link = open_link();
    return account_node(link.account(), link.protocol(), link.receives());
  });
}

}  // extern "C"

}  // namespace wirebond::engine
