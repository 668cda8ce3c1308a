// Identifies the message of a frame whose id alone is not enough: tests of the id, header fields, numbers of the
// payload and its size. A format with one message per id has none of this in its program.
#pragma once

#include <cstddef>
#include <cstdint>
#include <type_traits>
#include <utility>

#include "wirebond/format.hpp"
#include "wirebond/placed_number.hpp"
#include "wirebond/source.hpp"
#include "wirebond/unroll.hpp"

namespace wirebond {

/// Subject of a test.
enum class MatchOf : std::uint8_t {
  id,       ///< FrameFormat::no_id for a frame without one
  header,   ///< a header field
  payload,  ///< a number of the payload
  size,     ///< payload bytes
};

/// Tests whether the bits of `mask` are in [low, high]. All tests of a message must hold for its frames, but of tests
/// joined by `or_next` one is enough.
struct MatchTest {
  MatchOf of = MatchOf::id;
  std::uint8_t place = 0;  ///< of a header field, in the list of all of them
  bool or_next = false;
  bool is_one = false;     ///< only one value is possible: a sender writes it and ignores the given one
  std::uint8_t bytes = 0;  ///< of a number of the payload: (number >> shift) & mask
  ByteOrder order = ByteOrder::little;
  std::uint8_t shift = 0;
  std::uint16_t at = 0;
  std::uint64_t mask = 0;
  std::uint64_t low = 0;
  std::uint64_t high = 0;

  constexpr bool allows(std::uint64_t number) const { return low <= (number & mask) && (number & mask) <= high; }
};

/// Tests of one message. Points at tables that the caller keeps.
struct MatchTests {
  const MatchTest* tests = nullptr;
  std::uint8_t count = 0;
};

namespace detail {

/// Check whether the source identifies messages by more than their ids. Then it has
///
///   bool matches() const;       // any message has tests
///   bool matches_late() const;  // a test needs the payload, not only its size and the bytes before it
///   template <class Asked> MessageShape match(const Asked& asked) const;
///
/// which is called instead of `message(id)`. `Asked` has a function for each MatchOf, as below.
template <class Source, class = void>
struct HasMatch : std::false_type {};
template <class Source>
struct HasMatch<Source, std::void_t<decltype(std::declval<const Source&>().matches_late())>> : std::true_type {};

/// Read a number of the payload. Returns false if it is beyond the end; with `trims_zeros` it is zero there.
WIREBOND_INLINE bool payload_number(const std::uint8_t* payload, std::size_t size, bool trims_zeros, std::size_t at,
                                    unsigned bytes, ByteOrder order, unsigned shift, std::uint64_t& number) {
  if (at + bytes <= size) {
    number = load_bytes(payload + at, bytes, order) >> shift;
    return true;
  }
  if (!trims_zeros) return false;
  std::uint8_t whole[8] = {};
  for (unsigned i = 0; i < bytes; ++i) whole[i] = at + i < size ? payload[at + i] : std::uint8_t{0};
  number = load_bytes(whole, bytes, order) >> shift;
  return true;
}

/// A candidate of one form that has at least the bytes which the source's tests need. Its functions test whether a
/// number's bits of `mask` are in [low, high].
template <class Source>
struct Asked {
  const Form& form;
  const std::uint8_t* frame;
  std::size_t frame_size;  ///< 0 if no test needs more than the bytes before the payload
  std::size_t payload_size;
  std::uint32_t id_number;

  static constexpr bool lies(std::uint64_t number, std::uint64_t mask, std::uint64_t low, std::uint64_t high) {
    return low <= (number & mask) && (number & mask) <= high;
  }
  WIREBOND_INLINE bool id(std::uint64_t mask, std::uint64_t low, std::uint64_t high) const {
    return lies(id_number, mask, low, high);
  }
  WIREBOND_INLINE bool size(std::uint64_t mask, std::uint64_t low, std::uint64_t high) const {
    return lies(payload_size, mask, low, high);
  }
  WIREBOND_INLINE bool header(std::uint8_t place, std::uint64_t mask, std::uint64_t low, std::uint64_t high) const {
    return !every<Source::is_constant, part_counts<Source>.header_fields>(
        0, form.header_count, [&](std::size_t i) WIREBOND_INLINE_LAMBDA {
          const HeaderField& field = form.header[i];
          return field.place != place || !lies(read_wide(field.number, frame, frame_size), mask, low, high);
        });
  }
  WIREBOND_INLINE bool payload(std::size_t at, unsigned bytes, ByteOrder order, unsigned shift, std::uint64_t mask,
                               std::uint64_t low, std::uint64_t high) const {
    std::uint64_t number = 0;
    return payload_number(frame + form.prefix, payload_size, form.trims_zeros, at, bytes, order, shift, number) &&
           lies(number, mask, low, high);
  }
};

/// Check whether all tests of a message hold. `asked`: an Asked, or the values that a sender is about to send.
template <class Frame>
bool all_hold(const MatchTests& tests, const Frame& asked) {
  bool holds = false;  // any of the tests joined by `or_next`
  for (std::size_t i = 0; i < tests.count; ++i) {
    const MatchTest& test = tests.tests[i];
    if (!holds) {
      switch (test.of) {
        case MatchOf::id: holds = asked.id(test.mask, test.low, test.high); break;
        case MatchOf::header: holds = asked.header(test.place, test.mask, test.low, test.high); break;
        case MatchOf::size: holds = asked.size(test.mask, test.low, test.high); break;
        case MatchOf::payload:
          holds = asked.payload(test.at, test.bytes, test.order, test.shift, test.mask, test.low, test.high);
          break;
      }
    }
    if (test.or_next) continue;
    if (!holds) return false;
    holds = false;
  }
  return true;
}

/// Return the message of a candidate.
template <class Source>
WIREBOND_INLINE MessageShape matched(const Source& source, const Form& form, const std::uint8_t* frame,
                                     std::size_t frame_size, std::size_t payload_size, std::uint32_t id) {
  const std::uint32_t no_id = source.format().no_id;
  if (form.id.present() && no_id != 0 && id == no_id) return {};
  return source.match(Asked<Source>{form, frame, frame_size, payload_size, form.id.present() ? id : no_id});
}

}  // namespace detail

}  // namespace wirebond
