// Words of the Python model and their meaning for the engine. A word that is in no table is refused, never guessed.
#pragma once

#include <nanobind/nanobind.h>
#include <nanobind/stl/string.h>

#include <cstddef>
#include <stdexcept>
#include <string>
#include <utility>

#include "wirebond/bits.hpp"
#include "wirebond/bytes.hpp"

namespace wirebond::engine {

namespace nb = nanobind;

/// Convert a text, or a StrEnum's value. Needs the GIL.
inline std::string text_of(nb::handle value) { return nb::cast<std::string>(nb::str(value)); }

/// Return the table's entry for the word `value`. Throws std::logic_error, a RuntimeError in Python, for another word:
/// the model has a word that the engine does not know. Needs the GIL.
template <class Value, std::size_t Size>
Value meant_by(const std::pair<const char*, Value> (&table)[Size], nb::handle value, const char* what) {
  const std::string word = text_of(value);
  for (const auto& [name, meaning] : table) {
    if (word == name) return meaning;
  }
  throw std::logic_error(std::string("the engine has no ") + what + " '" + word + "'");
}

inline ByteOrder byte_order_of(nb::handle value) {
  static constexpr std::pair<const char*, ByteOrder> table[] = {{"little", ByteOrder::little}, {"big", ByteOrder::big}};
  return meant_by(table, value, "byte order");
}

inline BitOrder bit_order_of(nb::handle value) {
  static constexpr std::pair<const char*, BitOrder> table[] = {{"low", BitOrder::low_first},
                                                               {"high", BitOrder::high_first}};
  return meant_by(table, value, "bit order");
}

}  // namespace wirebond::engine
