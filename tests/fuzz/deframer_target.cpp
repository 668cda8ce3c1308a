// Fuzz target: the stream deframer with a run-time format, real ones and drawn ones, over streams made of frames,
// damaged frames and anything. README.md says what must hold.
#include <fuzzer/FuzzedDataProvider.h>

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <cstdio>
#include <cstdlib>
#include <memory>
#include <vector>

#include "describe.hpp"
#include "described.hpp"
#include "drawn_format.hpp"
#include "expect.hpp"
#include "wirebond/encoder.hpp"
#include "wirebond/host/runtime_source.hpp"
#include "wirebond/stream_deframer.hpp"

namespace {

using Bytes = std::vector<std::uint8_t>;

/// The run-time source, counting what it is asked: the deframer's work. `straight`: with the fast path for good frames.
/// The deframer is a template over its source, so that these functions hide the inherited ones.
class CountingSource : public wirebond::RuntimeSource {
 public:
  CountingSource(const wirebond::RuntimeSource& source, bool straight, std::uint64_t* work)
      : RuntimeSource(source), fast_path_(straight ? &source.fast_path() : &no_fast_path), work_(work) {}
  const wirebond::FrameFormat& format() const {
    *work_ += 1;
    return RuntimeSource::format();
  }
  const wirebond::FastPath& fast_path() const { return *fast_path_; }
  wirebond::MessageShape message(std::uint32_t id) const {
    *work_ += 1;
    return RuntimeSource::message(id);
  }
  const wirebond::MessageShape& message_of(std::uint32_t id) const {  // the fast path's: a check may follow
    *work_ += wirebond::max_frame_bytes(RuntimeSource::format());
    return RuntimeSource::message_of(id);
  }
  std::uint64_t check_update(unsigned algorithm, std::uint64_t reg, const std::uint8_t* bytes, std::size_t size) const {
    *work_ += size;
    return RuntimeSource::check_update(algorithm, reg, bytes, size);
  }

 private:
  static inline const wirebond::FastPath no_fast_path{};
  const wirebond::FastPath* fast_path_;
  std::uint64_t* work_;
};

/// Work that one byte or one call may cost, whatever the input. A candidate is examined when its prefix is there and
/// again when all of it is, for each form, and when it is given up.
std::uint64_t work_bound(const wirebond::FrameFormat& format) {
  std::uint64_t one_pass = 8 + wirebond::max_frame_bytes(format);
  for (std::size_t i = 0; i < format.form_count; ++i) {
    one_pass += 4 + format.forms[i].check_count * (wirebond::max_frame_bytes(format) + 4);
  }
  const std::uint64_t examinations = wirebond::max_constants + 2u * format.form_count + 2u;
  return 8 + examinations * one_pass;
}

struct Found {
  std::uint64_t offset;
  std::uint32_t id;
  int message;
  std::size_t form;
  Bytes wire;
  Bytes payload;
  Bytes unstuffed;
  std::vector<std::uint64_t> header;

  bool operator==(const Found& other) const {
    return offset == other.offset && id == other.id && message == other.message && form == other.form &&
           wire == other.wire && payload == other.payload && header == other.header;
  }
};

/// A deframer under observation: what it delivers is kept, and its account is checked after every call.
template <class Counter>
class Observed {
 public:
  Observed(const wirebond::RuntimeSource& source, Counter start_us, Counter idle_us, bool straight = true)
      : format_(source.format()),
        workspace_(new std::uint8_t[wirebond::workspace_bytes(CountingSource(source, straight, &work_))]),
        now_us_(start_us),
        deframer_(CountingSource(source, straight, &work_), workspace_.get(), idle_us) {}
  Observed(const Observed&) = delete;
  Observed& operator=(const Observed&) = delete;

  void feed(const std::uint8_t* bytes, std::size_t size) {
    const std::unique_ptr<std::uint8_t[]> copy(new std::uint8_t[size]);  // of this size, so that overruns are seen
    std::copy(bytes, bytes + size, copy.get());
    fed_.insert(fed_.end(), bytes, bytes + size);
    deframer_.feed(copy.get(), size, now_us_, sink_);
    after_call();
  }

  void pass(Counter time_us) {
    now_us_ = static_cast<Counter>(now_us_ + time_us);
    deframer_.idle(now_us_, sink_);
    after_call();
  }

  void give_up() {
    deframer_.give_up(sink_);
    after_call();
    EXPECT(deframer_.pending() == 0, "all bytes are settled when no byte will follow");
  }

  const std::vector<Found>& frames() const { return frames_; }
  const wirebond::ByteAccount<Counter>& account() const { return deframer_.account(); }
  std::size_t pending() const { return deframer_.pending(); }

 private:
  void take(const wirebond::Frame& frame) {
    EXPECT(frame.form < format_.form_count, "a frame has one of the forms");
    Found found{frame.offset,
                frame.id,
                frame.message,
                frame.form,
                Bytes(frame.wire, frame.wire + frame.wire_size),
                Bytes(frame.payload, frame.payload + frame.payload_size),
                Bytes(frame.bytes, frame.bytes + frame.size),
                {}};
    found.header.resize(wirebond::max_header_fields);
    for (std::size_t i = 0; i < format_.forms[frame.form].header_count; ++i) {
      const wirebond::HeaderField& field = format_.forms[frame.form].header[i];
      found.header[field.place] = wirebond::detail::read_wide(field.number, frame.bytes, frame.size);
    }
    EXPECT(found.offset >= settled_, "frames are delivered in order and do not overlap");
    settled_ = found.offset + found.wire.size();
    EXPECT(settled_ <= fed_.size(), "a frame lies within the bytes that were fed");
    EXPECT(std::equal(found.wire.begin(), found.wire.end(), fed_.begin() + static_cast<std::ptrdiff_t>(found.offset)),
           "a frame's wire bytes are those of the stream at its offset");
    frame_bytes_ += found.wire.size();
    unknown_ += found.message < 0 ? 1 : 0;
    frames_.push_back(std::move(found));
  }

  void after_call() {
    ++calls_;
    const auto& account = deframer_.account();
    EXPECT(deframer_.bytes() == static_cast<Counter>(fed_.size()), "every byte that was fed is counted");
    EXPECT(deframer_.bytes() == static_cast<Counter>(account.settled() + deframer_.pending()),
           "every byte lies in exactly one bucket");
    EXPECT(deframer_.pending() <= wirebond::max_wire_bytes(format_), "at most one frame is held back");
    EXPECT(account.frames == frames_.size() && account.unknown_frames == unknown_, "every frame is counted");
    EXPECT(account.frame_bytes == frame_bytes_, "frame_bytes are the bytes of the delivered frames");
    EXPECT(work_ <= (fed_.size() + calls_) * work_bound(format_), "work per byte is bounded");
  }

  struct Sink {
    Observed& observed;
    void operator()(const wirebond::Frame& frame) { observed.take(frame); }
  };

  const wirebond::FrameFormat& format_;
  std::uint64_t work_ = 0;
  std::unique_ptr<std::uint8_t[]> workspace_;
  Counter now_us_;
  std::uint64_t calls_ = 0;
  std::uint64_t settled_ = 0;
  std::uint64_t frame_bytes_ = 0;
  std::uint64_t unknown_ = 0;
  Bytes fed_;
  std::vector<Found> frames_;
  Sink sink_{*this};
  wirebond::StreamDeframer<CountingSource, Counter> deframer_;
};

template <class One, class Other>
void expect_same(const Observed<One>& one, const Observed<Other>& other) {
  EXPECT(one.frames() == other.frames(), "neither chunking nor the straight way changes a frame");
  EXPECT(one.account().fill_bytes == other.account().fill_bytes,
         "neither chunking nor the straight way changes a fill");
  for (std::size_t cause = 0; cause < wirebond::cause_count; ++cause) {
    EXPECT(one.account().discarded_bytes[cause] == other.account().discarded_bytes[cause],
           "neither chunking nor the straight way changes a discard");
    EXPECT(one.account().rejected_candidates[cause] == other.account().rejected_candidates[cause],
           "neither chunking nor the straight way changes a rejection");
  }
}

// ---- streams ------------------------------------------------------------------------------------------------------

struct Stream {
  struct Piece {
    std::size_t begin;
    std::size_t end;
    bool is_intact;  // a frame that the encoder made, untouched
  };
  Bytes bytes;
  std::vector<Piece> pieces;
};

constexpr std::size_t longest_stream = 6000;

/// A header field's value with the bits that tell this form from others as they must be.
std::uint64_t of_form(const wirebond::Form& form, const wirebond::Number& number, std::uint64_t value,
                      std::size_t frame_size) {
  Bytes frame(frame_size, 0);
  wirebond::detail::write_number(number, frame.data(), frame_size, value);
  for (std::size_t i = 0; i < form.constant_count; ++i) {
    const wirebond::Constant& constant = form.constants[i];
    std::uint8_t& byte = frame[constant.at.in(frame_size)];
    byte = static_cast<std::uint8_t>((byte & ~constant.mask) | constant.value);
  }
  return wirebond::detail::read_wide(number, frame.data(), frame_size);
}

/// Of messages that share an id, the one that is expected; nothing is drawn where none is shared.
std::int16_t draw_expected(const std::vector<wirebond::MessageRow>& rows, FuzzedDataProvider& input) {
  const bool is_shared = std::any_of(rows.begin(), rows.end(), [](const auto& row) { return row.only_expected; });
  if (!is_shared) return -1;
  const wirebond::MessageRow& row = rows[input.ConsumeIntegralInRange<std::size_t>(0, rows.size() - 1)];
  return row.only_expected ? row.shape.index : std::int16_t{-1};
}

/// Counts and constants among a message's fields, as its sender has them.
class PayloadDraft {
 public:
  /// Draws the counts.
  PayloadDraft(const wirebond::MessageRow& row, FuzzedDataProvider& input) : rules_(row.rules) {
    std::size_t behind[wirebond::max_payload_counts + 1] = {};
    for (std::size_t i = 0; i < rules_.count_count; ++i) {
      const wirebond::PayloadCount& count = rules_.counts[i];
      std::size_t told = 0;
      std::size_t taken = 0;
      if (count.agrees_with < 0) {
        told = input.ConsumeIntegralInRange<std::size_t>(0, count.most / count.step) * count.step;
        taken = told * count.unit;
      } else {
        const auto other = static_cast<std::size_t>(count.agrees_with);
        told = (behind[other + 1] - behind[other]) / count.unit;
      }
      places_[i] = count.at + behind[count.behind];
      for (std::size_t j = 0; j < i; ++j) {  // one number may count several things
        if (places_[j] != places_[i] || rules_.counts[j].shift != count.shift || count.agrees_with >= 0) continue;
        told = numbers_[j];
        taken = told * count.unit;
      }
      is_possible_ = is_possible_ && told <= count.most && told % count.step == 0;
      behind[i + 1] = behind[i] + taken;
      numbers_[i] = told;
    }
    shift_ = behind[rules_.count_count];
    for (std::size_t i = 0; i < rules_.constant_count; ++i) {
      constants_.push_back(rules_.constants[i].at + behind[rules_.constants[i].behind]);
    }
  }

  /// False: what was drawn for a number that counts several things is too much for one of them.
  bool is_possible() const { return is_possible_; }
  /// Bytes that stand behind the counts.
  std::size_t counted_bytes() const { return shift_; }

  /// Put counts and constants into a payload.
  void write(Bytes& payload) const {
    for (std::size_t i = 0; i < rules_.count_count; ++i) {
      const wirebond::PayloadCount& count = rules_.counts[i];
      if (places_[i] + count.bytes > payload.size()) continue;
      std::uint8_t* const at = payload.data() + places_[i];
      const std::uint64_t kept =
          wirebond::load_bytes(at, count.bytes, count.order) & ~(count.mask << count.shift);  // of other bits
      wirebond::store_bytes(at, kept | std::uint64_t{numbers_[i]} << count.shift, count.bytes, count.order);
    }
    for (std::size_t i = 0; i < constants_.size(); ++i) {
      if (constants_[i] >= payload.size()) continue;
      const wirebond::PayloadConstant& constant = rules_.constants[i];
      std::uint8_t& byte = payload[constants_[i]];
      byte = static_cast<std::uint8_t>((byte & ~constant.mask) | constant.value);
    }
  }

 private:
  const wirebond::PayloadRules rules_;
  std::size_t places_[wirebond::max_payload_counts] = {};
  std::size_t numbers_[wirebond::max_payload_counts] = {};
  std::vector<std::size_t> constants_;
  std::size_t shift_ = 0;
  bool is_possible_ = true;
};

/// Are these the same bits of a frame?
bool stands_at(const wirebond::Number& one, const wirebond::Number& other) {
  return one.bytes == other.bytes && one.at.offset == other.at.offset && one.at.from_end == other.at.from_end &&
         one.shift == other.shift && one.mask == other.mask;
}

/// A frame of one of the messages that are meant now; empty where its form cannot carry what was drawn.
Bytes draw_frame(const wirebond::RuntimeSource& source, const std::vector<wirebond::MessageRow>& rows,
                 FuzzedDataProvider& input) {
  if (rows.empty()) return {};
  const wirebond::FrameFormat& format = source.format();
  const wirebond::MessageRow& row = rows[input.ConsumeIntegralInRange<std::size_t>(0, rows.size() - 1)];
  if (source.message(row.id).index != row.shape.index) return {};  // its id means another one now
  const std::size_t number =
      input.ConsumeBool() ? input.ConsumeIntegralInRange<std::size_t>(0, format.form_count - 1u) : 0;
  const wirebond::Form& form = format.forms[number];
  const PayloadDraft draft(row, input);
  const std::size_t size = row.rules.count_count != 0 ? row.shape.min_payload + draft.counted_bytes()
                                                      : input.ConsumeIntegralInRange<std::size_t>(
                                                            row.shape.min_payload, row.shape.max_payload);
  if (!draft.is_possible() || size > row.shape.max_payload) return {};
  if (form.length.present()) {  // sizes that the length cannot tell are the loader's to refuse
    const std::int64_t counted = static_cast<std::int64_t>(size) - form.length_bias;
    if (counted < 0 || counted % form.length_unit != 0) return {};
    if (counted / form.length_unit > form.length.most()) return {};
  }
  std::vector<std::uint64_t> header(wirebond::max_header_fields);
  for (std::size_t i = 0; i < form.header_count; ++i) {
    const std::uint64_t mask = form.header[i].number.mask;
    const std::uint64_t drawn =
        input.ConsumeBool() ? input.ConsumeIntegral<std::uint64_t>() & mask : form.header[i].default_value;
    header[form.header[i].place] = of_form(form, form.header[i].number, drawn, form.prefix + size + form.suffix);
    if (stands_at(form.header[i].number, form.id))
      header[form.header[i].place] = row.id;  // of a message with several ids
  }
  // A sender takes another form for these; and a check over words may have no rule for a byte that is left over.
  const bool is_refused = !wirebond::carries_id(format, form, row.id) ||
                          wirebond::is_excluded(format, form, row.id, size, header.data()) ||
                          (form.payload_unit > 1 && size % form.payload_unit != form.payload_rest);
  Bytes payload = input.ConsumeBytes<std::uint8_t>(size);
  payload.resize(size);
  draft.write(payload);
  const std::size_t room =
      wirebond::max_wire_bytes(format) + wirebond::payload_lead(source, number) + wirebond::max_frame_bytes(format);
  const std::unique_ptr<std::uint8_t[]> buffer(new std::uint8_t[room]());
  std::copy(payload.begin(), payload.end(), buffer.get() + wirebond::payload_lead(source, number));
  const std::size_t wire =
      wirebond::seal(source, buffer.get(), wirebond::max_wire_bytes(format), row.id, size, number, header.data());
  EXPECT(wire <= wirebond::max_wire_bytes(format), "a frame has the bytes that were set aside for it");
  const bool is_empty = size == 0 && form.prefix + form.suffix + form.fixed_payload == 0 &&
                        format.framing != wirebond::Framing::bracketed && format.stuffing != wirebond::Stuffing::cobs;
  EXPECT((wire == 0) == (is_empty || is_refused), "what fits this form is sealed, if there is anything to seal");
  return Bytes(buffer.get(), buffer.get() + wire);
}

Stream draw_stream(const wirebond::RuntimeSource& source, const std::vector<wirebond::MessageRow>& rows,
                   FuzzedDataProvider& input) {
  Stream stream;
  const wirebond::FrameFormat& format = source.format();
  const bool marked = wirebond::delimiter_bytes(format) != 0;
  const std::uint8_t start = marked ? format.opening.first : format.forms[0].constants[0].value;
  while (input.remaining_bytes() > 0 && stream.bytes.size() < longest_stream) {
    Bytes piece;
    bool is_intact = false;
    switch (input.ConsumeIntegralInRange(0, 7)) {
      case 0: piece = input.ConsumeBytes<std::uint8_t>(input.ConsumeIntegralInRange<std::size_t>(0, 64)); break;
      case 1: piece = Bytes(input.ConsumeIntegralInRange<std::size_t>(1, 300), start); break;
      case 2:  // damaged
        piece = draw_frame(source, rows, input);
        if (!piece.empty()) {
          const std::size_t at = input.ConsumeIntegralInRange<std::size_t>(0, piece.size() - 1);
          piece[at] = static_cast<std::uint8_t>(piece[at] ^ (1u << input.ConsumeIntegralInRange(0, 7)));
        }
        break;
      case 3:  // cut off
        piece = draw_frame(source, rows, input);
        if (!piece.empty()) piece.resize(input.ConsumeIntegralInRange<std::size_t>(0, piece.size() - 1));
        break;
      default:
        piece = draw_frame(source, rows, input);
        is_intact = !piece.empty();
        break;
    }
    stream.pieces.push_back({stream.bytes.size(), stream.bytes.size() + piece.size(), is_intact});
    stream.bytes.insert(stream.bytes.end(), piece.begin(), piece.end());
  }
  return stream;
}

/// Where a byte is sent as it is, without stuffing, it may be a delimiter, and then ends the frame too early. So may
/// the byte that is sent twice elsewhere: a receiver takes it for half of a pair.
bool holds_delimiter(const wirebond::FrameFormat& format, const std::uint8_t* wire, std::size_t size) {
  if (wirebond::delimiter_bytes(format) == 0) return false;
  const bool is_stuffed =
      format.stuffing != wirebond::Stuffing::none && format.stuffing != wirebond::Stuffing::decimal_check;
  const bool doubles = format.stuffing == wirebond::Stuffing::escape && format.escapes.escape == format.opening.first;
  const std::size_t begin = wirebond::opening_bytes(format);
  const std::size_t end = size - format.closing.size;
  for (std::size_t at = begin; at < end; ++at) {
    if (is_stuffed && at >= begin + format.plain_front && at + format.plain_back < end) continue;
    if (doubles && wire[at] == format.opening.first) return true;
    if (format.closing.stands_at(wire + at, size - at) || format.opening.stands_at(wire + at, size - at)) return true;
  }
  return false;
}

/// Guarantee 1: a frame whose bytes arrive whole is delivered, unless a delivered one overlaps it. `resync: strict`
/// gives that up: what a failed candidate covers is skipped.
void expect_intact_frames(const wirebond::FrameFormat& format, const Stream& stream, const std::vector<Found>& frames) {
  if (format.skips_failed) return;
  const bool marked = wirebond::delimiter_bytes(format) != 0;
  for (const Stream::Piece& piece : stream.pieces) {
    if (!piece.is_intact) continue;
    std::size_t begin = piece.begin;
    if (marked) {
      const std::size_t mark = format.closing.size;
      const bool opened = format.sends_opening || begin == 0 ||
                          (begin >= mark && format.closing.stands_at(stream.bytes.data() + begin - mark, mark));
      if (!opened) continue;  // what lies before it belongs to the same block
      if (holds_delimiter(format, stream.bytes.data() + piece.begin, piece.end - piece.begin)) continue;
      // Neighbours may share a delimiter.
      if (format.framing == wirebond::Framing::delimited && format.sends_opening) begin += mark;
    }
    const bool found = std::any_of(frames.begin(), frames.end(), [&](const Found& frame) {
      return frame.offset < piece.end && frame.offset + frame.wire.size() > begin;
    });
    EXPECT(found, "no intact frame is lost");
  }
}

/// What lies between the delimiters that the frame came with.
wirebond::detail::Received between_delimiters(const wirebond::FrameFormat& format, const Found& found) {
  if (!wirebond::has_marks(format)) return {found.wire.data(), found.wire.size()};
  const std::size_t opening = format.opening.stands_at(found.wire.data(), found.wire.size()) ? format.opening.size : 0;
  return {found.wire.data() + opening, found.wire.size() - opening - format.closing.size};
}

/// Does a condition that plays no part on receive forbid a sender to send this? `payload: rest` has such ones.
bool only_senders_exclude(const wirebond::FrameFormat& format, const wirebond::Form& form, std::size_t payload) {
  for (std::size_t i = 0; i < form.exclusion_count; ++i) {
    const wirebond::Exclusion& exclusion = format.exclusions[form.first_exclusion + i];
    if (exclusion.on_receive || exclusion.subject != wirebond::Subject::size) continue;
    if (exclusion.low <= payload && payload <= exclusion.high) return true;
  }
  return false;
}

/// What was delivered passes once more by itself, and so does what the encoder makes of it.
void expect_itself(const wirebond::RuntimeSource& source, const Found& found) {
  const wirebond::FrameFormat& format = source.format();
  const wirebond::Form& form = format.forms[found.form];
  wirebond::Frame frame;
  const wirebond::detail::Received received = between_delimiters(format, found);
  const wirebond::Verdict verdict =
      wirebond::examine(source, found.unstuffed.data(), found.unstuffed.size(),
                        format.framing == wirebond::Framing::by_start ? nullptr : &received, frame);
  EXPECT(verdict.outcome == wirebond::Outcome::frame && verdict.bytes == found.unstuffed.size(),
         "a delivered frame passes its own examination");

  if (only_senders_exclude(format, form, found.payload.size())) return;
  const std::uint32_t id = form.id.present() ? found.id : format.no_id;
  const std::size_t lead = wirebond::payload_lead(source, found.form);
  const std::size_t room = wirebond::max_wire_bytes(format);
  const std::unique_ptr<std::uint8_t[]> buffer(new std::uint8_t[room]());
  std::copy(found.payload.begin(), found.payload.end(), buffer.get() + lead);
  const std::size_t wire =
      wirebond::seal(source, buffer.get(), room, id, found.payload.size(), found.form, found.header.data());
  EXPECT(wire != 0, "a delivered frame can be encoded");
  if (holds_delimiter(format, buffer.get(), wire)) return;
  Observed<std::uint32_t> again(source, 0, 1000);
  again.feed(buffer.get(), wire);
  again.give_up();
  EXPECT(again.frames().size() == 1, "what is encoded is one frame");
  const Found& other = again.frames()[0];
  Bytes payload = found.payload;
  while (form.trims_zeros && payload.size() > 1 && payload.back() == 0) payload.pop_back();
  EXPECT(other.payload == payload && other.id == found.id && other.message == found.message &&
             other.header == found.header && other.form == found.form && other.wire.size() == wire,
         "a frame that is encoded again is the same frame");
}

/// What the target is at, for the report of a finding.
struct Case {
  const fuzz::Described* described = nullptr;
  std::int16_t expected = -1;
  Stream stream;
};
Case now;

void print_case() {
  fuzz::print_format(now.described->format);
  for (const wirebond::MessageRow& row : now.described->rows) {
    std::fprintf(stderr, " message %d: id 0x%X, %u to %u bytes, seed %u%s\n", row.shape.index, row.id,
                 row.shape.min_payload, row.shape.max_payload, row.shape.seed,
                 row.only_expected ? ", only where it is expected" : "");
  }
  std::fprintf(stderr, " expected: message %d\n", now.expected);
  for (const Stream::Piece& piece : now.stream.pieces) {
    fuzz::print_bytes(piece.is_intact ? " frame" : " bytes", now.stream.bytes.data() + piece.begin,
                      piece.end - piece.begin);
  }
}

void fuzz_one(const fuzz::Described& described, FuzzedDataProvider& input) {
  now = {&described, -1, {}};
  fuzz::describe = print_case;
  const wirebond::FrameFormat& format = described.format;
  const wirebond::RuntimeTables tables(format, described.rows.data(), described.rows.size());
  const wirebond::RuntimeTables simple_tables(format, described.rows.data(), described.rows.size(),
                                              wirebond::CrcMethod::byte_table);
  wirebond::RuntimeSource source(tables);
  wirebond::RuntimeSource simple_source(simple_tables);
  now.expected = draw_expected(described.rows, input);
  source.expect(now.expected);
  simple_source.expect(now.expected);
  constexpr std::uint32_t idle_us = 20'000;
  const std::uint32_t start_us = input.ConsumeIntegral<std::uint32_t>();
  const unsigned chunk_seed = input.ConsumeIntegral<std::uint16_t>();
  now.stream = draw_stream(source, described.rows, input);
  const Stream& stream = now.stream;

  // Sizes of chunks from a recurrence (Numerical Recipes' constants), so that the fuzzer's bytes make the stream.
  std::uint32_t state = chunk_seed;
  const auto next = [&state](std::uint32_t below) {
    state = state * 1664525u + 1013904223u;
    return (state >> 8) % below;
  };
  static constexpr std::uint32_t spreads[] = {1, 2, 9, 64, 700};
  const std::uint32_t spread = spreads[chunk_seed % 5];

  // By the rules alone, and each CRC a byte at a time: what all others must agree with.
  Observed<std::uint32_t> whole(simple_source, 0, idle_us, false);
  Observed<std::uint32_t> at_once(source, 0, idle_us);
  Observed<std::uint32_t> pieces(source, start_us, idle_us);  // a clock that wraps
  Observed<std::uint32_t> paused(source, start_us, idle_us);
  if (!stream.bytes.empty()) {
    whole.feed(stream.bytes.data(), stream.bytes.size());
    at_once.feed(stream.bytes.data(), stream.bytes.size());
  }
  for (std::size_t at = 0; at < stream.bytes.size();) {
    const std::size_t size = std::min<std::size_t>(1 + next(spread), stream.bytes.size() - at);
    pieces.feed(stream.bytes.data() + at, size);
    pieces.pass(next(idle_us));  // shorter than `idle`: nothing may be given up
    paused.feed(stream.bytes.data() + at, size);
    paused.pass(next(8) == 0 ? idle_us + next(1000) : next(idle_us));
    at += size;
  }
  whole.give_up();
  at_once.give_up();
  pieces.give_up();
  paused.give_up();
  if (format.framing == wirebond::Framing::silence) {
    Observed<std::uint32_t> blocks(source, start_us, idle_us);
    for (const Stream::Piece& piece : stream.pieces) {
      if (piece.begin == piece.end) continue;
      blocks.feed(stream.bytes.data() + piece.begin, piece.end - piece.begin);
      blocks.pass(idle_us);
    }
    expect_intact_frames(format, stream, blocks.frames());
    for (const Found& found : blocks.frames()) expect_itself(source, found);
  } else {
    expect_intact_frames(format, stream, whole.frames());
  }
  expect_same(whole, at_once);
  expect_same(whole, pieces);
  for (const Found& found : whole.frames()) expect_itself(source, found);
}

}  // namespace

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  FuzzedDataProvider input(data, size);
  static const std::vector<fuzz::Described> real = fuzz::real_formats();
  const std::size_t choice = input.ConsumeIntegralInRange<std::size_t>(0, 2 * real.size() - 1);
  fuzz_one(choice < real.size() ? real[choice] : fuzz::FormatDrawer(input).draw(), input);
  return 0;
}
