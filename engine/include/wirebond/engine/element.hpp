// One number among a payload's bytes, and the rules for its value. The caller gives its place in the payload.
#pragma once

#include <cstddef>
#include <cstdint>
#include <string>

#include "wirebond/bits.hpp"
#include "wirebond/bytes.hpp"
#include "wirebond/engine/field_table.hpp"

namespace wirebond::engine {

/// Names a value of a message in sentences: `scan.points[2].x`. Lives on the stack while the value is visited.
struct Path {
  const Path* parent;
  const std::string& name;
  std::ptrdiff_t element = -1;  ///< of a list; -1: no list, or all of it

  std::string text() const;
};

/// Return the bits of a number whose pieces are at several places of `bits`.
inline std::uint64_t joined_bits(const FieldTable& field, std::uint64_t bits) {
  std::uint64_t raw = 0;
  unsigned done = 0;
  for (const auto& [place, width] : field.pieces) {
    raw |= ((bits >> place) & low_bits(width)) << done;
    done += width;
  }
  return raw;
}

/// Return `raw` at its places; pairs with `joined_bits`.
inline std::uint64_t split_bits(const FieldTable& field, std::uint64_t raw) {
  std::uint64_t bits = 0;
  unsigned done = 0;
  for (const auto& [place, width] : field.pieces) {
    bits |= ((raw >> done) & low_bits(width)) << place;
    done += width;
  }
  return bits;
}

inline std::uint64_t load_plain_raw(const FieldTable& field, const std::uint8_t* at, std::size_t index) {
  const std::uint64_t bits = load_bytes(at + index * field.size, field.size, field.order);
  return field.pieces.empty() ? (bits >> field.shift) & low_bits(field.width) : joined_bits(field, bits);
}

inline std::uint64_t load_packed_raw(const FieldTable& field, const std::uint8_t* at, std::size_t index) {
  return load_bits(at, index * field.width, field.width, field.bit_order);
}

/// Return the bits of element `index`, at the bottom. `at`: start of the field.
inline std::uint64_t load_raw(const FieldTable& field, const std::uint8_t* at, std::size_t index) {
  return field.repeat == Repeat::packed ? load_packed_raw(field, at, index) : load_plain_raw(field, at, index);
}

/// Store bits into bytes that are zero except for other fields; pairs with `load_raw`.
inline void store_raw(const FieldTable& field, std::uint8_t* at, std::size_t index, std::uint64_t raw) {
  if (field.repeat == Repeat::packed) {
    store_bits(at, index * field.width, field.width, field.bit_order, raw);
    return;
  }
  std::uint8_t* const to = at + index * field.size;
  const bool is_alone = field.width == 8u * field.size && field.pieces.empty();
  if (is_alone) return store_bytes(to, raw, field.size, field.order);
  const std::uint64_t bits = field.pieces.empty() ? raw << field.shift : split_bits(field, raw);
  store_bytes(to, load_bytes(to, field.size, field.order) | bits, field.size, field.order);
}

/// Return the number of an integer field, in two's complement of 64 bits. Of decimal digits that are none: see
/// `from_bcd`.
inline std::uint64_t whole_of(const FieldTable& field, std::uint64_t raw) {
  return number_of_bits(raw, field.width, field.coding, field.is_signed);
}

/// Convert such a number.
inline double whole_as_double(const FieldTable& field, std::uint64_t whole) {
  return field.is_signed ? static_cast<double>(static_cast<std::int64_t>(whole)) : static_cast<double>(whole);
}

/// Convert a number on the wire to its value. Any thread. A float keeps minus zero; an integer's zero has no sign.
inline double to_si(const FieldTable& field, double wire) {
  if (field.kind != FieldKind::floating) {
    return (wire * field.numerator + field.addend) / field.denominator + field.offset;
  }
  const double scaled = wire * field.numerator / field.denominator;
  return field.offset == 0 ? scaled : scaled + field.offset;
}

/// Return the number of a float field.
double float_of(const FieldTable& field, std::uint64_t raw);

/// Convert back: the value that `to_si` would convert to this one, if it were a number on the wire.
inline double from_si(const FieldTable& field, double si) {
  if (field.kind != FieldKind::floating) {
    return ((si - field.offset) * field.denominator - field.addend) / field.numerator;
  }
  return (field.offset == 0 ? si : si - field.offset) * field.denominator / field.numerator;
}

/// Return the index of the enumerator for this number (two's complement in 64 bits); -1: there is none.
inline std::ptrdiff_t enumerator_of(const FieldTable& field, std::uint64_t whole) {
  for (std::size_t i = 0; i < field.enumerators.size(); ++i) {
    if (field.enumerators[i].second == whole) return static_cast<std::ptrdiff_t>(i);
  }
  return -1;
}

/// Return the fault of a received value, to follow its path in a sentence; empty if there is none.
std::string fault_of(const FieldTable& field, std::uint64_t raw);

// ---- values to send: each throws MessageError with a sentence about `path`

/// Check that the value is finite and within the field's range.
void check_number(const FieldTable& field, double value, const Path& path);

/// Return the bits of a float's value.
std::uint64_t float_bits(const FieldTable& field, double value, const Path& path);

/// Throw that the value does not fit the wire type.
[[noreturn]] void does_not_fit(const FieldTable& field, const std::string& shown, const Path& path);

/// Return the whole number on the wire of a scaled value, in two's complement of 64 bits, and whether it fits.
bool scaled_whole(const FieldTable& field, double value, std::uint64_t& whole);

/// Return the field's bits for a number that fits.
inline std::uint64_t bits_of_whole(const FieldTable& field, std::uint64_t whole) {
  return bits_of_number(whole, field.width, field.coding);
}

/// Return the names in their order, for a sentence.
template <class Named>
std::string names_of(const std::vector<Named>& named) {
  std::string out;
  for (const auto& [name, number] : named) out += (out.empty() ? "" : ", ") + name;
  return out;
}
inline std::string names_of(const std::vector<FieldTable>& fields) {
  std::string out;
  for (const FieldTable& field : fields) out += (out.empty() ? "" : ", ") + field.name;
  return out;
}

}  // namespace wirebond::engine
