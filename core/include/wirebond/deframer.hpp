// Finds frames in a run of bytes, resynchronises, and accounts for every byte. Owns no byte.
// One file: all ways to find a frame share one account of the bytes and one rule for who is blamed.
#pragma once

#include <cstddef>
#include <cstdint>
#include <cstring>
#include <type_traits>

#include "wirebond/examine.hpp"
#include "wirebond/format.hpp"
#include "wirebond/marks.hpp"
#include "wirebond/sized.hpp"
#include "wirebond/source.hpp"
#include "wirebond/stuffing.hpp"
#include "wirebond/unlisted_block.hpp"
#include "wirebond/unroll.hpp"

namespace wirebond {

/// Every settled byte is counted in exactly one of these. `Counter` has 64 bits on the host, 32 (modulo 2^32) on the
/// MCU.
template <class Counter>
struct ByteCounts {
  Counter frame_bytes = 0;
  Counter fill_bytes = 0;                     ///< delimiters between frames
  Counter discarded_bytes[cause_count] = {};  ///< by Cause

  Counter frames = 0;
  Counter unknown_frames = 0;  ///< of these: unknown id, or too short for the message

  Counter settled() const {
    Counter sum = frame_bytes + fill_bytes;
    for (const Counter bytes : discarded_bytes) sum += bytes;
    return sum;
  }
};

/// Also counts how often a candidate failed, where discarded_bytes counts its bytes; for ends with enough memory.
template <class Counter>
struct ByteAccount : ByteCounts<Counter> {
  Counter rejected_candidates[cause_count] = {};
};

namespace detail {

/// Counts bytes up to the largest frame: in two bytes if the format is a constant whose frames are short enough.
template <class Source>
constexpr bool has_short_frames() {
  if constexpr (folds<Source>(0)) {
    return max_wire_bytes(Source{}.format()) <= 0xFFFF;
  } else {
    return false;
  }
}
template <class Source>
using Extent = std::conditional_t<has_short_frames<Source>(), std::uint16_t, std::size_t>;

/// The decoded head of a waiting candidate, where the format is read at run time; empty where it is a constant.
template <class Source, bool IsConstant = Source::is_constant>
struct WaitingHead {};
template <class Source>
struct WaitingHead<Source, false> : Source::FastPath::Head {};

/// Check whether the account counts frames of messages that the file does not list.
template <class Account, class = void>
struct TellsUnlisted : std::false_type {};
template <class Account>
struct TellsUnlisted<Account, std::void_t<decltype(Account::unlisted)>> : std::true_type {};

}  // namespace detail

/// The problem: a received byte that looks like a frame's start may be payload or noise, and a length field may be
/// damaged. If a false start were trusted, the deframer would wait for bytes that never come, or skip real frames. And
/// a frame may come in pieces of any size.
///
/// The answer: nothing is settled before it is certain. `consume` works on a *window*: contiguous bytes that begin with
/// the first unsettled one. It examines the candidate at the front. A frame is delivered and its bytes are settled. If
/// a candidate found by its start fails, only its first byte is discarded (unless the format has `skips_failed`) and
/// the search goes on at the second, so a frame inside a false start is found; a failed block between delimiters or
/// silences is discarded whole. If more bytes are needed, `consume` returns how many it settled; the caller presents
/// the rest again, at the front, with more bytes after it. A window of max_wire_bytes + n bytes always settles more
/// than n.
///
/// Every settled byte is counted once: as frame, fill or discard with a cause. One thread or interrupt at a time.
template <class Source, class Counter = std::uint32_t, class Account = ByteAccount<Counter>>
class Deframer {
 public:
  /// `scratch`: memory to unstuff one frame (max_wire_bytes; may be null if nothing is stuffed). The caller keeps it.
  Deframer(const Source& source, std::uint8_t* scratch) : source_(source), scratch_(scratch) {}

  /// Settle bytes from the front of the window and call `sink(const Frame&)` for each frame, in order. `give_up`: no
  /// more bytes will come for the candidate at the end, so its bytes are rescanned and all bytes are settled.
  template <class Sink>
  WIREBOND_INLINE std::size_t consume(const std::uint8_t* window, std::size_t size, bool give_up, Sink&& sink) {
    if constexpr (Source::is_constant) {
      return consume_by_rules(window, size, give_up, sink);
    } else {
      if (source_.format().framing != Framing::by_start) return consume_by_rules(window, size, give_up, sink);
      if (size < needed_) {  // examined before: this many bytes decide
        if (!give_up) return 0;
        needed_ = 0;  // they will not come: the fast path must not wait for them
      }
      std::size_t at = 0;
      while (true) {
        bool is_straight = true;
        if constexpr (tells_unlisted) is_straight = !account_.unlisted.waits();  // else every frame's start counts
        if (is_straight) {
          const bool waits = take_straight(window, size, at, sink);
          if (at == size || (waits && !give_up)) return at;
        }
        const std::size_t settled = consume_by_rules(window + at, size - at, give_up, sink);
        at += settled;
        if (settled == 0 || at == size) return at;
      }
    }
  }

  /// Expect the message `index` from now on, where several messages share its id; -1: none of them. Waiting bytes are
  /// examined for that message, too.
  void expect(std::int16_t index) {
    source_.expect(index);
    needed_ = 0;
    waiting_ = {};
  }

  /// Where silence ends a frame: check whether these bytes are one. Counts nothing.
  bool is_block_frame(const std::uint8_t* block, std::size_t size) {
    Frame frame;
    return !overlong_ && size != 0 && examine_block(block, size, frame).outcome == Outcome::frame;
  }

  /// How many bytes decide the candidate at the window's front; 0: not known.
  std::size_t needed() const { return needed_; }
  /// Called after a frame: check whether the result from here on depends only on the bytes that follow.
  bool owes_nothing() const {
    bool waits = false;
    if constexpr (tells_unlisted) waits = account_.unlisted.waits_for(settled_);
    return blamed_ == 0 && !overlong_ && !waits;
  }
  Counter settled() const { return settled_; }  ///< bytes since the start
  const Account& account() const { return account_; }
  const Source& source() const { return source_; }

 private:
  static constexpr bool tells_unlisted = detail::TellsUnlisted<Account>::value;

  template <class Sink>
  std::size_t consume_by_rules(const std::uint8_t* window, std::size_t size, bool give_up, Sink& sink) {
    const Framing framing = source_.format().framing;
    if constexpr (detail::may_be<Source>(Framing::delimited)) {
      if (framing == Framing::delimited) return consume_delimited(window, size, give_up, sink);
    }
    if constexpr (detail::may_be<Source>(Framing::bracketed)) {
      if (framing == Framing::bracketed) return consume_bracketed(window, size, give_up, sink);
    }
    if constexpr (detail::may_be<Source>(Framing::silence)) {
      if (framing == Framing::silence) return consume_silence(window, size, give_up, sink);
    }
    if constexpr (detail::may_be<Source>(Framing::by_start) || detail::may_be<Source>(Framing::sized)) {
      return consume_by_start(window, size, give_up, sink);
    }
    return 0;
  }

  // ---- frames found by their start ------------------------------------------------------------------------------

  template <class Sink>
  WIREBOND_INLINE std::size_t consume_by_start(const std::uint8_t* window, std::size_t size, bool give_up,
                                               Sink&& sink) {
    std::size_t at = 0;
    while (at < size) {
      const std::size_t skip = find_start(window + at, size - at);
      if (skip != 0) {
        pass_unlisted(window + at, skip);
        discard(skip);
        at += skip;
        if (at == size) break;
      }
      const std::size_t available = size - at;
      if (available < needed_ && !give_up) break;  // examined before: this many bytes decide
      cut_unlisted();
      Frame frame;
      if constexpr (Source::is_constant) frame = {};  // otherwise GCC 12 warns at -O1 and -Os
      if constexpr (tells_unlisted) frame.size = 0;
      Verdict verdict = examine_candidate(window + at, available, frame);
      if (verdict.outcome == Outcome::need_more) {
        if (!give_up) {
          needed_ = static_cast<detail::Extent<Source>>(verdict.bytes);
          waiting_ = {};
          break;
        }
        verdict = {Outcome::reject, Cause::incomplete, available};
      }
      needed_ = 0;
      if (verdict.outcome == Outcome::frame) {
        if constexpr (tells_unlisted) account_.unlisted.begins(settled_);
        pass_unlisted(window + at, verdict.bytes);
        deliver(frame, window + at, verdict.bytes, sink);
        at += verdict.bytes;
      } else {
        if constexpr (tells_unlisted) {  // a form without a constant would match at every byte
          const bool is_marked = source_.format().forms[0].prefix_constants != 0;
          if (verdict.cause == Cause::unknown_message && frame.size != 0 && is_marked) {
            account_.unlisted.failed(settled_, frame.id, frame.size, source_.format().plain_front);
          }
        }
        reject(verdict.cause, verdict.bytes);
        const std::size_t failed = failed_bytes(verdict);
        pass_unlisted(window + at, failed);
        discard(failed);
        at += failed;
      }
      if constexpr (!Source::is_constant) {
        if (source_.format().framing == Framing::by_start) break;  // the next one may be good: use the fast path
      }
    }
    return at;
  }

  WIREBOND_INLINE Verdict examine_candidate(const std::uint8_t* candidate, std::size_t available, Frame& frame) {
    if constexpr (detail::may_be<Source>(Framing::sized)) {
      if (source_.format().framing == Framing::sized) {
        return examine_sized(source_, candidate, available, scratch_, frame);
      }
    }
    return examine(source_, candidate, available, nullptr, frame);
  }

  /// Take frames for as long as one follows another without a fault, and move `at` past them. Returns true if the next
  /// one has a good head and must wait for more bytes.
  template <class Sink>
  WIREBOND_INLINE bool take_straight(const std::uint8_t* window, std::size_t size, std::size_t& at, Sink& sink) {
    const auto& fast_path = source_.fast_path();
    const std::size_t least = fast_path.least_by_start();
    const std::uint8_t* candidate = window + at;
    const std::uint8_t* const end = window + size;
    bool waits = false;
    const auto take = [&](const auto& head) WIREBOND_INLINE_LAMBDA {
      Frame frame;
      if (!fast_path.rest_holds(candidate, head, frame)) return false;
      deliver(frame, candidate, head.size, sink);
      candidate += head.size;
      return true;
    };
    if (needed_ != 0) {
      if (waiting_.size == needed_ && !take(waiting_)) return false;
      needed_ = 0;
    }
    while (static_cast<std::size_t>(end - candidate) >= least) {
      const std::size_t available = static_cast<std::size_t>(end - candidate);
      typename Source::FastPath::Head head;
      if (!fast_path.head_holds(source_, candidate, available, false, head)) break;
      waits = available < head.size;
      if (waits) {
        needed_ = static_cast<detail::Extent<Source>>(head.size);
        static_cast<typename Source::FastPath::Head&>(waiting_) = head;
        break;
      }
      if (!take(head)) break;
    }
    at = static_cast<std::size_t>(candidate - window);
    const std::size_t left = static_cast<std::size_t>(end - candidate);
    return waits || (left != 0 && fast_path.waits(candidate, left));
  }

  WIREBOND_INLINE std::size_t find_start(const std::uint8_t* bytes, std::size_t size) const {
    int start;
    if constexpr (Source::is_constant) {
      start = one_start(source_.format());
    } else {
      start = source_.start();
    }
    if (start < 0) {
      std::size_t i = 0;
      while (i < size && !may_start(bytes[i])) ++i;
      return i;
    }
    if (bytes[0] == start) return 0;
    if constexpr (Source::is_constant) {
      std::size_t i = 1;
      while (i < size && bytes[i] != start) ++i;
      return i;
    } else {
      const void* const found = std::memchr(bytes, start, size);
      return found == nullptr ? size : static_cast<std::size_t>(static_cast<const std::uint8_t*>(found) - bytes);
    }
  }

  /// For several forms, or one whose first byte is not entirely constant.
  bool may_start(std::uint8_t byte) const {
    constexpr bool unroll = Source::is_constant;
    constexpr detail::PartCounts most = detail::part_counts<Source>;
    const auto& format = source_.format();
    const auto differs = [&](std::size_t i) WIREBOND_INLINE_LAMBDA {
      const Form& form = format.forms[i];
      return !detail::every<unroll, most.constants>(
          0, form.prefix_constants, [&](std::size_t j) WIREBOND_INLINE_LAMBDA {
            const Constant& constant = form.constants[j];
            return constant.at.offset != 0 || (byte & constant.mask) == constant.value;
          });
    };
    return !detail::every<unroll, most.forms>(0, format.form_count, differs);
  }

  /// How many bytes to discard: one, because the next candidate may begin there. With skips_failed a candidate of known
  /// size is skipped whole, so that nothing in its payload is taken for a frame.
  std::size_t failed_bytes(const Verdict& verdict) const {
    const auto& format = source_.format();
    return format.skips_failed && verdict.bytes > detail::of_format<longest_prefix<detail::FormatOf<Source>>>(source_)
               ? verdict.bytes
               : 1;
  }

  // ---- frames between delimiters --------------------------------------------------------------------------------

  template <class Sink>
  WIREBOND_INLINE std::size_t consume_delimited(const std::uint8_t* window, std::size_t size, bool give_up,
                                                Sink&& sink) {
    const auto& format = source_.format();
    const Mark mark = format.closing;  // a copy: a reference would keep the whole format in flash
    const std::size_t longest = detail::of_format<max_wire_bytes<detail::FormatOf<Source>>>(source_);
    std::size_t at = 0;
    while (at < size) {
      const std::size_t opening = mark.stands_at(window + at, size - at) ? mark.size : 0;
      if (opening != 0 && !format.sends_opening) {  // it ends a block that is empty or was too long
        if (overlong_) {
          blame(Cause::length_out_of_range, opening);
          discard(opening);
        } else {
          fill(opening);
        }
        overlong_ = false;
        at += opening;
        continue;
      }
      if (opening != 0) {
        overlong_ = false;
        if (at + opening == size) {  // it opens a frame or is fill: the next byte decides
          if (!give_up) break;
          fill(opening);
          at = size;
          break;
        }
        if (mark.stands_at(window + at + opening, size - at - opening)) {
          fill(opening);
          at += opening;
          continue;
        }
      }
      const std::size_t begin = at + opening;
      const std::size_t end = detail::find_mark(mark, window, at == 0 && searched_ > begin ? searched_ : begin, size);
      searched_ = 0;
      // Of a two-byte mark, the first byte may have come already.
      const std::size_t known = end == size && !give_up && window[size - 1] == mark.first ? size + 1 - mark.size : size;
      if (overlong_) {  // the rest of a block that was too long already
        const std::size_t rest = (end < known ? end : known) - at;
        blame(Cause::length_out_of_range, rest);
        discard(rest);
        at += rest;
        if (end == size) break;
        continue;
      }
      if (end == size) {
        const std::size_t pending = size - at;
        if (pending >= longest) {
          reject(Cause::length_out_of_range, pending);
          discard(known - at);
          overlong_ = true;
          at = known;
        } else if (give_up) {
          reject(Cause::incomplete, pending);
          discard(pending);
          at = size;
        } else {
          searched_ = static_cast<detail::Extent<Source>>(known - at);
        }
        break;
      }
      Frame frame{};  // GCC 12 does not see that a frame's verdict sets its fields
      const Verdict verdict = examine_block(window + begin, end - begin, frame);
      if (verdict.outcome == Outcome::frame) {
        deliver(frame, window + at, end + mark.size - at, sink);
        at = end + mark.size;
      } else {  // the delimiter may open the next frame, unless senders mark only the end
        const std::size_t failed = end - at + (format.sends_opening ? 0 : mark.size);
        note_unlisted(frame, end + mark.size - at);
        reject(verdict.cause, failed);
        discard(failed);
        at += failed;
      }
    }
    return at;
  }

  // ---- an opening and a closing delimiter that differ -----------------------------------------------------------

  template <class Sink>
  WIREBOND_INLINE std::size_t consume_bracketed(const std::uint8_t* window, std::size_t size, bool give_up,
                                                Sink&& sink) {
    const auto& format = source_.format();
    const std::size_t longest = detail::of_format<max_wire_bytes<detail::FormatOf<Source>>>(source_);
    std::size_t at = 0;
    while (at < size) {
      const std::size_t start = detail::find_mark(format.opening, window, at, size);
      std::size_t skip = start - at;
      const bool half_a_mark = format.opening.size == 2 && window[size - 1] == format.opening.first;
      if (start == size && half_a_mark && !give_up) skip -= 1;
      if (skip != 0) discard(skip);
      at += skip;
      if (start == size) break;

      const std::size_t available = size - at < longest ? size - at : longest;
      const bool doubles = format.stuffing == Stuffing::escape && format.escapes.escape == format.opening.first;
      const detail::BlockEnd end = detail::find_block_end(format.opening, format.closing, doubles, window + at,
                                                          at == 0 ? searched_ : 0, available);
      searched_ = 0;
      Verdict verdict{Outcome::reject, Cause::incomplete, end.at};
      Frame frame{};  // GCC 12 does not see that a frame's verdict sets its fields
      if (end.kind == detail::BlockEnd::closing) {
        const std::size_t begin = at + format.opening.size;
        verdict = examine_block(window + begin, at + end.at - begin, frame);
        verdict.bytes = end.at + format.closing.size;
      } else if (end.kind == detail::BlockEnd::no_pair) {
        verdict.cause = Cause::bad_stuffing;
      } else if (end.kind == detail::BlockEnd::open) {
        verdict.bytes = available;
        if (available == longest) {
          verdict.cause = Cause::length_out_of_range;
        } else if (!give_up) {
          searched_ = static_cast<detail::Extent<Source>>(end.at);
          break;
        }
      }
      if (verdict.outcome == Outcome::frame) {
        deliver(frame, window + at, verdict.bytes, sink);
        at += verdict.bytes;
      } else {  // an opening delimiter may be inside: as data, or because the candidate began in garbage
        note_unlisted(frame, verdict.bytes);
        reject(verdict.cause, verdict.bytes);
        const bool is_closed = end.kind == detail::BlockEnd::closing;
        const std::size_t failed = format.skips_failed && is_closed ? verdict.bytes : 1;
        discard(failed);
        at += failed;
      }
    }
    return at;
  }

  // ---- frames between silences ----------------------------------------------------------------------------------

  /// `give_up`: the line was silent after the window, so the window is one block.
  template <class Sink>
  WIREBOND_INLINE std::size_t consume_silence(const std::uint8_t* window, std::size_t size, bool give_up, Sink&& sink) {
    const std::size_t longest = detail::of_format<max_frame_bytes<detail::FormatOf<Source>>>(source_);
    if (overlong_ || size > longest) {
      if (!overlong_) reject(Cause::length_out_of_range, size);
      blame(Cause::length_out_of_range, size);
      discard(size);
      overlong_ = !give_up;
      return size;
    }
    if (!give_up || size == 0) return 0;
    Frame frame;
    const Verdict verdict = examine_block(window, size, frame);
    if (verdict.outcome == Outcome::frame) {
      deliver(frame, window, size, sink);
    } else {
      note_unlisted(frame, size);
      reject(verdict.cause, size);
      discard(size);
    }
    return size;
  }

  /// If the block failed only by its id, the frame has that id and a size; if it failed otherwise, its size is 0.
  WIREBOND_INLINE Verdict examine_block(const std::uint8_t* block, std::size_t size, Frame& frame) {
    if constexpr (tells_unlisted) frame.size = 0;
    const std::size_t longest = detail::of_format<max_frame_bytes<detail::FormatOf<Source>>>(source_);
    const std::uint8_t* bytes = block;
    std::size_t unstuffed = size;
    const auto& format = source_.format();
    if (size > longest + stuffing_overhead(format, longest)) return {Outcome::reject, Cause::length_out_of_range, size};
    if constexpr (detail::may_be_stuffed<Source>()) {
      if (format.stuffing != Stuffing::none) {
        const std::ptrdiff_t result = unstuff(source_, block, size, scratch_);
        if (result < 0) return {Outcome::reject, Cause::bad_stuffing, size};
        bytes = scratch_;
        unstuffed = static_cast<std::size_t>(result);
      }
    }
    if constexpr (!Source::is_constant) {
      typename Source::FastPath::Head head;
      const auto& fast_path = source_.fast_path();
      if (unstuffed >= fast_path.least() && fast_path.head_holds(source_, bytes, unstuffed, true, head) &&
          fast_path.rest_holds(bytes, head, frame)) {
        return {Outcome::frame, Cause::no_start, unstuffed};
      }
    }
    const detail::Received received{block, size};
    Verdict verdict = examine(source_, bytes, unstuffed, &received, frame);
    if (verdict.outcome == Outcome::need_more) verdict = {Outcome::reject, Cause::length_out_of_range, unstuffed};
    if constexpr (tells_unlisted) {
      if (verdict.outcome != Outcome::frame) {
        const bool is_unlisted = verdict.cause == Cause::unknown_message &&
                                 detail::is_unlisted_block(source_, bytes, unstuffed, received, frame.id);
        frame.size = is_unlisted ? unstuffed : 0;
      }
    }
    return verdict;
  }

  // ---- accounting -----------------------------------------------------------------------------------------------

  template <class Sink>
  WIREBOND_INLINE void deliver(Frame& frame, const std::uint8_t* wire, std::size_t size, Sink& sink) {
    frame.wire = wire;
    frame.wire_size = size;
    frame.offset = settled_;
    account_.frame_bytes += static_cast<Counter>(size);
    account_.frames += 1;
    if (frame.message < 0) account_.unknown_frames += 1;
    settle(size);
    sink(static_cast<const Frame&>(frame));
  }

  /// Note a block that is not a frame and has `wire_size` bytes with its delimiters. examine_block sets the frame's
  /// size only if nothing but its id was wrong.
  WIREBOND_INLINE void note_unlisted(const Frame& frame, std::size_t wire_size) {
    if constexpr (tells_unlisted) {
      if (frame.size != 0) account_.unlisted.stands(settled_, frame.id, wire_size);
    } else {
      static_cast<void>(frame);
      static_cast<void>(wire_size);
    }
  }

  /// Called when a start byte is settled next. Where frames are escaped, candidates before it end here.
  WIREBOND_INLINE void cut_unlisted() {
    if constexpr (tells_unlisted && detail::may_be<Source>(Framing::sized)) {
      const auto& format = source_.format();
      if (grows_by_escapes(format) && detail::escapes_of(source_).starts != 0) {
        account_.unlisted.cut(settled_, format.plain_back);
      }
    }
  }

  /// Called when these bytes are settled next: escapes among them move the end of a frame that the file does not list.
  WIREBOND_INLINE void pass_unlisted(const std::uint8_t* bytes, std::size_t size) {
    if constexpr (tells_unlisted && detail::may_be<Source>(Framing::sized)) {
      if (grows_by_escapes(source_.format())) account_.unlisted.pass(source_, bytes, size, settled_);
    } else {
      static_cast<void>(bytes);
      static_cast<void>(size);
    }
  }

  void reject(Cause cause, std::size_t extent) {
    if constexpr (std::is_base_of_v<ByteAccount<Counter>, Account>) {
      account_.rejected_candidates[static_cast<std::size_t>(cause)] += 1;
    }
    blame(cause, extent);
  }

  /// Blame the bytes of a failed candidate on its cause; they count so if a rescan finds no frame in them. Where two
  /// overlap, the one that reaches further keeps the bytes from its start on.
  void blame(Cause cause, std::size_t extent) {
    if (extent > blamed_) {
      blamed_ = extent;
      blame_ = cause;
    }
  }

  void discard(std::size_t size) {
    const std::size_t known = size < blamed_ ? size : blamed_;
    account_.discarded_bytes[static_cast<std::size_t>(blame_)] += static_cast<Counter>(known);
    account_.discarded_bytes[static_cast<std::size_t>(Cause::no_start)] += static_cast<Counter>(size - known);
    settle(size);
  }

  void fill(std::size_t size) {
    account_.fill_bytes += static_cast<Counter>(size);
    settle(size);
  }

  WIREBOND_INLINE void settle(std::size_t size) {
    settled_ += static_cast<Counter>(size);
    if (blamed_ != 0) blamed_ = size < blamed_ ? blamed_ - size : 0;
  }

  // Small members together: a constant source and its waiting head take no bytes of their own.
  Source source_;
  detail::WaitingHead<Source> waiting_;  ///< by start: head of the candidate that waits for needed_ bytes
  Cause blame_ = Cause::no_start;
  bool overlong_ = false;                ///< inside a block longer than any frame
  detail::Extent<Source> needed_ = 0;    ///< by start: the candidate at the front was examined; this many bytes decide
  detail::Extent<Source> searched_ = 0;  ///< delimiters: the first bytes of the window that hold no end of the block
  std::size_t blamed_ = 0;               ///< bytes from here on that belong to a failed candidate
  std::uint8_t* scratch_;
  Counter settled_ = 0;
  Account account_{};
};

}  // namespace wirebond
