// Words of the model and their meaning for the engine. A word that is in no table is refused, never guessed.
#pragma once

#include <cstddef>
#include <stdexcept>
#include <string>
#include <utility>

#include "wirebond/bits.hpp"
#include "wirebond/bytes.hpp"
#include "wirebond/engine/node.hpp"

namespace wirebond::engine {

/// Return the table's entry for the word `value`. Throws std::logic_error for another word: the model has one that the
/// engine does not know.
template <class Value, std::size_t Size>
Value meant_by(const std::pair<const char*, Value> (&table)[Size], const Node& value, const char* what) {
  for (const auto& [name, meaning] : table) {
    if (value.text() == name) return meaning;
  }
  throw std::logic_error(std::string("the engine has no ") + what + " '" + value.text() + "'");
}

inline ByteOrder byte_order_of(const Node& value) {
  static constexpr std::pair<const char*, ByteOrder> table[] = {{"little", ByteOrder::little}, {"big", ByteOrder::big}};
  return meant_by(table, value, "byte order");
}

inline BitOrder bit_order_of(const Node& value) {
  static constexpr std::pair<const char*, BitOrder> table[] = {{"low", BitOrder::low_first},
                                                               {"high", BitOrder::high_first}};
  return meant_by(table, value, "bit order");
}

}  // namespace wirebond::engine
