// Loops over the parts of a format: unrolled if the format is a constant, so that the compiler folds every read of it.
#pragma once

#include <cstddef>
#include <utility>

#include "wirebond/bytes.hpp"

namespace wirebond {

namespace detail {

#if defined(__OPTIMIZE__) || !defined(__GNUC__)
inline constexpr bool unrolls = true;
#else
inline constexpr bool unrolls = false;  // nothing would fold
#endif

template <class Fn, std::size_t... I>
WIREBOND_INLINE constexpr bool every_unrolled(std::size_t begin, std::size_t end, Fn& fn, std::index_sequence<I...>) {
  return ((I < begin || I >= end || fn(I)) && ...);
}

/// Call fn(i) for begin <= i < end until one returns false. Unrolled if the format is a constant, so that every read of
/// it folds.
template <bool Unroll, std::size_t Capacity, class Fn>
WIREBOND_INLINE constexpr bool every(std::size_t begin, std::size_t end, Fn&& fn) {
  if constexpr (Unroll && Capacity == 0) {
    return true;
  } else if constexpr (Unroll && unrolls) {
    return every_unrolled(begin, end, fn, std::make_index_sequence<Capacity>{});
  } else {
    for (std::size_t i = begin; i < end; ++i) {
      if (!fn(i)) return false;
    }
    return true;
  }
}

}  // namespace detail

}  // namespace wirebond
