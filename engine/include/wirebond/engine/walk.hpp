// Walks through a payload whose fields vary in size: finds their places, and never reads past the payload's end.
#pragma once

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <cstring>
#include <limits>
#include <vector>

#include "wirebond/engine/element.hpp"
#include "wirebond/engine/field_table.hpp"

namespace wirebond::engine {

/// The problem: counts on the wire may be wrong, but decide where later fields are.
///
/// The answer: every field is `shift` bytes after the place in its table: the bytes that varying fields before it have
/// taken. They take them out of `spare`: the bytes that the payload has beyond the minimum of its message. So for any
/// counts on the wire each field is inside the payload.
struct Walk {
  const std::uint8_t* payload;
  std::size_t spare;
  std::size_t shift = 0;

  const std::uint8_t* at(std::size_t place) const { return payload + place + shift; }

  /// Call `each(index, place)` for the existing elements of a list, at most `promised`; returns their number.
  template <class Each>
  std::size_t elements(const FieldTable& field, std::size_t place, std::uint64_t promised, Each each) {
    const std::uint64_t most = std::min<std::uint64_t>(promised, field.max_count);
    std::size_t found = 0;
    for (; found < most && field.stride <= spare; ++found) {
      spare -= field.stride;
      each(found, place + found * field.stride);
    }
    shift += found * field.stride;
    return found;
  }

  /// Return the size of a string of varying size, and move the walk past it. The byte that ends it is not included, and
  /// may be wrong: it is in the minimum size, so it is inside the payload in any case.
  std::size_t string_size(const FieldTable& field, std::size_t place, std::uint64_t promised) {
    auto size = static_cast<std::size_t>(std::min<std::uint64_t>({promised, field.max_count, spare}));
    if (field.ends_with >= 0) {
      const void* const end = std::memchr(at(place), field.ends_with, size + 1);
      if (end != nullptr) size = static_cast<std::size_t>(static_cast<const std::uint8_t*>(end) - at(place));
    }
    spare -= size;
    shift += size;
    return size;
  }
};

/// Values read so far of fields that count, in one list of fields. Costs nothing if none counts.
class Counts {
 public:
  /// Read the value of a counting field at `at`, or of its counting bits.
  void tell(const FieldTable& counting, const std::uint8_t* at) {
    if (counting.slot >= 0) set(counting, load_raw(counting, at, 0));
    for (const FieldTable& run : counting.fields) {
      if (run.slot >= 0) set(run, load_raw(run, at, 0));
    }
  }

  /// Return the value read for this counter.
  std::uint64_t told(const Counter& counter) const { return told_[counter.slot]; }

  /// Return how many elements or bytes the payload promises of `field`.
  std::uint64_t promised(const FieldTable& field) const {
    if (field.counters.empty()) return std::numeric_limits<std::uint64_t>::max();
    const Counter& first = field.counters.front();
    return told(first) / first.step;
  }

 private:
  void set(const FieldTable& counting, std::uint64_t number) {
    const auto slot = static_cast<std::size_t>(counting.slot);
    if (told_.size() <= slot) told_.resize(slot + 1);
    told_[slot] = number;
  }

  std::vector<std::uint64_t> told_;
};

}  // namespace wirebond::engine
