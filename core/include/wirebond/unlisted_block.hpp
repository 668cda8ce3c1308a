// Checks whether a block between delimiters or silences is a frame except for its id. No state, no position in a
// stream.
#pragma once

#include <cstddef>
#include <cstdint>

#include "wirebond/examine.hpp"
#include "wirebond/format.hpp"
#include "wirebond/source.hpp"
#include "wirebond/unroll.hpp"

namespace wirebond {

namespace detail {

/// Check whether this block has this form except for its id, which the format does not have, or not with this size: its
/// constants, its length and each check hold, except for checks that count an unknown seed. Sets `id` then.
template <class Source>
WIREBOND_INLINE bool is_unlisted_form(const Source& source, const Form& form, const std::uint8_t* candidate,
                                      std::size_t size, const Received& received, std::uint32_t& id) {
  constexpr bool unroll = Source::is_constant;
  constexpr PartCounts most = part_counts<Source>;
  const auto& format = source.format();
  const std::size_t outside = static_cast<std::size_t>(form.prefix) + form.suffix;
  if (!form.id.present() || size < outside) return false;
  const std::size_t payload = size - outside;
  if (form.payload_size == PayloadSize::by_length) {
    const std::int64_t told =
        static_cast<std::int64_t>(read_number(form.length, candidate, size)) * form.length_unit + form.length_bias;
    if (told != static_cast<std::int64_t>(payload)) return false;
  }
  if (form.payload_size == PayloadSize::fixed && payload != form.fixed_payload) return false;
  if (payload > format.max_payload) return false;

  const bool constants_hold =
      every<unroll, most.constants>(0, form.constant_count, [&](std::size_t i) WIREBOND_INLINE_LAMBDA {
        const Constant& constant = form.constants[i];
        return (candidate[constant.at.in(size)] & constant.mask) == constant.value;
      });
  if (!constants_hold) return false;
  const bool is_allowed =
      every<unroll, most.exclusions>(0, form.exclusion_count, [&](std::size_t i) WIREBOND_INLINE_LAMBDA {
        const Exclusion& exclusion = format.exclusions[form.first_exclusion + i];
        if (exclusion.subject == Subject::size) return true;
        const std::uint64_t value = read_wide(exclusion.number, candidate, size);
        return value < exclusion.low || exclusion.high < value;
      });
  if (!is_allowed) return false;

  const std::uint32_t number = read_number(form.id, candidate, size);
  const MessageShape shape = shape_of(source, form, number, candidate, size, payload);
  if (fits(form, shape, payload) && !is_overlong(source, shape, candidate + form.prefix, payload)) return false;
  CheckRegisters<Source> registers{};
  const bool checks_hold = every<unroll, most.checks>(0, form.check_count, [&](std::size_t i) WIREBOND_INLINE_LAMBDA {
    const bool holds = check_holds(source, form, i, candidate, size, received, shape.seed, registers);
    return holds || (form.checks[i].seeded && !shape.known());
  });
  if (checks_hold) id = number;
  return checks_hold;
}

/// Check all forms of the format: `size` bytes at `candidate` after unstuffing, `received` before it. One pass over the
/// block for each form and check; only for a block that failed by its id.
template <class Source>
WIREBOND_INLINE bool is_unlisted_block(const Source& source, const std::uint8_t* candidate, std::size_t size,
                                       const Received& received, std::uint32_t& id) {
  const auto& format = source.format();
  const auto is_other = [&](std::size_t i) WIREBOND_INLINE_LAMBDA {
    return !is_unlisted_form(source, format.forms[i], candidate, size, received, id);
  };
  return !every<Source::is_constant, part_counts<Source>.forms>(0, format.form_count, is_other);
}

}  // namespace detail

}  // namespace wirebond
