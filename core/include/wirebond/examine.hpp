// Decides for one candidate: it is a frame, it is not one, or more bytes are needed. No state, no position in a stream.
// One file: the rules are in the order in which they can first be decided.
#pragma once

#include <cstddef>
#include <cstdint>

#include "wirebond/format.hpp"
#include "wirebond/match.hpp"
#include "wirebond/payload_rules.hpp"
#include "wirebond/placed_number.hpp"
#include "wirebond/source.hpp"
#include "wirebond/stuffing.hpp"
#include "wirebond/unroll.hpp"

namespace wirebond {

/// Why bytes were thrown away. The names are the same in every language and in the manual.
enum class Cause : std::uint8_t {
  no_start,               ///< between frames: bytes that start nothing
  constant_mismatch,      ///< a magic, constant or tail has another value, or a constant among the message's fields
  length_out_of_range,    ///< the length is more than max_payload, or negative
  unknown_message,        ///< `unknown: reject`: no such id, or a payload of another size
  header_check_mismatch,  ///< a check over the header alone
  check_mismatch,         ///< a check that needs the whole frame
  bad_stuffing,           ///< not a possible result of the stuffing
  incomplete,             ///< the line fell silent inside it
};
constexpr std::size_t cause_count = 8;

/// A frame that passed every check. Pointers are valid during the call that hands it out. No member has a first value:
/// that would be written for every frame and never read.
struct Frame {
  const std::uint8_t* wire;  ///< as received, delimiters included
  std::size_t wire_size;
  const std::uint8_t* payload;
  std::size_t payload_size;
  const std::uint8_t* bytes;  ///< the frame without stuffing and delimiters
  std::size_t size;
  std::uint32_t id;      ///< 0 where the frame has none
  std::uint8_t form;     ///< index of the one that held, of the format's forms
  std::int16_t message;  ///< index of the message; -1: unknown id, or a payload too short for it
  std::uint64_t offset;  ///< of its first wire byte since the deframer started (modulo its counter)
};

enum class Outcome : std::uint8_t { frame, need_more, reject };

struct Verdict {
  Outcome outcome = Outcome::reject;
  Cause cause = Cause::no_start;
  /// frame: its size; need_more: look again when this many bytes are there; reject: this many bytes were the
  /// candidate's.
  std::size_t bytes = 0;
};

/// Check whether an MCU's link counts frames of messages that the file does not list (unlisted.hpp). It does where
/// checks include a seed of each message: then all other messages of a peer are refused by their id, however strong the
/// check is. A weak check alone is not worth the flash.
template <class Format>
constexpr bool counts_unlisted(const Format& format) {
  const Form& form = format.forms[0];
  bool is_seeded = false;
  for (std::size_t i = 0; i < form.check_count; ++i) is_seeded = is_seeded || form.checks[i].seeded;
  const bool is_by_start = format.framing == Framing::by_start || format.framing == Framing::sized;
  const bool is_found = is_by_start && form.prefix_constants != 0 && form.payload_size != PayloadSize::by_id;
  return is_seeded && form.id.present() && (is_found || has_marks(format) || format.framing == Framing::silence);
}

namespace detail {

/// Read `bytes` bytes written as hex digits of either case. Returns false if one is not a digit.
inline bool read_hex(const std::uint8_t* digits, unsigned bytes, std::uint64_t& value) {
  value = 0;
  for (unsigned i = 0; i < 2 * bytes; ++i) {
    const int digit = hex_digit(digits[i]);
    if (digit < 0) return false;
    value = (value << 4) | static_cast<std::uint64_t>(digit);
  }
  return true;
}

/// A candidate as it was received, without delimiters. If nothing is stuffed, unstuffing does not change it.
struct Received {
  const std::uint8_t* bytes;
  std::size_t size;
};

template <class Source>
WIREBOND_INLINE bool check_holds(const Source& source, const Form& form, std::size_t index, const std::uint8_t* frame,
                                 std::size_t frame_size, const Received& received, std::uint8_t seed,
                                 CheckRegisters<Source>& registers) {
  constexpr PartCounts most = part_counts<Source>;
  const CheckRule& rule = form.checks[index];
  if constexpr (most.is_on_wire) {
    if (rule.on_wire) {  // it begins and ends outside the stuffed bytes, so that its places are the same
      frame = received.bytes;
      frame_size = received.size;
    }
  }
  std::size_t from = rule.from.in(frame_size);
  const std::size_t to = rule.to.in(frame_size);
  std::uint64_t reg;
  bool begins = true;
  if constexpr (most.is_continued) begins = rule.continues < 0;
  if (begins) {
    reg = begin_of(source, rule.algorithm);
  } else {  // what the earlier check covered is not run over again
    reg = registers.of[rule.continues];
    from = form.checks[static_cast<std::size_t>(rule.continues)].to.in(frame_size);
  }
  if constexpr (most.is_in_bits) {
    reg = over_range(source, rule, reg, frame, from, to, frame_size);
  } else {
    reg = source.check_update(rule.algorithm, reg, frame + from, to - from);
  }
  if constexpr (most.more_ranges != 0) reg = over_more_ranges(source, rule, reg, frame, frame_size);
  if constexpr (most.is_continued) registers.of[index] = reg;
  if constexpr (most.is_seeded) {
    if (rule.seeded) reg = source.check_update(rule.algorithm, reg, &seed, 1);
  }
  if constexpr (may_take_words<Source>()) {
    if (is_refused(source.format().algorithms[rule.algorithm], reg)) return false;
  }
  if constexpr (most.is_in_bits) {
    const std::uint64_t value = end_of(source, rule.algorithm, reg) >> rule.shift;
    if (rule.run.present()) return (value & rule.run.mask) == read_wide(rule.run, frame, frame_size);
  }
  const std::uint64_t expected = (end_of(source, rule.algorithm, reg) >> rule.shift) & mask_of(8u * rule.bytes);
  const std::uint8_t* const at = frame + rule.at.in(frame_size);
  std::uint64_t found;
  if constexpr (most.is_hex) {
    if (rule.as_hex) return read_hex(at, rule.bytes, found) && expected == found;
  }
  switch (rule.bytes) {
    case 1: found = at[0]; break;
    case 2:
      found = rule.order == ByteOrder::little ? load<std::uint16_t>(at) : load<std::uint16_t, ByteOrder::big>(at);
      break;
    default: found = load_bytes(at, rule.bytes, rule.order); break;
  }
  if (Source::is_constant && rule.bytes <= 4) return static_cast<std::uint32_t>(expected ^ found) == 0;
  return expected == found;
}

/// Check whether a candidate that fails only by its id has its size computed. Firmware that does not count such
/// candidates has no code for it.
template <class Source>
constexpr bool tells_unlisted_size() {
  if constexpr (folds<Source>(0)) {
    return counts_unlisted(Source{}.format());
  } else {
    return true;
  }
}

/// Results of reading the bytes before the payload.
template <class Source>
struct Head {
  MessageShape shape{};
  std::uint32_t id = 0;
  std::size_t payload = 0;           ///< its size
  std::size_t size = 0;              ///< of the whole frame
  CheckRegisters<Source> registers;  ///< of the checks that were run; others are never read
};

/// Check whether the message can have a payload of this size.
WIREBOND_INLINE bool fits(const Form& form, const MessageShape& shape, std::size_t payload) {
  const bool size_is_free = form.payload_size == PayloadSize::by_length || form.payload_size == PayloadSize::rest;
  const bool long_enough = form.trims_zeros || payload >= shape.min_payload;
  return shape.known() && (!size_is_free || (long_enough && payload <= shape.max_payload));
}

/// Check whether a payload has more bytes than its message's counts allow. False where the format has no such rule.
template <class Source>
WIREBOND_INLINE bool is_overlong(const Source& source, const MessageShape& shape, const std::uint8_t* payload,
                                 std::size_t size) {
  if constexpr (BoundsByCounts<Source>::value) {
    return shape.known() &&
           exceeds_counts<CountsBytes<Source>::value>(source.payload_rules(shape.index), payload, size);
  } else {
    static_cast<void>(source), static_cast<void>(shape), static_cast<void>(payload), static_cast<void>(size);
    return false;
  }
}

/// Check whether the message is known before its payload. If there is no id and each message has its own payload size,
/// it is: there is only one message without an id, or it is the expected reply.
WIREBOND_INLINE bool id_comes_early(const Form& form) {
  if (!form.id.present()) return form.payload_size == PayloadSize::by_id;
  return !form.id.at.from_end && form.id.at.offset + form.id.bytes <= static_cast<std::int32_t>(form.prefix);
}

/// Check whether a message is identified by bytes that may be missing when the head is examined.
template <class Source>
WIREBOND_INLINE bool does_match_late(const Source& source) {
  if constexpr (HasMatch<Source>::value) {
    return source.matches_late();
  } else {
    static_cast<void>(source);
    return false;
  }
}

/// Return the payload's size before its trailing zeros were trimmed, as far as the message defines it.
WIREBOND_INLINE std::size_t restored(const Form& form, const MessageShape& shape, std::size_t payload) {
  return form.trims_zeros && payload < shape.min_payload ? shape.min_payload : payload;
}

/// Return the message of a frame of this form, by its id, or by the tests of match.hpp. A form without an id has the
/// message of frames without one. `payload`: payload bytes in the frame of `size` bytes; 0: only its head is known.
template <class Source>
WIREBOND_INLINE MessageShape shape_of(const Source& source, const Form& form, std::uint32_t id,
                                      [[maybe_unused]] const std::uint8_t* frame, [[maybe_unused]] std::size_t size,
                                      [[maybe_unused]] std::size_t payload) {
  if constexpr (HasMatch<Source>::value) {
    if (source.matches()) return matched(source, form, frame, size, payload, id);
  }
  const std::uint32_t no_id = source.format().no_id;
  if (!form.id.present()) return source.message(no_id);
  if (no_id != 0 && id == no_id) return {};
  return source.message(id);
}

/// Apply the rules that the prefix decides, each as soon as its bytes are there. Outcome::frame: they hold.
/// `whole`: the candidate's size is known to be `available` (it lay between delimiters).
template <class Source>
WIREBOND_INLINE Verdict examine_head(const Source& source, const Form& form, const std::uint8_t* candidate,
                                     std::size_t available, bool whole, Head<Source>& head) {
  constexpr bool unroll = Source::is_constant;
  const auto& format = source.format();

  // Constants first.
  std::size_t need = 0;
  bool mismatch = false;
  every<unroll, part_counts<Source>.constants>(0, form.prefix_constants, [&](std::size_t i) WIREBOND_INLINE_LAMBDA {
    const Constant& constant = form.constants[i];
    const std::size_t at = static_cast<std::size_t>(constant.at.offset);
    if (at >= available) {
      need = at + 1;
      return false;
    }
    mismatch = (candidate[at] & constant.mask) != constant.value;
    return !mismatch;
  });
  if (mismatch) return {Outcome::reject, Cause::constant_mismatch, 1};
  // Values other than constants that distinguish the form from others. They are tested even if a later constant has not
  // come yet.
  constexpr std::size_t exclusions = part_counts<Source>.exclusions;
  if constexpr (exclusions != 0) {
    const auto allows = [&](std::size_t i) WIREBOND_INLINE_LAMBDA {
      const Exclusion& exclusion = format.exclusions[form.first_exclusion + i];
      if (exclusion.subject == Subject::size) return true;
      const std::size_t end = static_cast<std::size_t>(exclusion.number.at.offset) + exclusion.number.bytes;
      if (end > available) {
        if (need == 0 || end < need) need = end;
        return true;
      }
      const std::uint64_t value = read_wide(exclusion.number, candidate, 0);
      return value < exclusion.low || exclusion.high < value;
    };
    if (!every<unroll, exclusions>(0, form.exclusion_count, allows)) {
      return {Outcome::reject, Cause::constant_mismatch, 1};
    }
  }
  if (need != 0) return {Outcome::need_more, Cause::incomplete, need};
  if (available < form.prefix) return {Outcome::need_more, Cause::incomplete, form.prefix};

  // The id, if it comes early, and the payload's size.
  const bool has_early_id = id_comes_early(form);
  const bool is_late = does_match_late(source);
  const bool early = has_early_id && !is_late;  // the message is known by the head
  if (has_early_id && form.id.present()) head.id = read_number(form.id, candidate, 0);
  // Without an id: one message, known before its seed is counted.
  const bool is_told = early || (!form.id.present() && !is_late);
  const bool tells_size =
      form.payload_size == PayloadSize::by_id;  // otherwise a size out of range is refused without finding the message
  if constexpr (may_have<Source>(PayloadSize::by_id)) {
    if (is_told && tells_size) head.shape = shape_of(source, form, head.id, candidate, 0, 0);
  }
  std::size_t payload = form.fixed_payload;
  const std::size_t outside = static_cast<std::size_t>(form.prefix) + form.suffix;
  const PayloadSize kind = form.payload_size;
  if constexpr (may_have<Source>(PayloadSize::by_length)) {
    if (kind == PayloadSize::by_length) {
      const std::int64_t size =
          static_cast<std::int64_t>(read_number(form.length, candidate, 0)) * form.length_unit + form.length_bias;
      std::int64_t most = format.max_payload;
      if constexpr (may_be<Source>(Framing::sized)) {
        constexpr auto longest = max_frame_bytes<FormatOf<Source>>;
        if (format.length_on_wire)
          most += static_cast<std::int64_t>(stuffing_overhead(format, of_format<longest>(source)));
      }
      if (size < 0 || size > most) return {Outcome::reject, Cause::length_out_of_range, form.prefix};
      payload = static_cast<std::size_t>(size);
      if constexpr (may_be<Source>(Framing::sized)) {
        if (format.length_on_wire && whole) {  // known now that nothing is stuffed any more
          if (available < outside || available - outside > format.max_payload) {
            return {Outcome::reject, Cause::length_out_of_range, available};
          }
          payload = available - outside;
        }
      }
    }
  }
  if constexpr (may_have<Source>(PayloadSize::by_id)) {
    if (kind == PayloadSize::by_id) {
      if (!head.shape.known()) return {Outcome::reject, Cause::unknown_message, form.prefix};
      payload = head.shape.max_payload;
      if constexpr (HasPayloadRules<Source>::value) {
        if (head.shape.min_payload != head.shape.max_payload) {  // its counts decide
          const ToldSize told =
              told_size<CountsBytes<Source>::value>(source.payload_rules(head.shape.index), candidate + form.prefix,
                                                    available - form.prefix, head.shape.min_payload);
          if (told.need != 0) return {Outcome::need_more, Cause::incomplete, form.prefix + told.need};
          if (!told.is_told) return {Outcome::reject, Cause::length_out_of_range, form.prefix};
          payload = told.size;
        }
      }
    }
  }
  if constexpr (may_have<Source>(PayloadSize::rest)) {
    if (kind == PayloadSize::rest) {
      if (available < outside || available - outside > format.max_payload) {
        return {Outcome::reject, Cause::length_out_of_range, available};
      }
      payload = available - outside;
    }
  }
  if (is_told && !tells_size) head.shape = shape_of(source, form, head.id, candidate, 0, payload);
  if constexpr (exclusions != 0) {
    const bool size_tells = is_told || !form.trims_zeros;  // else examine_rest asks
    if (size_tells && size_is_excluded<unroll, exclusions>(format, form, restored(form, head.shape, payload))) {
      return {Outcome::reject, Cause::length_out_of_range, form.prefix};
    }
  }
  if constexpr (tells_unlisted_size<Source>()) {
    head.payload = payload;
    head.size = outside + payload;
  }
  const bool is_known = whole || !format.length_on_wire;  // the payload's size
  if (early && !format.deliver_unknown && is_known && !fits(form, head.shape, payload)) {
    return {Outcome::reject, Cause::unknown_message, form.prefix};
  }

  // Checks of the header, before more bytes are awaited because of its length.
  constexpr std::size_t header_checks = part_counts<Source>.header_checks;
  if constexpr (header_checks != 0) {
    const bool header_holds =
        every<unroll, header_checks>(0, form.header_checks, [&](std::size_t i) WIREBOND_INLINE_LAMBDA {
          return check_holds(source, form, i, candidate, form.prefix, {candidate, form.prefix}, head.shape.seed,
                             head.registers);
        });
    if (!header_holds) return {Outcome::reject, Cause::header_check_mismatch, form.prefix};
  }

  head.payload = payload;
  head.size = outside + payload;
  if (whole && available != head.size) return {Outcome::reject, Cause::length_out_of_range, available};
  return {Outcome::frame, Cause::no_start, head.size};
}

WIREBOND_INLINE void fill(Frame& frame, const Form& form, std::size_t index, const std::uint8_t* candidate,
                          const MessageShape& shape, std::uint32_t id, std::size_t payload, std::size_t size,
                          bool trims_zeros) {
  frame.payload = candidate + form.prefix;
  frame.payload_size = payload;
  frame.bytes = candidate;
  frame.size = size;
  frame.form = static_cast<std::uint8_t>(index);
  frame.id = id;
  const bool long_enough = trims_zeros || payload >= shape.min_payload;
  frame.message = long_enough ? shape.index : std::int16_t{-1};
}

/// Apply the rules that need the whole frame, after examine_head.
template <class Source>
WIREBOND_INLINE Verdict examine_rest(const Source& source, const Form& form, std::size_t index,
                                     const std::uint8_t* candidate, std::size_t available, const Received* block,
                                     Head<Source>& head, Frame& frame) {
  constexpr bool unroll = Source::is_constant;
  const std::size_t size = head.size;
  if (available < size) return {Outcome::need_more, Cause::incomplete, size};

  // Constants of the suffix are cheaper than a check over the whole frame.
  const bool tail_holds = every<unroll, part_counts<Source>.constants>(
      form.prefix_constants, form.constant_count, [&](std::size_t i) WIREBOND_INLINE_LAMBDA {
        const Constant& constant = form.constants[i];
        return (candidate[constant.at.in(size)] & constant.mask) == constant.value;
      });
  if (!tail_holds) return {Outcome::reject, Cause::constant_mismatch, size};
  if (!id_comes_early(form) || does_match_late(source)) {
    head.id = form.id.present() ? read_number(form.id, candidate, size) : 0;
    head.shape = shape_of(source, form, head.id, candidate, size, head.payload);
    constexpr std::size_t exclusions = part_counts<Source>.exclusions;
    if constexpr (exclusions != 0) {
      if (form.trims_zeros &&
          size_is_excluded<unroll, exclusions>(source.format(), form, restored(form, head.shape, head.payload))) {
        return {Outcome::reject, Cause::length_out_of_range, size};
      }
    }
    if (!source.format().deliver_unknown && !fits(form, head.shape, head.payload)) {
      return {Outcome::reject, Cause::unknown_message, size};
    }
  }
  if (is_overlong(source, head.shape, candidate + form.prefix, head.payload)) {
    return {Outcome::reject, Cause::unknown_message, size};
  }
  if constexpr (HasPayloadRules<Source>::value) {
    const bool long_enough = form.trims_zeros || head.payload >= head.shape.min_payload;
    if (head.shape.known() && long_enough &&
        !payload_holds<CountsBytes<Source>::value>(source.payload_rules(head.shape.index), candidate + form.prefix,
                                                   head.payload, form.trims_zeros)) {
      return {Outcome::reject, Cause::constant_mismatch, size};
    }
  }
  const Received received = block != nullptr ? *block : Received{candidate, size};
  bool checks_hold = true;
  constexpr PartCounts most = part_counts<Source>;
  if constexpr (most.checks == 1 && most.header_checks == 0) {  // as most formats have it
    if (form.check_count != 0) {
      checks_hold = check_holds(source, form, 0, candidate, size, received, head.shape.seed, head.registers);
    }
  } else {
    checks_hold =
        every<unroll, most.checks>(form.header_checks, form.check_count, [&](std::size_t i) WIREBOND_INLINE_LAMBDA {
          return check_holds(source, form, i, candidate, size, received, head.shape.seed, head.registers);
        });
  }
  if (!checks_hold) return {Outcome::reject, Cause::check_mismatch, size};

  fill(frame, form, index, candidate, head.shape, head.id, head.payload, size, form.trims_zeros);
  return {Outcome::frame, Cause::no_start, size};
}

/// Apply the rules of one form to `available` bytes at `candidate`, in the order in which they can first be decided.
/// `block`: the candidate before unstuffing; null: it is part of a stream, and nothing is stuffed. If the cause is
/// unknown_message, `frame` has the id, and the size if the head gives it. If a length may end the frame, need_more
/// leaves the frame's size in `frame`; 0: not known yet.
template <class Source>
WIREBOND_INLINE Verdict examine_form(const Source& source, std::size_t index, const std::uint8_t* candidate,
                                     std::size_t available, const Received* block, Frame& frame) {
  const Form& form = source.format().forms[index];
  Head<Source> head;
  if constexpr (Source::is_constant) {  // folds to nothing; GCC 12 does not see everywhere that they are written first
    head.registers = {};
  }
  const Verdict verdict = examine_head(source, form, candidate, available, block != nullptr, head);
  if (verdict.outcome != Outcome::frame) {
    if constexpr (tells_unlisted_size<Source>()) {
      if (verdict.cause == Cause::unknown_message) {
        frame.id = head.id;
        frame.size = head.size;
      }
    }
    if constexpr (may_be<Source>(Framing::sized)) {
      if (verdict.outcome == Outcome::need_more) frame.size = 0;
    }
    return verdict;
  }
  const Verdict whole = examine_rest(source, form, index, candidate, available, block, head, frame);
  if constexpr (may_be<Source>(Framing::sized)) {
    if (whole.outcome == Outcome::need_more) frame.size = head.size;
  }
  if constexpr (tells_unlisted_size<Source>()) {
    if (whole.cause == Cause::unknown_message) {
      frame.id = head.id;
      frame.size = head.size;
    }
  }
  return whole;
}

/// Find the first form that holds. If none does, report the form that got furthest: of two with equally many bytes, the
/// one whose cause is decided later. A form whose presence bits or sizes differ was not meant, so it does not count.
template <class Source>
WIREBOND_INLINE Verdict examine_forms(const Source& source, const std::uint8_t* candidate, std::size_t available,
                                      const Received* block, Frame& frame) {
  const auto& format = source.format();
  if constexpr (Source::is_constant) {
    if (format.form_count == 1) return examine_form(source, 0, candidate, available, block, frame);
  }
  Verdict best{Outcome::reject, Cause::constant_mismatch, 0};
  const auto examine_next = [&](std::size_t i) WIREBOND_INLINE_LAMBDA {
    const Verdict verdict = examine_form(source, i, candidate, available, block, frame);
    const bool further =
        verdict.bytes > best.bytes || (verdict.bytes == best.bytes && verdict.cause > best.cause);  // in their order
    const bool better =
        i == 0 || verdict.outcome == Outcome::frame ||
        (verdict.outcome == Outcome::need_more ? best.outcome != Outcome::need_more || verdict.bytes < best.bytes
                                               : best.outcome != Outcome::need_more && further);
    if (better) best = verdict;
    return verdict.outcome != Outcome::frame;
  };
  every<Source::is_constant, part_counts<Source>.forms>(0, format.form_count, examine_next);
  return best;
}

/// For a format read at run time: one function that is called. It handles what the fast path leaves; inlined at each
/// call it would be most of a program.
template <class Source>
WIREBOND_NOINLINE Verdict examine_by_call(const Source& source, const std::uint8_t* candidate, std::size_t available,
                                          const Received* block, Frame& frame) {
  return examine_forms(source, candidate, available, block, frame);
}

}  // namespace detail

/// Examine the bytes at `candidate`. Pure: the verdict depends on these bytes alone, so chunking cannot change it.
/// `block`: the candidate before unstuffing, if its size is known to be `available`; otherwise null.
/// Any thread or interrupt. Work is bounded by one pass over max_frame_bytes per form.
template <class Source>
WIREBOND_INLINE Verdict examine(const Source& source, const std::uint8_t* candidate, std::size_t available,
                                const detail::Received* block, Frame& frame) {
  if constexpr (detail::folds<Source>(0) && detail::part_counts<Source>.forms == 1) {
    return detail::examine_form(source, 0, candidate, available, block, frame);
  } else if constexpr (Source::is_constant) {
    return detail::examine_forms(source, candidate, available, block, frame);
  } else {
    return detail::examine_by_call(source, candidate, available, block, frame);
  }
}

}  // namespace wirebond
