// How a fuzz target says that an invariant is broken: one sentence, then a stop that the fuzzer records.
#pragma once

#include <cstdio>
#include <cstdlib>

#define EXPECT(holds, sentence) ((holds) ? static_cast<void>(0) : ::fuzz::broken(sentence, #holds, __FILE__, __LINE__))

namespace fuzz {

/// Set by a target that can say what it was at: called before the stop.
inline void (*describe)() = nullptr;

[[noreturn]] inline void broken(const char* sentence, const char* condition, const char* file, int line) {
  std::fprintf(stderr, "broken invariant: %s (%s), %s:%d\n", sentence, condition, file, line);
  if (describe != nullptr) describe();
  std::abort();
}

}  // namespace fuzz
