// One number among a payload's bytes, and its Python value. The caller says where in the payload it lies.
#pragma once

#include <nanobind/nanobind.h>

#include <cstddef>
#include <cstdint>
#include <string>

#include "field_table.hpp"
#include "wirebond/bits.hpp"
#include "wirebond/bytes.hpp"

namespace wirebond::engine {

/// Which value of which message, for sentences: `scan.points[2].x`. Lives on the stack while it is walked to.
struct Path {
  const Path* parent;
  const std::string& name;
  std::ptrdiff_t element = -1;  ///< of a list; -1: no list, or all of it

  std::string text() const;
};

inline std::uint64_t load_plain_raw(const FieldTable& field, const std::uint8_t* at, std::size_t index) {
  return (load_bytes(at + index * field.size, field.size, field.order) >> field.shift) & low_bits(field.width);
}

inline std::uint64_t load_packed_raw(const FieldTable& field, const std::uint8_t* at, std::size_t index) {
  return load_bits(at, index * field.width, field.width, field.bit_order);
}

/// The bits of element `index`, at the bottom. `at` is where the field begins.
inline std::uint64_t load_raw(const FieldTable& field, const std::uint8_t* at, std::size_t index) {
  return field.repeat == Repeat::packed ? load_packed_raw(field, at, index) : load_plain_raw(field, at, index);
}

/// Pair of `load_raw`, into bytes that are zero but for what other fields have in them.
inline void store_raw(const FieldTable& field, std::uint8_t* at, std::size_t index, std::uint64_t raw) {
  if (field.repeat == Repeat::packed) {
    store_bits(at, index * field.width, field.width, field.bit_order, raw);
    return;
  }
  std::uint8_t* const to = at + index * field.size;
  store_bytes(to, load_bytes(to, field.size, field.order) | (raw << field.shift), field.size, field.order);
}

/// The integer of a signed field.
inline std::int64_t signed_of(const FieldTable& field, std::uint64_t raw) {
  return field.sign_magnitude ? from_sign_magnitude(raw, field.width) : from_twos_complement(raw, field.width);
}

/// The value of a number on the wire. Any thread. A float's minus zero stays one; an integer's zero has no sign.
inline double to_si(const FieldTable& field, double wire) {
  if (field.kind != FieldKind::floating) {
    return (wire * field.numerator + field.addend) / field.denominator + field.offset;
  }
  const double scaled = wire * field.numerator / field.denominator;
  return field.offset == 0 ? scaled : scaled + field.offset;
}

/// The number of a float field.
double float_of(const FieldTable& field, std::uint64_t raw);

/// The value as the Python API gives it. Needs the GIL.
nb::object decode_element(const FieldTable& field, std::uint64_t raw);

/// What is wrong with a received value, to stand behind its path; empty if nothing is. Needs the GIL.
std::string fault_of(const FieldTable& field, std::uint64_t raw);

/// The bits of a value. Throws MessageError with a sentence about `path`. Needs the GIL.
std::uint64_t encode_element(const FieldTable& field, nb::handle value, const Path& path);

/// "path is value (type); expected …" as a MessageError.
[[noreturn]] void wrong_type(const Path& path, nb::handle value, const std::string& expected);

/// Raise wirebond.errors.MessageError.
[[noreturn]] void throw_message_error(const std::string& text);

/// `repr` of a value, shortened.
std::string shown(nb::handle value);

/// An owned reference; throws what Python raised where there is none.
nb::object steal(PyObject* object);

}  // namespace wirebond::engine
