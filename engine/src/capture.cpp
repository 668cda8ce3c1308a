// Decodes a whole capture to rows of payloads, on several cores.
//
// The problem: a frame's place is known only after the bytes before it were decoded, because a deframer's result at one
// place depends on its state there. A capture that is cut into parts has no such state at the cuts; and the result must
// not depend on the number of threads.
//
// The answer: each thread decodes its part from the part's start, as if nothing came before. That may be wrong at
// first, but deframers resynchronise: once two of them end the same frame and owe nothing (`owes_nothing`), all that
// follows depends only on the same bytes, so they cannot differ any more. Each part therefore notes its first such
// places as landmarks, with its counts there. Then, one part after the other, the deframer of the part before continues
// into the next part until it ends a frame at one of the landmarks. From there on the next part's results count; its
// results before the landmark are dropped, and the counts that it had there are subtracted. A part without a common
// landmark is decoded again from the part before: slower, but equally correct.
#include "wirebond/engine/capture.hpp"

#include <algorithm>
#include <cmath>
#include <memory>
#include <thread>
#include <utility>

namespace wirebond::engine {

namespace {

using Account = ByteAccount<std::uint64_t>;

/// Frames that the file does not list, in the order in which they were found: parts of a capture are joined in that
/// order.
class UnlistedLog {
 public:
  struct Entry {
    std::uint32_t id;
    std::uint32_t bytes;
  };
  void add(std::uint32_t id, std::uint32_t bytes) { entries_.push_back({id, bytes}); }
  const std::vector<Entry>& entries() const { return entries_; }

 private:
  std::vector<Entry> entries_;
};

struct PartAccount : Account {
  UnlistedIn<UnlistedLog> unlisted;
};

constexpr std::size_t step = std::size_t{1} << 18;        // bytes between two checks of `cancelled`
constexpr std::size_t least_part = std::size_t{1} << 16;  // minimum number of bytes for a thread
constexpr std::size_t landmarks_kept = 4096;              // two decoders rarely differ for longer

/// A place after a frame from which on the results depend only on the bytes, and the results until there.
struct Landmark {
  std::uint64_t at = 0;  ///< position in the capture
  Account account;
  std::vector<std::size_t> rows;  ///< number of rows by message, and of unknown ones last
  std::size_t numbers = 0;
  std::size_t unlisted = 0;
};

/// Decodes one part of a capture, from its start, as if nothing came before.
class Part {
 public:
  /// `idle_us`: see Timing; bytes of a capture without times never wait.
  Part(const ProtocolTable& protocol, const FormatTable& format, std::uint64_t begin,
       std::uint64_t idle_us = ~std::uint64_t{0})
      : protocol_(protocol),
        format_(format),
        begin_(begin),
        at_(begin),
        workspace_(workspace_bytes(format.source())),
        deframer_(format.source(), workspace_.data(), idle_us) {
    found_.messages.resize(protocol.messages().size());
  }

  /// Decode up to `end`, and note the first landmarks if there is a part before this one that may meet them.
  void run(const std::uint8_t* bytes, std::uint64_t end, std::atomic<std::uint64_t>& done,
           const std::atomic<bool>& cancelled) {
    Sink sink{*this};
    sink.notes_landmarks = begin_ != 0;
    while (at_ < end && !cancelled) {
      const std::uint64_t size = std::min<std::uint64_t>(step, end - at_);
      deframer_.feed(bytes + at_, size, 0, sink);
      at_ += size;
      done += size;
    }
  }

  /// Decode the whole capture, read by read.
  void run_timed(const std::uint8_t* bytes, const Timing& timing, std::atomic<std::uint64_t>& done,
                 const std::atomic<bool>& cancelled) {
    is_timed_ = true;
    Sink sink{*this};
    auto broken = timing.breaks.begin();
    auto expected = timing.expected.begin();
    for (std::size_t i = 0; i < timing.count && !cancelled; ++i) {
      if (broken != timing.breaks.end() && *broken == i) {
        deframer_.give_up(sink);
        ++broken;
      }
      time_ = timing.times[i];
      const auto now_us = static_cast<std::uint64_t>(std::llround(time_ * 1e6));
      deframer_.idle(now_us, sink);
      for (; expected != timing.expected.end() && expected->first == i; ++expected) deframer_.expect(expected->second);
      const std::uint64_t end = timing.ends[i];
      deframer_.feed(bytes + at_, end - at_, now_us, sink);
      done += end - at_;
      at_ = end;
    }
    finish();
  }

  /// Continue after the part's end until a landmark of `next` is reached, and return it; null if `end` comes first.
  const Landmark* run_into(const Part& next, const std::uint8_t* bytes, std::uint64_t end,
                           const std::atomic<bool>& cancelled) {
    Sink sink{*this};
    sink.next = &next;
    while (at_ < end && sink.met == nullptr && !cancelled) {
      const std::uint64_t size = std::min<std::uint64_t>(meeting_step, end - at_);
      deframer_.feed(bytes + at_, size, 0, sink);
      at_ += size;
    }
    return sink.met;
  }

  void finish() {
    Sink sink{*this};
    deframer_.give_up(sink);
  }

  /// Return everything found here until the next part was met, or to the end.
  Capture& found() { return found_; }
  const Account& account(bool until_met) const { return until_met ? met_ : deframer_.account(); }
  const std::vector<UnlistedLog::Entry>& unlisted() const { return deframer_.account().unlisted.found().entries(); }
  std::size_t unlisted_count(bool until_met) const { return until_met ? unlisted_until_met_ : unlisted().size(); }

 private:
  static constexpr std::uint64_t meeting_step = 4096;

  /// One type of sink for all functions that feed: the deframer is compiled again for each type.
  struct Sink {
    Part& part;
    bool notes_landmarks = false;
    const Part* next = nullptr;     ///< the part whose landmarks are searched, and
    const Landmark* met = nullptr;  ///< the landmark that was reached; frames after it belong to `next`

    void operator()(const Frame& frame) {
      if (met != nullptr) return;
      part.take(frame);
      if (notes_landmarks) part.note_landmark();
      if (next != nullptr) met = part.met_in(*next);
    }
  };

  void note_landmark() {
    if (landmarks_.size() < landmarks_kept && deframer_.owes_nothing()) landmarks_.push_back(here());
  }

  const Landmark* met_in(const Part& next) {
    if (!deframer_.owes_nothing()) return nullptr;
    const Landmark* const met = next.landmark_at(begin_ + deframer_.account().settled());
    if (met != nullptr) {
      met_ = deframer_.account();
      unlisted_until_met_ = unlisted().size();
    }
    return met;
  }

  void take(const Frame& frame) {
    take_row(protocol_, format_, frame, begin_ + frame.offset, is_timed_ ? &time_ : nullptr, found_);
  }

  Landmark here() const {
    Landmark mark{
        begin_ + deframer_.account().settled(), deframer_.account(), {}, found_.numbers.size(), unlisted().size()};
    for (const Rows& rows : found_.messages) mark.rows.push_back(rows.offsets.size());
    mark.rows.push_back(found_.unknown.offsets.size());
    return mark;
  }

  const Landmark* landmark_at(std::uint64_t at) const {
    const auto found = std::lower_bound(landmarks_.begin(), landmarks_.end(), at,
                                        [](const Landmark& mark, std::uint64_t place) { return mark.at < place; });
    return found != landmarks_.end() && found->at == at ? &*found : nullptr;
  }

  const ProtocolTable& protocol_;
  const FormatTable& format_;
  std::uint64_t begin_;
  std::uint64_t at_;
  std::vector<std::uint8_t> workspace_;
  StreamDeframer<RuntimeSource, std::uint64_t, PartAccount> deframer_;
  Capture found_;
  bool is_timed_ = false;
  double time_ = 0;
  std::vector<Landmark> landmarks_;
  Account met_{};
  std::size_t unlisted_until_met_ = 0;
};

/// Compute sum += later - earlier, in every counter.
void add(Account& sum, const Account& later, const Account& earlier) {
  sum.frame_bytes += later.frame_bytes - earlier.frame_bytes;
  sum.fill_bytes += later.fill_bytes - earlier.fill_bytes;
  sum.frames += later.frames - earlier.frames;
  sum.unknown_frames += later.unknown_frames - earlier.unknown_frames;
  for (std::size_t i = 0; i < cause_count; ++i) {
    sum.discarded_bytes[i] += later.discarded_bytes[i] - earlier.discarded_bytes[i];
    sum.rejected_candidates[i] += later.rejected_candidates[i] - earlier.rejected_candidates[i];
  }
}

void append(Capture& whole, Part& part, const Landmark& from, const ProtocolTable& protocol, std::size_t header_fields,
            bool until_met) {
  for (std::size_t i = 0; i < whole.messages.size(); ++i) {
    whole.messages[i].append(std::move(part.found().messages[i]), from.rows[i], row_bytes(protocol.messages()[i]),
                             header_fields);
  }
  whole.unknown.append(std::move(part.found().unknown), from.rows.back(), 0, header_fields);
  const std::vector<SeenNumber>& numbers = part.found().numbers;
  whole.numbers.insert(whole.numbers.end(), numbers.begin() + static_cast<std::ptrdiff_t>(from.numbers), numbers.end());
  add(whole.account, part.account(until_met), from.account);
  for (std::size_t i = from.unlisted; i < part.unlisted_count(until_met); ++i) {
    whole.unlisted.add(part.unlisted()[i].id, part.unlisted()[i].bytes);
  }
}

}  // namespace

Capture decode_capture(const ProtocolTable& protocol, const FormatTable& format, const std::uint8_t* bytes,
                       std::size_t size, unsigned threads, std::atomic<std::uint64_t>& done,
                       const std::atomic<bool>& cancelled) {
  // If silence ends a frame, a capture without times is one block.
  const bool divides = format.format().framing != Framing::silence;
  const std::size_t most = divides ? size / least_part : 0;
  const std::size_t count = std::max<std::size_t>(1, std::min<std::size_t>(threads, most));
  std::vector<std::unique_ptr<Part>> parts;
  std::vector<std::uint64_t> ends;
  for (std::size_t i = 0; i < count; ++i) {
    parts.push_back(std::make_unique<Part>(protocol, format, size * i / count));
    ends.push_back(size * (i + 1) / count);
  }
  std::vector<std::thread> others;
  for (std::size_t i = 1; i < count; ++i) {
    others.emplace_back([&, i] { parts[i]->run(bytes, ends[i], done, cancelled); });
  }
  parts[0]->run(bytes, ends[0], done, cancelled);
  for (std::thread& other : others) other.join();

  Capture whole;
  whole.messages.resize(protocol.messages().size());
  Landmark from;
  from.rows.assign(protocol.messages().size() + 1, 0);
  std::size_t current = 0;
  for (std::size_t next = 1; next < count && !cancelled; ++next) {  // a part that is never met is decoded again
    const Landmark* const met = parts[current]->run_into(*parts[next], bytes, ends[next], cancelled);
    if (met == nullptr) continue;
    append(whole, *parts[current], from, protocol, format.header().size(), true);
    from = *met;
    current = next;
  }
  parts[current]->finish();
  append(whole, *parts[current], from, protocol, format.header().size(), false);
  return whole;
}

Capture decode_timed(const ProtocolTable& protocol, const FormatTable& format, const std::uint8_t* bytes,
                     const Timing& timing, std::atomic<std::uint64_t>& done, const std::atomic<bool>& cancelled) {
  Part part(protocol, format, 0, timing.idle_us);
  part.run_timed(bytes, timing, done, cancelled);
  Capture whole;
  whole.messages.resize(protocol.messages().size());
  Landmark from;
  from.rows.assign(protocol.messages().size() + 1, 0);
  append(whole, part, from, protocol, format.header().size(), false);
  return whole;
}

}  // namespace wirebond::engine
