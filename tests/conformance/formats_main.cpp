// Decodes streams of many generated protocols, and reads, validates and writes the fields of what it finds. For tests
// that compare this with the engine and with the slow decoder; formats.py compiles it.
//
//   formats FILE
//
// FILE holds jobs, all numbers little-endian: u32 row of formats.hpp, u32 sender (0 host, 1 MCU), u32 whether an own
// address is set, u64 that address, u32 number of chunks; for each chunk u64 time in microseconds, u32 size and its
// bytes.
//
// Lines for each job: `job`; for each frame `frame …` as print.hpp says, `addressee NUMBER` where frames name their
// receiver and, where it carries a message, `rules REJECTED CLAMPED WRONG_COUNT` (0 or 1 each), then for what is handed
// over `values …` and `again …`: the frame that encode gives for these values, or `refused`; and where frames have
// header fields `with_header …`, that with the received header. Then the account, with `foreign` and `sequence.…`.
// Behind all jobs, for each message of each protocol: `default ROW INDEX …`, the frame of a struct that nobody has
// touched, or `refused`.
//
// A deframer takes long to compile for a constant format. So all protocols but a few share one: it takes the constant's
// way through the core, and its source asks the generated one for everything.
#include <array>
#include <cstdio>
#include <type_traits>
#include <utility>
#include <vector>

#include "print.hpp"
#include "wirebond/address.hpp"
#include "wirebond/bounded.hpp"
#include "wirebond/encoder.hpp"
#include "wirebond/list.hpp"
#include "wirebond/message.hpp"
#include "wirebond/sequence.hpp"
#include "wirebond/stream_deframer.hpp"

namespace conformance {

// ---- values: numbers, those of varying number with their size before them

inline void show(float value) { std::printf(" %a", static_cast<double>(value)); }
inline void show(double value) { std::printf(" %a", value); }

template <class Number>
std::enable_if_t<std::is_integral_v<Number> || std::is_enum_v<Number>> show(Number value) {
  if constexpr (std::is_enum_v<Number>) {
    show(static_cast<std::underlying_type_t<Number>>(value));
  } else if constexpr (std::is_same_v<Number, char>) {
    std::printf(" %u", static_cast<unsigned>(static_cast<unsigned char>(value)));
  } else if constexpr (std::is_signed_v<Number>) {
    std::printf(" %lld", static_cast<long long>(value));
  } else {
    std::printf(" %llu", static_cast<unsigned long long>(value));
  }
}

template <class Element, std::size_t Size>
void show(const std::array<Element, Size>& values) {
  for (const Element& value : values) show(value);
}

template <class Element, std::size_t Capacity>
void show(const wirebond::Bounded<Element, Capacity>& text) {
  std::printf(" #%u", static_cast<unsigned>(text.size));
  for (const Element letter : text.view()) show(letter);
}

template <class Element, std::size_t Capacity>
void show(const wirebond::List<Element, Capacity>& values) {
  std::printf(" #%u", static_cast<unsigned>(values.size));
  for (const Element& value : values) show(value);
}

// ---- sources

/// Any generated source: what that one tells at compile time, told at run time.
struct SharedSource {
  static constexpr bool is_constant = true;  // the way through the core that a microcontroller takes

  const wirebond::FrameFormat& format() const { return *format_; }
  wirebond::MessageShape message(std::uint32_t id) const { return message_(id); }
  wirebond::PayloadRules payload_rules(std::int16_t index) const { return payload_rules_(index); }
  bool matches() const { return match_ != nullptr; }
  bool matches_late() const { return matches_late_; }
  wirebond::MessageShape match(const wirebond::detail::Asked<SharedSource>& asked) const { return match_(asked); }
  std::uint64_t check_update(unsigned algorithm, std::uint64_t reg, const std::uint8_t* bytes, std::size_t size) const {
    return check_update_(algorithm, reg, bytes, size);
  }

  const wirebond::FrameFormat* format_;
  wirebond::MessageShape (*message_)(std::uint32_t);
  wirebond::PayloadRules (*payload_rules_)(std::int16_t);
  std::uint64_t (*check_update_)(unsigned, std::uint64_t, const std::uint8_t*, std::size_t);
  wirebond::MessageShape (*match_)(const wirebond::detail::Asked<SharedSource>&);  // null: ids tell all messages
  bool matches_late_;
};

using Match = wirebond::MessageShape (*)(const wirebond::detail::Asked<SharedSource>&);

template <class Generated>
Match match_of() {
  if constexpr (wirebond::detail::HasMatch<Generated>::value) {
    return [](const wirebond::detail::Asked<SharedSource>& asked) { return Generated{}.match(asked); };
  } else {
    return nullptr;
  }
}

template <class Generated>
SharedSource shared() {
  static const wirebond::FrameFormat format = wirebond::widened(Generated{}.format());
  return {&format,
          [](std::uint32_t id) { return Generated{}.message(id); },
          [](std::int16_t index) -> wirebond::PayloadRules {
            if constexpr (wirebond::detail::HasPayloadRules<Generated>::value) return Generated{}.payload_rules(index);
            static_cast<void>(index);
            return {};
          },
          [](unsigned algorithm, std::uint64_t reg, const std::uint8_t* bytes, std::size_t size) {
            return Generated{}.check_update(algorithm, reg, bytes, size);
          },
          match_of<Generated>(),
          wirebond::detail::does_match_late(Generated{})};
}

std::size_t seal_shared(const SharedSource& source, std::uint8_t* out, std::size_t capacity, std::uint32_t id,
                        std::size_t payload, std::size_t form) {
  return wirebond::seal(source, out, capacity, id, payload, form);
}

std::size_t seal_with_header(const SharedSource& source, std::uint8_t* out, std::size_t capacity, std::uint32_t id,
                             std::size_t payload, std::size_t form, const std::uint64_t* numbers) {
  return wirebond::seal(source, out, capacity, id, payload, form, numbers);
}

/// Does the generated `encode` do without being told the end? Not for a message of both where their frames differ.
template <class Message, class = void>
struct EncodesAlone : std::false_type {};
template <class Message>
struct EncodesAlone<Message, std::void_t<decltype(encode(std::declval<const Message&>(), std::declval<std::uint8_t*>(),
                                                         std::size_t{}, std::declval<std::size_t&>()))>>
    : std::true_type {};

/// The frame's size, with these header values as far as the message's frames have them; 0: refused.
template <class Generated, class Message>
std::size_t settled_frame(const Message& message, std::vector<std::uint8_t>& out, std::size_t payload,
                          const wirebond::detail::HeaderNumbers<Generated>& given) {
  const SharedSource source = shared<Generated>();
  auto numbers = wirebond::detail::numbers_to_settle<Generated>(given);
  if constexpr (wirebond::detail::must_settle<Generated, Message>) {
    if (!wirebond::detail::settle_match<Generated, Message>(numbers)) return 0;
  }
  const std::uint32_t id = wirebond::detail::id_of<Message>(numbers);
  std::size_t size = 0;
  const auto write = [&](std::size_t form) {
    std::uint8_t* const at = out.data() + wirebond::payload_lead(source, form);
    if (!write_payload(message, at) || !wirebond::detail::payload_matches<Message>(at, payload)) return;
    size = seal_with_header(source, out.data(), out.size(), id, payload, form, numbers.data());
  };
  const wirebond::HeaderValues values = wirebond::detail::values_of<Generated>(numbers);
  wirebond::detail::with_own_form(source, id, payload, write, values);
  return size;
}

/// The frame of a message, as the generated encode gives it; nothing where it refuses.
template <bool Folded, class Generated, class Message>
std::vector<std::uint8_t> frame_of(const Message& message) {
  std::vector<std::uint8_t> out(Message::Info::max_frame_bytes);
  std::size_t size = 0;
  if constexpr (Folded) {
    wirebond::Status status;
    if constexpr (EncodesAlone<Message>::value) {
      status = encode(message, out.data(), out.size(), size);
    } else {
      status = wirebond::encode_frame<Generated>(message, out.data(), out.size(), size);
    }
    if (status != wirebond::Status::ok) size = 0;
  } else {
    const SharedSource source = shared<Generated>();
    const std::size_t payload = payload_bytes(message);
    const bool fits = payload <= Message::Info::max_payload_bytes;
    if constexpr (wirebond::detail::must_settle<Generated, Message>) {
      if (fits) size = settled_frame<Generated>(message, out, payload, wirebond::detail::default_numbers<Generated>);
    } else {
      const auto write = [&](std::size_t form) {
        std::uint8_t* const at = out.data() + wirebond::payload_lead(source, form);
        if (!write_payload(message, at) || !wirebond::detail::payload_matches<Message>(at, payload)) return;
        size = seal_shared(source, out.data(), out.size(), Message::Info::id, payload, form);
      };
      if (fits) wirebond::detail::with_own_form(source, Message::Info::id, payload, write);
    }
  }
  out.resize(size);
  return out;
}

/// The same with a header: the frame in the form that its values ask for.
template <bool Folded, class Generated, class Message, class Header>
std::vector<std::uint8_t> frame_of(const Message& message, const Header& header) {
  std::vector<std::uint8_t> out(Message::Info::max_frame_bytes);
  std::size_t size = 0;
  if constexpr (Folded) {
    const auto status = wirebond::encode_frame<Generated>(message, out.data(), out.size(), size, header);
    if (status != wirebond::Status::ok) size = 0;
  } else {
    const std::size_t payload = payload_bytes(message);
    wirebond::detail::HeaderNumbers<Generated> numbers;
    if (payload <= Message::Info::max_payload_bytes && write_header(header, numbers.data())) {
      size = settled_frame<Generated>(message, out, payload, numbers);
    }
  }
  out.resize(size);
  return out;
}

inline void print_again(const std::vector<std::uint8_t>& frame) {
  print_hex(frame.data(), frame.size());
  std::puts(frame.empty() ? "refused" : "");
}

// ---- jobs

struct Chunk {
  std::uint64_t time_us = 0;
  std::vector<std::uint8_t> bytes;  // of its own, so that overruns are seen
};

using Chunks = std::vector<Chunk>;

struct Job {
  bool sets_address = false;
  std::uint64_t address = 0;
  Chunks chunks;
};

/// What `Receiver` asks about each frame: whom it is for, and which ones are missing before it.
template <class Generated>
class Ear : public wirebond::Listening<Generated>, public wirebond::SequenceWatch<Generated> {
 public:
  void take(const wirebond::Frame& frame) {
    this->note(frame);
    heard_ += this->hears(frame) ? 1 : 0;
    if constexpr (wirebond::names_receiver<Generated>) {
      std::printf("addressee %u\n", static_cast<unsigned>(this->addressee()));
    }
  }

  void print() const {
    const auto& sequence = this->sequence();
    std::printf("heard %u\nforeign %u\n", heard_, static_cast<unsigned>(this->foreign()));
    std::printf("sequence.numbered %u\nsequence.gaps %u\n", sequence.numbered, sequence.gaps);
    std::printf("sequence.repeats %u\nsequence.restarts %u\n", sequence.repeats, sequence.restarts);
  }

 private:
  unsigned heard_ = 0;
};

/// Of the job that runs: a sink of the shared deframer is a plain function.
template <class Generated>
inline Ear<Generated>* ear = nullptr;

template <class Source, class Sink>
bool decode(const Source& source, std::uint64_t idle_us, const Chunks& chunks, const Sink& sink) {
  std::vector<std::uint8_t> workspace(wirebond::workspace_bytes(source));
  wirebond::StreamDeframer<Source, std::uint64_t> deframer(source, workspace.data(), idle_us);
  for (const Chunk& chunk : chunks) {
    deframer.feed(chunk.bytes.data(), chunk.bytes.size(), chunk.time_us, sink);
    if (!account_closes(deframer)) return false;
  }
  deframer.give_up(sink);
  print_account(deframer);
  return true;
}

using Dispatch = void (*)(const wirebond::Frame&);

struct SharedSink {
  Dispatch dispatch;
  void operator()(const wirebond::Frame& frame) const { dispatch(frame); }
};

bool decode_shared(const SharedSource& source, std::uint64_t idle_us, const Chunks& chunks, Dispatch dispatch) {
  return decode(source, idle_us, chunks, SharedSink{dispatch});
}

/// Which source's frames a message's encode gives: those of the MCU's own messages, else of the host's.
template <class Host, class Mcu, class Message>
using SourceOf = std::conditional_t<Message::Info::sender == wirebond::End::mcu, Mcu, Host>;

/// Tells apart what is handed over; the lines are printed when the rules were counted.
template <bool Folded, class Generated, class Host, class Mcu>
struct Handler {
  std::vector<std::uint8_t> again;
  std::vector<std::uint8_t> with_header;
  bool handed = false;
  bool has_header = false;

  template <class Message>
  void on(const Message& message) {
    handed = true;
    again = frame_of<Folded, SourceOf<Host, Mcu, Message>>(message);
    std::printf("values");
    show(message);
    std::puts("");
  }

  template <class Message, class Header>
  void on(const Message& message, const Header& header) {
    on(message);
    has_header = true;
    with_header = frame_of<Folded, Generated>(message, header);
  }
};

template <bool Folded, class Generated, class Host, class Mcu>
void print_message(const wirebond::Frame& frame) {
  print_frame(frame);
  ear<Generated>->take(frame);
  if (frame.message < 0) return;
  wirebond::Violations counts;
  Handler<Folded, Generated, Host, Mcu> handler;
  Generated::dispatch(frame, handler, counts);
  if (handler.handed) {
    std::printf("again ");
    print_again(handler.again);
  }
  if (handler.has_header) {
    std::printf("with_header ");
    print_again(handler.with_header);
  }
  std::printf("rules %u %u %u\n", counts.rejected, counts.clamped, counts.wrong_count);
}

template <bool Folded, class Generated, class Host, class Mcu>
bool run(const Job& job) {
  Ear<Generated> listener;
  if constexpr (wirebond::names_receiver<Generated>) {
    if (job.sets_address && !listener.set_address(static_cast<typename Generated::Address>(job.address))) return false;
  }
  ear<Generated> = &listener;
  bool closes = false;
  if constexpr (Folded) {
    closes = decode(Generated{}, Generated::idle_us, job.chunks, print_message<Folded, Generated, Host, Mcu>);
  } else {
    closes =
        decode_shared(shared<Generated>(), Generated::idle_us, job.chunks, print_message<Folded, Generated, Host, Mcu>);
  }
  listener.print();
  return closes;
}

template <bool Folded, class Host, class Mcu, class... Messages>
void print_defaults(unsigned row) {
  const auto print = [row](const auto& message) {
    using Message = std::decay_t<decltype(message)>;
    std::printf("default %u %d ", row, Message::Info::index);
    print_again(frame_of<Folded, SourceOf<Host, Mcu, Message>>(message));
  };
  (print(Messages{}), ...);
}

/// One protocol. Folded: with a deframer and an encoder of its own.
struct Row {
  bool (*from_host)(const Job&);
  bool (*from_mcu)(const Job&);
  void (*defaults)(unsigned row);
};

template <bool Folded, class Host, class Mcu, class... Messages>
constexpr Row row() {
  return {run<Folded, Host, Host, Mcu>, run<Folded, Mcu, Host, Mcu>, print_defaults<Folded, Host, Mcu, Messages...>};
}

}  // namespace conformance

#include "formats.hpp"  // rows, and a show for each struct

namespace {

template <class Number>
bool read_number(std::FILE* file, Number& number) {
  number = 0;
  for (std::size_t i = 0; i < sizeof number; ++i) {
    const int byte = std::fgetc(file);
    if (byte == EOF) return false;
    number |= static_cast<Number>(static_cast<Number>(byte) << (8 * i));
  }
  return true;
}

bool read_chunks(std::FILE* file, std::uint32_t count, conformance::Chunks& chunks) {
  for (std::uint32_t i = 0; i < count; ++i) {
    conformance::Chunk chunk;
    std::uint32_t size = 0;
    if (!read_number(file, chunk.time_us) || !read_number(file, size)) return false;
    chunk.bytes.resize(size);
    if (std::fread(chunk.bytes.data(), 1, size, file) != size) return false;
    chunks.push_back(std::move(chunk));
  }
  return true;
}

int run_all(std::FILE* file) {
  std::uint32_t index = 0;
  while (read_number(file, index)) {
    std::uint32_t sender = 0;
    std::uint32_t sets_address = 0;
    std::uint32_t count = 0;
    conformance::Job job;
    const bool is_whole = read_number(file, sender) && read_number(file, sets_address) &&
                          read_number(file, job.address) && read_number(file, count) &&
                          read_chunks(file, count, job.chunks);
    job.sets_address = sets_address != 0;
    if (!is_whole || index >= conformance::rows.size()) {
      std::fputs("the file of jobs is cut off, or names a row that is not there\n", stderr);
      return 2;
    }
    std::puts("job");
    const conformance::Row& row = conformance::rows[index];
    if (!(sender == 0 ? row.from_host : row.from_mcu)(job)) return 1;
  }
  for (unsigned i = 0; i < conformance::rows.size(); ++i) conformance::rows[i].defaults(i);
  return 0;
}

}  // namespace

int main(int count, char** arguments) {
  if (count != 2) {
    std::fprintf(stderr, "usage: %s FILE\n", arguments[0]);
    return 2;
  }
  std::FILE* const file = std::fopen(arguments[1], "rb");
  if (file == nullptr) {
    std::perror(arguments[1]);
    return 2;
  }
  const int result = run_all(file);
  std::fclose(file);
  return result;
}
