// Numbers and bytes in sentences, written as Python writes them; and UTF-8.
#pragma once

#include <cstddef>
#include <cstdint>
#include <string>
#include <string_view>

namespace wirebond::engine {

/// Return the shortest decimal number that reads as this double again: `2`, `0.1`, `1e+16`, `nan`.
std::string number_text(double value);

/// Return `0x1F`.
std::string hex_text(std::uint64_t value);

/// Return `0x0D 0x0A`, as in a protocol file.
std::string hex_text(std::string_view bytes);

/// Return these characters (Latin-1) in quotes, as Python's `repr` of the text, shortened to 80 characters. In UTF-8.
std::string quoted(std::string_view characters);

/// Check whether these bytes are UTF-8.
bool is_utf8(std::string_view bytes);

/// Return the text with U+FFFD for invalid UTF-8: one for each longest part that could have begun a character.
std::string with_replacements(std::string_view bytes);

}  // namespace wirebond::engine
