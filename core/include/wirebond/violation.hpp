// Kinds and counters of broken field rules in received messages. Only names and numbers: decoding is elsewhere.
#pragma once

#include <cstdint>

namespace wirebond {

/// Violations found in one message, a bit each.
enum class Violation : std::uint8_t {
  none = 0,
  not_finite = 1,    ///< a float is NaN or infinite
  unknown_enum = 2,  ///< an enum has a value without a name
  out_of_range = 4,  ///< a number is out of its range, and its rule is to reject
  clamped = 8,       ///< a number is out of its range, and its rule is to clamp
  wrong_count = 16,  ///< a count is larger than the number of elements received, or than the protocol allows
};

constexpr Violation operator|(Violation a, Violation b) {
  return static_cast<Violation>(static_cast<unsigned>(a) | static_cast<unsigned>(b));
}
constexpr Violation& operator|=(Violation& a, Violation b) { return a = a | b; }

/// Check whether `found` includes any of `wanted`.
constexpr bool has(Violation found, Violation wanted) {
  return (static_cast<unsigned>(found) & static_cast<unsigned>(wanted)) != 0;
}

/// Check whether the handler must not get such a message.
constexpr bool rejects(Violation found) {
  return has(found, Violation::not_finite | Violation::unknown_enum | Violation::out_of_range | Violation::wrong_count);
}

/// Messages that broke a field rule, modulo 2^32. One message may count under several kinds.
struct Violations {
  std::uint32_t not_finite = 0;
  std::uint32_t unknown_enum = 0;
  std::uint32_t out_of_range = 0;
  std::uint32_t clamped = 0;
  std::uint32_t wrong_count = 0;
  std::uint32_t rejected = 0;  ///< messages that the handler did not get

  void count(Violation found) {
    if (has(found, Violation::not_finite)) ++not_finite;
    if (has(found, Violation::unknown_enum)) ++unknown_enum;
    if (has(found, Violation::out_of_range)) ++out_of_range;
    if (has(found, Violation::clamped)) ++clamped;
    if (has(found, Violation::wrong_count)) ++wrong_count;
    if (rejects(found)) ++rejected;
  }
};

}  // namespace wirebond
