// Rules of a message's payload, as plain data: constants among its fields, and counts that decide where they are and
// how long the payload is. A format without such rules has none of this in its program.
#pragma once

#include <cstddef>
#include <cstdint>
#include <type_traits>
#include <utility>

#include "wirebond/bytes.hpp"

namespace wirebond {

constexpr std::size_t max_payload_counts = 8;

/// A byte of the payload that must have a value; `mask` selects the bits that count. It is at `at`, moved by the bytes
/// of the message's first `behind` counts.
struct PayloadConstant {
  std::uint16_t at = 0;
  std::uint8_t behind = 0;
  std::uint8_t mask = 0xFF;
  std::uint8_t value = 0;
};

/// A number of the payload that counts elements or bytes after it: (number >> shift) & mask, each of `unit` bytes. Its
/// own place is given as for a PayloadConstant.
struct PayloadCount {
  std::uint16_t at = 0;
  std::uint8_t behind = 0;
  std::uint8_t bytes = 1;
  ByteOrder order = ByteOrder::little;
  std::uint8_t shift = 0;
  std::uint64_t mask = 0xFF;
  std::uint16_t unit = 1;
  std::uint16_t most = 0;  ///< maximum of this message
  std::uint16_t step = 1;  ///< size of an element if bytes are counted; other numbers than its multiples are invalid
  std::int8_t agrees_with = -1;  ///< an earlier count of the same elements, which must be equal; it moves later bytes
};

/// The rules of one message. Points at constants of the program, or at tables that the caller keeps.
struct PayloadRules {
  const PayloadConstant* constants = nullptr;
  const PayloadCount* counts = nullptr;
  std::uint8_t constant_count = 0;
  std::uint8_t count_count = 0;
  std::uint16_t most_beside = 0;  ///< not 0: maximum number of payload bytes that are not counted by the counts
};

namespace detail {

template <class Source, class = void>
struct HasPayloadRules : std::false_type {};
template <class Source>
struct HasPayloadRules<Source, std::void_t<decltype(std::declval<const Source&>().payload_rules(std::int16_t{}))>>
    : std::true_type {};

/// Distances by which the parts of one payload are moved: those after the first i counts by `behind[i]` bytes.
struct PayloadShifts {
  std::size_t behind[max_payload_counts + 1];
};

/// Size of a payload, computed from its counts.
struct ToldSize {
  std::size_t size = 0;
  std::size_t need = 0;  ///< not 0: this many payload bytes are needed to decide
  bool is_told = false;  ///< false with `need` 0: a count is greater than the message allows
};

/// Check whether a count of the source's messages counts the bytes of elements. Other firmware has no code for it.
template <class Source, class = void>
struct CountsBytes : std::true_type {};
template <class Source>
struct CountsBytes<Source, std::void_t<decltype(Source::counts_bytes)>>
    : std::integral_constant<bool, Source::counts_bytes> {};

/// Check whether counts of the source's messages limit their payloads. Other firmware has no code for it.
template <class Source, class = void>
struct BoundsByCounts : HasPayloadRules<Source> {};
template <class Source>
struct BoundsByCounts<Source, std::void_t<decltype(Source::bounds_by_counts)>>
    : std::integral_constant<bool, Source::bounds_by_counts> {};

/// Check whether a count can have this number. `taken`: bytes of the count that it must agree with.
template <bool counts_bytes>
bool may_tell(const PayloadCount& count, std::size_t number, std::size_t taken) {
  if constexpr (counts_bytes) {
    if (count.step > 1 && number % count.step != 0) return false;
    if (count.agrees_with >= 0 && number * count.unit != taken) return false;
  } else {
    static_cast<void>(count), static_cast<void>(number), static_cast<void>(taken);
  }
  return true;
}

/// Return the number of bytes of the elements of an earlier count.
inline std::size_t taken_by(const PayloadShifts& shifts, std::int8_t count) {
  return count < 0 ? 0 : shifts.behind[count + 1] - shifts.behind[count];
}

/// Compute a payload's size. `available` bytes are there from `payload` on, some of them perhaps after the payload.
/// `least`: its size if all counts are 0.
template <bool counts_bytes>
ToldSize told_size(const PayloadRules& rules, const std::uint8_t* payload, std::size_t available, std::size_t least) {
  PayloadShifts shifts;
  shifts.behind[0] = 0;
  for (std::size_t i = 0; i < rules.count_count; ++i) {
    const PayloadCount& count = rules.counts[i];
    const std::size_t end = count.at + shifts.behind[count.behind] + count.bytes;
    if (available < end) return {0, end, false};
    const std::uint64_t number =
        (load_bytes(payload + end - count.bytes, count.bytes, count.order) >> count.shift) & count.mask;
    if (number > count.most) return {};
    const auto amount = static_cast<std::size_t>(number);
    if (!may_tell<counts_bytes>(count, amount, taken_by(shifts, count.agrees_with))) return {};
    const bool is_first = !counts_bytes || count.agrees_with < 0;
    shifts.behind[i + 1] = shifts.behind[i] + (is_first ? amount * count.unit : 0);
  }
  return {least + shifts.behind[rules.count_count], 0, true};
}

/// Read the first `how_many` counts of a whole payload. Returns false if one of them is beyond its end or has an
/// invalid number (`any_number`: which is read all the same).
template <bool counts_bytes>
bool read_counts(const PayloadRules& rules, std::size_t how_many, bool any_number, const std::uint8_t* payload,
                 std::size_t size, PayloadShifts& shifts) {
  shifts.behind[0] = 0;
  for (std::size_t i = 0; i < how_many; ++i) {
    const PayloadCount& count = rules.counts[i];
    const std::size_t at = count.at + shifts.behind[count.behind];
    if (at >= size || size - at < count.bytes) return false;
    const std::uint64_t number = (load_bytes(payload + at, count.bytes, count.order) >> count.shift) & count.mask;
    const std::size_t bounded = number < size ? static_cast<std::size_t>(number) : size;  // no sum overflows
    const bool is_first = !counts_bytes || count.agrees_with < 0;
    const bool is_possible = number <= count.most && is_first;  // a greater one is the message's violation
    if (is_possible && !any_number && !may_tell<counts_bytes>(count, static_cast<std::size_t>(number), 0)) return false;
    const std::size_t shift = shifts.behind[i] + (is_first ? bounded * count.unit : 0);
    shifts.behind[i + 1] = shift < size ? shift : size;
  }
  return true;
}

/// Check the constants of a whole payload. `trims_zeros`: missing ones were zeros.
template <bool counts_bytes>
bool payload_holds(const PayloadRules& rules, const std::uint8_t* payload, std::size_t size, bool trims_zeros) {
  if (rules.constant_count == 0) return true;
  PayloadShifts shifts;
  const std::size_t needed = rules.constants[rules.constant_count - 1].behind;  // the last one depends on most counts
  if (!read_counts<counts_bytes>(rules, needed, false, payload, size, shifts)) return false;
  for (std::size_t i = 0; i < rules.constant_count; ++i) {
    const PayloadConstant& constant = rules.constants[i];
    const std::size_t at = constant.at + shifts.behind[constant.behind];
    if (at >= size && !trims_zeros) return false;
    const std::uint8_t byte = at < size ? payload[at] : std::uint8_t{0};
    if ((byte & constant.mask) != constant.value) return false;
  }
  return true;
}

/// Check whether a whole payload has more bytes than its counts allow. False if a count is missing.
template <bool counts_bytes>
bool exceeds_counts(const PayloadRules& rules, const std::uint8_t* payload, std::size_t size) {
  if (rules.most_beside == 0) return false;
  PayloadShifts shifts;
  return read_counts<counts_bytes>(rules, rules.count_count, true, payload, size, shifts) &&
         size > rules.most_beside + shifts.behind[rules.count_count];
}

}  // namespace detail

}  // namespace wirebond
