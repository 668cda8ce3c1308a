// Random numbers that are the same on every machine and in every run.
#pragma once

#include <cstdint>

namespace wirebond::fake {

/// splitmix64 (Steele, Lea, Flood 2014). The standard library's distributions differ between vendors; this one does
/// not.
class Draw {
 public:
  explicit Draw(std::uint64_t seed) : state_(seed) {}

  std::uint64_t next() {
    state_ += 0x9E3779B97F4A7C15u;
    std::uint64_t mixed = state_;
    mixed = (mixed ^ (mixed >> 30)) * 0xBF58476D1CE4E5B9u;
    mixed = (mixed ^ (mixed >> 27)) * 0x94D049BB133111EBu;
    return mixed ^ (mixed >> 31);
  }

  /// Return a number in 0 .. limit - 1; 0 for a limit of 0.
  std::uint64_t below(std::uint64_t limit) { return limit == 0 ? 0 : next() % limit; }

  /// Return true this many times in a million.
  bool chance(std::uint32_t per_million) { return per_million != 0 && below(1'000'000) < per_million; }

 private:
  std::uint64_t state_;
};

}  // namespace wirebond::fake
