// A walk through a payload whose fields vary in size: where each lies, and never past the payload's end.
#pragma once

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <cstring>
#include <limits>
#include <vector>

#include "element.hpp"
#include "field_table.hpp"

namespace wirebond::engine {

/// Every field lies `shift` bytes behind the place that its table says, which is what varying fields before it have
/// taken. They take it out of `spare`: what the payload has beyond the least that its message needs. So whatever the
/// counts on the wire say, each field lies within the payload.
struct Walk {
  const std::uint8_t* payload;
  std::size_t spare;
  std::size_t shift = 0;

  const std::uint8_t* at(std::size_t place) const { return payload + place + shift; }

  /// Call `each(index, place)` for the elements of a list that are there, `promised` at most; the number of these.
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

  /// Bytes of a string of varying size, which the walk then is behind. The byte that ends it is not among them, and may
  /// be another than it should: it is in the least size, so that it lies in the payload whatever it is.
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

/// What the fields that count have told so far, among fields that stand beside each other. Costs nothing where none
/// counts.
class Counts {
 public:
  /// Read what a field at `at` that counts tells, or those of its bits that do.
  void tell(const FieldTable& counting, const std::uint8_t* at) {
    if (counting.slot >= 0) set(counting, load_raw(counting, at, 0));
    for (const FieldTable& run : counting.fields) {
      if (run.slot >= 0) set(run, load_raw(run, at, 0));
    }
  }

  /// What one of them has told.
  std::uint64_t told(const Counter& counter) const { return told_[counter.slot]; }

  /// Elements or bytes that the payload promises of `field`.
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
