// Values as nodes: for a language that has none of its own here, such as JavaScript.
#include "wirebond/engine/node_values.hpp"

#include <charconv>

#include "wirebond/engine/fields.hpp"

namespace wirebond::engine {

namespace {

/// Return the bytes that these hexadecimal digits spell; none if they spell none.
std::optional<std::string> bytes_of_digits(std::string_view digits) {
  if (digits.size() % 2 != 0) return std::nullopt;
  std::string out;
  for (std::size_t i = 0; i < digits.size(); i += 2) {
    unsigned byte = 0;
    const char* const end = digits.data() + i + 2;
    if (std::from_chars(digits.data() + i, end, byte, 16).ptr != end) return std::nullopt;
    out += static_cast<char>(byte);
  }
  return out;
}

}  // namespace

NodeValues::Characters::Characters(const FieldTable& field, Ref value, const Path& path) {
  if (field.kind == FieldKind::text) {
    if (!value.is_text()) wrong_type<NodeValues>(path, value, "text");
    bytes_ = value.text();
    return;
  }
  if (value.is_bytes()) {
    bytes_.assign(value.bytes().begin(), value.bytes().end());
    return;
  }
  const std::optional<std::string> spelled = value.is_text() ? bytes_of_digits(value.text()) : std::nullopt;
  if (!spelled) wrong_type<NodeValues>(path, value, "bytes, or their hexadecimal digits");
  bytes_ = *spelled;
}

}  // namespace wirebond::engine
