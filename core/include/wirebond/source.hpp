// Provides the algorithms with a format, and decides what they can leave out where it is a constant.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <type_traits>
#include <utility>

#include "wirebond/check.hpp"
#include "wirebond/format.hpp"
#include "wirebond/placed_number.hpp"
#include "wirebond/unroll.hpp"

namespace wirebond {

// A *source* provides the format. The algorithms are templates over it:
//
//   struct Source {
//     static constexpr bool is_constant;               // true: loops over parts unroll and fold
//     const FrameFormat& format() const;               // or another SizedFormat
//     MessageShape message(std::uint32_t id) const;
//     void expect(std::int16_t index);  // the message that message() returns from now on, if several share its id
//     std::uint64_t check_update(unsigned algorithm, std::uint64_t reg, const std::uint8_t*, std::size_t) const;
//     // only where more than an id distinguishes messages (match.hpp):
//     bool matches() const; bool matches_late() const; template <class Asked> MessageShape match(const Asked&) const;
//     PayloadRules payload_rules(std::int16_t index) const;  // only where a message has some (payload_rules.hpp)
//     // only if not a constant: the fast path (host/fast_path.hpp), and the results of check_begin and check_end
//     using FastPath; const FastPath& fast_path() const;
//     int start() const;  // one_start(format())
//     bool ends_by_silence() const;  // framing is Framing::silence
//     std::uint64_t check_begin_of(unsigned algorithm) const;
//     std::uint64_t check_end_of(unsigned algorithm, std::uint64_t reg) const;
//   };
//
// Generated code has a constant source for each sender; the other kind is in runtime_source.hpp.

namespace detail {

/// Type of the source's format: a constant holds only its own forms.
template <class Source>
using FormatOf = std::decay_t<decltype(std::declval<const Source&>().format())>;

/// Check whether the compiler knows the source's format. A source may use the algorithms of a constant and still hold
/// values read at run time, as tests do that compile once for many formats.
template <class Source, std::size_t = Source{}.format().form_count>
constexpr bool folds(int) {
  return Source::is_constant;
}
template <class Source>
constexpr bool folds(...) {
  return false;
}

/// The format's rule for escapes, and that for insertions. For a format that folds, each is a constant of its own:
/// functions that take it by reference keep nothing else of the format in memory.
template <class Source>
inline constexpr EscapeRule constant_escapes = Source{}.format().escapes;
template <class Source>
inline constexpr InsertionRule constant_insertion = Source{}.format().insertion;
template <class Source>
WIREBOND_INLINE const EscapeRule& escapes_of(const Source& source) {
  if constexpr (folds<Source>(0)) {
    return constant_escapes<Source>;
  } else {
    return source.format().escapes;
  }
}
template <class Source>
WIREBOND_INLINE const InsertionRule& insertion_of(const Source& source) {
  if constexpr (folds<Source>(0)) {
    return constant_insertion<Source>;
  } else {
    return source.format().insertion;
  }
}

/// How many forms a format has, and the maximum number of parts of each kind in one form.
struct PartCounts {
  std::size_t forms = 0;
  std::size_t constants = 0;
  std::size_t header_fields = 0;
  std::size_t checks = 0;
  std::size_t exclusions = 0;
  std::size_t header_checks = 0;
  bool payload_sizes[4] = {};  ///< by PayloadSize: some form uses it
  // True if some check is like this:
  bool is_seeded = false;
  bool is_hex = false;
  bool is_on_wire = false;
  bool is_continued = false;
  std::size_t more_ranges = 0;  ///< of one check, after its first
  bool is_in_bits = false;
};

/// Check whether the source's frames may be found this way. If the format folds, code for other ways is not even
/// compiled: a build with little optimisation would keep it.
template <class Source>
constexpr bool may_be(Framing framing) {
  if constexpr (folds<Source>(0)) {
    return Source{}.format().framing == framing;
  } else {
    return true;
  }
}

/// Check whether its frames may be stuffed.
template <class Source>
constexpr bool may_be_stuffed() {
  if constexpr (folds<Source>(0)) {
    return Source{}.format().stuffing != Stuffing::none;
  } else {
    return true;
  }
}

template <class Source>
constexpr PartCounts count_parts() {
  if constexpr (folds<Source>(0)) {
    PartCounts most;
    most.forms = Source{}.format().form_count;
    const auto raise = [](std::size_t& count, std::size_t other) { count = count < other ? other : count; };
    for (std::size_t i = 0; i < Source{}.format().form_count; ++i) {
      const Form& form = Source{}.format().forms[i];
      raise(most.constants, form.constant_count);
      raise(most.header_fields, form.header_count);
      raise(most.checks, form.check_count);
      raise(most.exclusions, form.exclusion_count);
      raise(most.header_checks, form.header_checks);
      most.payload_sizes[static_cast<std::size_t>(form.payload_size)] = true;
      for (std::size_t c = 0; c < form.check_count; ++c) {
        most.is_seeded = most.is_seeded || form.checks[c].seeded;
        most.is_hex = most.is_hex || form.checks[c].as_hex;
        most.is_on_wire = most.is_on_wire || form.checks[c].on_wire;
        most.is_continued = most.is_continued || form.checks[c].continues >= 0;
        raise(most.more_ranges, form.checks[c].more_count);
        most.is_in_bits = most.is_in_bits || form.checks[c].run.present();
      }
    }
    return most;
  } else {
    return {max_forms,
            max_constants,
            max_header_fields,
            max_checks,
            max_exclusions,
            max_checks,
            {true, true, true, true},
            true,
            true,
            true,
            true,
            max_check_ranges - 1,
            true};
  }
}

/// How often a loop over parts is unrolled: the compiler spends no time on parts that a constant format does not have.
template <class Source>
inline constexpr PartCounts part_counts = count_parts<Source>();

/// Check whether a form of the source may determine its payload's size this way.
template <class Source>
constexpr bool may_have(PayloadSize size) {
  return part_counts<Source>.payload_sizes[static_cast<std::size_t>(size)];
}

/// Run a check over [from, to) in a frame of `size` bytes. Its own bits count as zeros.
template <class Source>
WIREBOND_INLINE std::uint64_t over_range(const Source& source, const CheckRule& rule, std::uint64_t reg,
                                         const std::uint8_t* frame, std::size_t from, std::size_t to,
                                         [[maybe_unused]] std::size_t size) {
  if constexpr (part_counts<Source>.is_in_bits) {
    const std::size_t at = rule.covers_run ? rule.run.at.in(size) : to;
    if (from <= at && at < to) {
      std::uint8_t own[sizeof(std::uint64_t)];
      Number run = rule.run;
      run.at = {};
      for (unsigned i = 0; i < run.bytes; ++i) own[i] = frame[at + i];
      clear_number(run, own, 0);
      reg = source.check_update(rule.algorithm, reg, frame + from, at - from);
      reg = source.check_update(rule.algorithm, reg, own, run.bytes);
      from = at + run.bytes;
    }
  }
  return source.check_update(rule.algorithm, reg, frame + from, to - from);
}

/// Run a check over its ranges after the first one, in a frame of `size` bytes.
template <class Source>
WIREBOND_INLINE std::uint64_t over_more_ranges(const Source& source, [[maybe_unused]] const CheckRule& rule,
                                               std::uint64_t reg, const std::uint8_t* frame, std::size_t size) {
  every<Source::is_constant, part_counts<Source>.more_ranges>(
      0, rule.more_count, [&](std::size_t i) WIREBOND_INLINE_LAMBDA {
        const CheckRange& range = rule.more[i];
        reg = over_range(source, rule, reg, frame, range.from.in(size), range.to.in(size), size);
        return true;
      });
  return reg;
}

/// Registers of a frame's checks; those that a later check continues are kept.
template <class Source>
struct CheckRegisters {
  static constexpr bool are_kept = part_counts<Source>.is_continued;
  std::uint64_t of[are_kept ? max_checks : 1];
};

/// Place of the header field `Place` in each form of a format that folds. Takes a few bytes; reading the format at run
/// time could keep all of it in memory.
template <class Source, std::size_t Place>
constexpr std::array<Number, part_counts<Source>.forms> make_field_numbers() {
  std::array<Number, part_counts<Source>.forms> numbers{};
  for (std::size_t i = 0; i < numbers.size(); ++i) {
    numbers[i] = number_at(Source{}.format().forms[i], static_cast<std::uint8_t>(Place));
  }
  return numbers;
}
template <class Source, std::size_t Place>
inline constexpr auto field_numbers = make_field_numbers<Source, Place>();

/// Call a function of the format, such as `max_wire_bytes`; the compiler evaluates it if the format folds.
template <auto Function, class Source>
WIREBOND_INLINE auto of_format(const Source& source) {
  if constexpr (folds<Source>(0)) {
    constexpr auto value = Function(Source{}.format());
    return value;
  } else {
    return Function(source.format());
  }
}

/// `check_begin` of each algorithm of a format that folds.
template <class Source>
constexpr auto make_check_begins() {
  std::array<std::uint64_t, max_algorithms> begins{};
  for (std::size_t i = 0; i < Source{}.format().algorithm_count; ++i) {
    begins[i] = check_begin(Source{}.format().algorithms[i]);
  }
  return begins;
}
template <class Source>
inline constexpr auto check_begins = make_check_begins<Source>();

/// Check whether a register of the source may be reflected at its end. If the format folds, unneeded code is not even
/// compiled.
template <class Source>
constexpr bool may_reflect() {
  if constexpr (folds<Source>(0)) {
    for (std::size_t i = 0; i < Source{}.format().algorithm_count; ++i) {
      if (reflects_end(Source{}.format().algorithms[i])) return true;
    }
    return false;
  } else {
    return true;
  }
}

/// Check whether the unit of some check of the source may be a word.
template <class Source>
constexpr bool may_take_words() {
  if constexpr (folds<Source>(0)) {
    for (std::size_t i = 0; i < Source{}.format().algorithm_count; ++i) {
      if (Source{}.format().algorithms[i].unit > 1) return true;
    }
    return false;
  } else {
    return true;
  }
}

/// Check whether a check of the source may send its value in another form.
template <class Source>
constexpr bool may_send_otherwise() {
  if constexpr (folds<Source>(0)) {
    for (std::size_t i = 0; i < Source{}.format().algorithm_count; ++i) {
      if (is_sent_otherwise(Source{}.format().algorithms[i])) return true;
    }
    return false;
  } else {
    return true;
  }
}

/// Register before the first byte.
template <class Source>
WIREBOND_INLINE std::uint64_t begin_of(const Source& source, unsigned algorithm) {
  if constexpr (folds<Source>(0)) {
    return check_begins<Source>[algorithm];
  } else if constexpr (Source::is_constant) {
    return check_begin(source.format().algorithms[algorithm]);
  } else {
    return source.check_begin_of(algorithm);
  }
}

/// Return the check's value, computed from the register after the last byte.
template <class Source>
WIREBOND_INLINE std::uint64_t end_of(const Source& source, unsigned algorithm, std::uint64_t reg) {
  if constexpr (Source::is_constant && !may_reflect<Source>() && !may_take_words<Source>() &&
                !may_send_otherwise<Source>()) {
    return check_finish(source.format().algorithms[algorithm], reg);
  } else if constexpr (Source::is_constant) {
    return check_end(source.format().algorithms[algorithm], reg);
  } else {
    return source.check_end_of(algorithm, reg);
  }
}

/// Check whether the header values allow this form and it can carry message `id` with `payload` bytes.
template <class Source>
WIREBOND_INLINE bool takes_form(const Source& source, std::size_t index, std::uint32_t id, std::size_t payload,
                                const HeaderValues& header) {
  constexpr bool unroll = Source::is_constant;
  constexpr PartCounts most = part_counts<Source>;
  const auto& format = source.format();
  const Form& form = format.forms[index];
  if constexpr (most.header_fields != 0) {
    if (header.values != nullptr && !agrees<unroll, most.header_fields>(form, header)) return false;
  } else {
    if (header.given != 0) return false;  // only the other end's frames have such a field
  }
  if (!carries_id(format, form, id) || (!carries_all(format, form) && !carries(form, payload))) return false;
  if constexpr (most.exclusions != 0) {
    if (is_excluded<unroll, most.exclusions>(format, form, id, payload, header.values)) return false;
  }
  return true;
}

/// Call fn(index) for the form that a sender uses for message `id` with `payload` bytes: the first that the header
/// values allow and that can carry both. Returns false if there is none; fn is then not called. Unrolled, so that each
/// call knows its form.
template <class Source, class Fn>
WIREBOND_INLINE bool with_own_form(const Source& source, std::uint32_t id, std::size_t payload, Fn&& fn,
                                   HeaderValues header = {}) {
  constexpr PartCounts most = part_counts<Source>;
  if constexpr (folds<Source>(0) && most.forms == 1) {
    if (!takes_form(source, 0, id, payload, header)) return false;
    fn(0);
    return true;
  } else {
    const std::size_t count = header.values == nullptr ? source.format().own_forms : source.format().form_count;
    return !every<true, most.forms>(0, count, [&](std::size_t i) WIREBOND_INLINE_LAMBDA {
      if (!takes_form(source, i, id, payload, header)) return true;
      fn(i);
      return false;
    });
  }
}

}  // namespace detail

}  // namespace wirebond
