// Random numbers, and distances between random faults: the same on every machine, because no step uses a floating-point
// number or the standard library's distributions.
#pragma once

#include <cstdint>

namespace wirebond::sim {

/// splitmix64 (Steele, Lea, Flood 2014).
class Random {
 public:
  explicit Random(std::uint64_t seed) : state_(seed) {}

  std::uint64_t next() {
    state_ += 0x9E3779B97F4A7C15u;
    std::uint64_t mixed = state_;
    mixed = (mixed ^ (mixed >> 30)) * 0xBF58476D1CE4E5B9u;
    mixed = (mixed ^ (mixed >> 27)) * 0x94D049BB133111EBu;
    return mixed ^ (mixed >> 31);
  }

  /// Return a number in 0 .. limit - 1; 0 for a limit of 0.
  std::uint64_t below(std::uint64_t limit) { return limit == 0 ? 0 : next() % limit; }

 private:
  std::uint64_t state_;
};

/// Chances are whole numbers: this many in 10^12.
inline constexpr std::uint64_t certain = 1'000'000'000'000;
/// A place that is never reached.
inline constexpr std::uint64_t no_place = ~std::uint64_t{0};

namespace detail {

/// Return -ln of a random number between 0 and 1, times 2^32. Computes the logarithm bit by bit: square the mantissa,
/// and check whether it reaches 2 (Knuth, The Art of Computer Programming 1, 1.2.2, exercise 25).
inline std::uint64_t exponential_q32(std::uint64_t random) {
  if (random == 0) random = 1;
  unsigned whole = 63;
  while ((random >> 63) == 0) {
    random <<= 1;
    --whole;
  }
  std::uint64_t mantissa = random >> 32;  // 1 to 2, times 2^31
  std::uint64_t log2_q32 = std::uint64_t{whole} << 32;
  for (std::uint64_t bit = std::uint64_t{1} << 31; bit != 0; bit >>= 1) {
    mantissa = (mantissa * mantissa) >> 31;
    if ((mantissa >> 32) == 0) continue;
    mantissa >>= 1;
    log2_q32 += bit;
  }
  constexpr std::uint64_t ln2_q32 = 2'977'044'472;
  const std::uint64_t minus_log2 = (std::uint64_t{64} << 32) - log2_q32;
  return (minus_log2 >> 32) * ln2_q32 + (((minus_log2 & 0xFFFF'FFFFu) * ln2_q32) >> 32);
}

/// Return -ln(1 - chance), in 10^-12: the sum of chance^n / n.
inline std::uint64_t hazard(std::uint64_t chance) {
  const std::uint64_t millionths = chance / 1'000'000;
  std::uint64_t sum = chance;
  std::uint64_t power = millionths;  // chance^n, in 10^-6
  for (std::uint64_t n = 2; n < 200; ++n) {
    const std::uint64_t term = power * millionths;  // in 10^-12
    if (term == 0) break;
    sum += term / n;
    power = term / 1'000'000;
  }
  return sum;
}

}  // namespace detail

/// Draws how many places stay intact before the next fault, if each place is hit independently with the same chance: a
/// geometric distribution. So places without a fault cost nothing.
class Gaps {
 public:
  Gaps() = default;
  explicit Gaps(std::uint64_t chance)
      : is_certain_(chance >= certain),
        mean_q16_(chance == 0 || is_certain_ ? 0 : (certain << 16) / detail::hazard(chance)) {}

  /// Return that number; `no_place`: there are no faults.
  std::uint64_t next(Random& random) const {
    if (is_certain_) return 0;
    if (mean_q16_ == 0) return no_place;
    const std::uint64_t drawn = detail::exponential_q32(random.next());
    const std::uint64_t low = drawn & 0xFFFF'FFFFu;
    const std::uint64_t scaled =
        (drawn >> 32) * mean_q16_ + low * (mean_q16_ >> 32) + ((low * (mean_q16_ & 0xFFFF'FFFFu)) >> 32);
    return scaled >> 16;
  }

 private:
  bool is_certain_ = false;
  std::uint64_t mean_q16_ = 0;
};

}  // namespace wirebond::sim
