// Finds delimiters in a run of bytes, and where a block between two of them ends. No frame is examined here.
#pragma once

#include <cstddef>
#include <cstdint>
#include <cstring>

#include "wirebond/format.hpp"

namespace wirebond::detail {

/// Return the first place from `from` on with a whole `mark`; `size` if there is none.
inline std::size_t find_mark(Mark mark, const std::uint8_t* bytes, std::size_t from, std::size_t size) {
  while (from + mark.size <= size) {
    const void* const found = std::memchr(bytes + from, mark.first, size + 1 - mark.size - from);
    if (found == nullptr) break;
    from = static_cast<std::size_t>(static_cast<const std::uint8_t*>(found) - bytes);
    if (mark.stands_at(bytes + from, size - from)) return from;
    ++from;
  }
  return size;
}

/// How and where a block ends that begins with an opening delimiter.
struct BlockEnd {
  enum Kind {
    closing,  ///< by the closing delimiter at `at`
    opening,  ///< not ended: another opening delimiter is at `at`, and is a better candidate
    no_pair,  ///< not ended: the last two of the bytes read are a pair that no sender makes
    open,     ///< not ended yet: the search continues at `at`
  };
  Kind kind;
  std::size_t at;
};

WIREBOND_INLINE bool begins_long_mark(Mark mark, std::uint8_t byte) { return mark.size == 2 && byte == mark.first; }

/// Find the end of the block in the `size` bytes at `block`. `from`: where an earlier search of the same block ended,
/// or 0. `doubles`: the delimiters' first byte is doubled among the data, so a pair and a delimiter are distinguished
/// by counting from the block's start.
inline BlockEnd find_block_end(Mark opening, Mark closing, bool doubles, const std::uint8_t* block, std::size_t from,
                               std::size_t size) {
  // An opening delimiter that is only the doubled byte: the byte after it distinguishes it from a pair and from the
  // closing one.
  const bool opens_alone = doubles && opening.size == 1;
  if (opens_alone) {
    if (size < 2) return {BlockEnd::open, 1};
    if (block[1] == opening.first || block[1] == closing.second) return {BlockEnd::no_pair, 2};
  }
  std::size_t at = from > opening.size ? from : opening.size;
  while (at < size) {
    if (closing.stands_at(block + at, size - at)) return {BlockEnd::closing, at};
    if (!opens_alone && opening.stands_at(block + at, size - at)) return {BlockEnd::opening, at};
    if (doubles && block[at] == opening.first) {
      if (at + 1 == size) break;
      if (block[at + 1] != opening.first) {
        return opens_alone ? BlockEnd{BlockEnd::opening, at} : BlockEnd{BlockEnd::no_pair, at + 2};
      }
      ++at;
    } else if (at + 1 == size && (begins_long_mark(closing, block[at]) || begins_long_mark(opening, block[at]))) {
      break;  // the next byte decides
    }
    ++at;
  }
  return {BlockEnd::open, at};
}

}  // namespace wirebond::detail
