// Settings of a wire as words of a command line: `name=value`, whole numbers, as the Python package writes them.
#pragma once

#include <cstdint>
#include <cstdlib>
#include <cstring>
#include <string_view>

#include "wirebond/sim/wire.hpp"

namespace wirebond::sim {

/// Split such a word. Returns false if it is none.
inline bool split_option(const char* word, std::string_view& name, std::uint64_t& value) {
  const char* const equals = std::strchr(word, '=');
  if (equals == nullptr) return false;
  name = std::string_view(word, static_cast<std::size_t>(equals - word));
  value = std::strtoull(equals + 1, nullptr, 10);
  return true;
}

/// Set both directions of a line, which have different faults. Returns false if it is not a setting of a wire.
inline bool set_both(WireSettings& one, WireSettings& other, std::string_view name, std::uint64_t value) {
  WireSettings* const wires[] = {&one, &other};
  for (WireSettings* wire : wires) {
    if (name == "baud") {
      wire->baud = static_cast<std::uint32_t>(value);
    } else if (name == "bits_per_byte") {
      wire->bits_per_byte = static_cast<unsigned>(value);
    } else if (name == "seed") {
      wire->seed = 2 * value + (wire == &one ? 0 : 1);
    } else if (name == "bit_errors") {
      wire->faults.bit_errors = value;
    } else if (name == "bursts") {
      wire->faults.bursts = value;
    } else if (name == "drops") {
      wire->faults.drops = value;
    } else if (name == "inserts") {
      wire->faults.inserts = value;
    } else if (name == "splits") {
      wire->faults.splits = value;
    } else {
      return false;
    }
  }
  return true;
}

}  // namespace wirebond::sim
