// One number among a payload's bytes, and its Python value. The caller gives its place in the payload.
#pragma once

#include <nanobind/nanobind.h>

#include <cstddef>
#include <cstdint>
#include <string>

#include "field_table.hpp"
#include "wirebond/bits.hpp"
#include "wirebond/bytes.hpp"

namespace wirebond::engine {

/// Names a value of a message in sentences: `scan.points[2].x`. Lives on the stack while the value is visited.
struct Path {
  const Path* parent;
  const std::string& name;
  std::ptrdiff_t element = -1;  ///< of a list; -1: no list, or all of it

  std::string text() const;
};

/// Return the bits of a number whose pieces lie at several places of `bits`.
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

/// Return the value as the Python API gives it. Needs the GIL.
nb::object decode_element(const FieldTable& field, std::uint64_t raw);

/// Return the fault of a received value, to follow its path in a sentence; empty if there is none. Needs the GIL.
std::string fault_of(const FieldTable& field, std::uint64_t raw);

/// Return the bits of a value. Throws MessageError with a sentence about `path`. Needs the GIL.
std::uint64_t encode_element(const FieldTable& field, nb::handle value, const Path& path);

/// Throw "path is value (type); expected …" as a MessageError.
[[noreturn]] void wrong_type(const Path& path, nb::handle value, const std::string& expected);

/// Raise wirebond.errors.MessageError.
[[noreturn]] void throw_message_error(const std::string& text);

/// Return a value's `repr`, shortened. Never raises: Python cannot print an integer of more than 4 300 digits.
std::string shown(nb::handle value);

/// Return an owned reference; throws Python's exception if there is none.
nb::object steal(PyObject* object);

}  // namespace wirebond::engine
