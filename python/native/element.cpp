// Decodes, checks and encodes one number as a Python value.
#include "element.hpp"

#include <nanobind/stl/string.h>

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <cstring>
#include <limits>
#include <stdexcept>

namespace wirebond::engine {

namespace {

std::string number_text(double value) {
  char* const text = PyOS_double_to_string(value, 'r', 0, 0, nullptr);
  if (text == nullptr) throw nb::python_error();
  std::string out = text;
  PyMem_Free(text);
  return out;
}

std::string hex_text(std::uint64_t value) {
  char text[19];
  std::snprintf(text, sizeof text, "0x%llX", static_cast<unsigned long long>(value));
  return text;
}

/// `whole`: as `whole_of` returns it.
std::string whole_text(const FieldTable& field, std::uint64_t whole) {
  return field.is_signed ? std::to_string(static_cast<std::int64_t>(whole)) : std::to_string(whole);
}

std::string with_unit(const std::string& text, const FieldTable& field) {
  return field.unit.empty() ? text : text + " " + field.unit;
}

/// Return the enumerator's name for these bits (two's complement in 64 bits), or an invalid object.
nb::object enumerator(const FieldTable& field, std::uint64_t bits) {
  for (const auto& [name, value] : field.enumerators) {
    if (value == bits) return name;
  }
  return {};
}

nb::object flag_names(const FieldTable& field, std::uint64_t wire) {
  nb::list names;
  std::uint64_t rest = wire;
  for (const auto& [name, bit] : field.flags) {
    if ((wire >> bit) & 1u) names.append(name);
    rest &= ~(std::uint64_t{1} << bit);
  }
  for (unsigned bit = 0; rest != 0; ++bit, rest >>= 1) {  // unnamed bits keep their value, so that encoding restores it
    if (rest & 1u) names.append(steal(PyLong_FromUnsignedLongLong(std::uint64_t{1} << bit)));
  }
  return names;
}

std::string range_text(const FieldTable& field) {
  return with_unit(number_text(field.minimum) + " ... " + number_text(field.maximum), field);
}

/// Check whether its type defines how it becomes a number. An exception of that function belongs to the caller, and
/// passes.
bool is_number(nb::handle value) {
  const PyNumberMethods* const methods = Py_TYPE(value.ptr())->tp_as_number;
  return methods != nullptr && (methods->nb_float != nullptr || methods->nb_index != nullptr);
}

/// Throw wrong_type for a value that could have been a number, with its exception as the cause.
[[noreturn]] void wrong_type_because(nb::python_error cause, const Path& path, nb::handle value) {
  try {
    wrong_type(path, value, "a number");
  } catch (nb::python_error& error) {
    PyException_SetCause(error.value().ptr(), nb::borrow(cause.value()).release().ptr());
    throw;
  }
}

double number_from(const FieldTable& field, nb::handle value, const Path& path) {
  if (PyUnicode_Check(value.ptr())) wrong_type(path, value, "a number");
  if (!is_number(value)) wrong_type(path, value, "a number");
  const double number = PyFloat_AsDouble(value.ptr());
  if (number == -1.0 && PyErr_Occurred() != nullptr) {
    if (PyErr_ExceptionMatches(PyExc_TypeError) != 0) wrong_type_because(nb::python_error(), path, value);
    if (PyLong_Check(value.ptr()) == 0) throw nb::python_error();  // raised by the value's own __float__
    PyErr_Clear();
    throw_message_error(path.text() + " is too large for a 64-bit number");
  }
  if (!std::isfinite(number)) {
    throw_message_error(path.text() + " is " + number_text(number) + ", not a finite number");
  }
  if (field.has_range &&
      !(number >= field.accepted_least - field.range_slack && number <= field.accepted_most + field.range_slack)) {
    throw_message_error(path.text() + " = " + with_unit(number_text(number), field) + " is outside " +
                        range_text(field));
  }
  return number;
}

[[noreturn]] void does_not_fit(const FieldTable& field, nb::handle value, const Path& path) {
  std::string text = std::to_string(field.least) + " ... " + std::to_string(field.greatest);
  if (field.scaled) {
    double from = to_si(field, static_cast<double>(field.least));
    double to = to_si(field, static_cast<double>(field.greatest));
    if (from > to) std::swap(from, to);
    text = with_unit(number_text(from) + " ... " + number_text(to), field);
  }
  throw_message_error(path.text() + " = " + shown(value) + " does not fit its " + std::to_string(field.width) +
                      "-bit wire type, which holds " + text);
}

/// Return a Python integer as two's complement in 64 bits, after checking it against the field's bits.
std::uint64_t integer_bits(const FieldTable& field, nb::handle value, const Path& path) {
  if (field.is_signed) {
    const long long number = PyLong_AsLongLong(value.ptr());
    const bool failed = number == -1 && PyErr_Occurred() != nullptr;
    if (failed) PyErr_Clear();
    if (failed || number < field.least || number > static_cast<long long>(field.greatest)) {
      does_not_fit(field, value, path);
    }
    return static_cast<std::uint64_t>(number);
  }
  const unsigned long long number = PyLong_AsUnsignedLongLong(value.ptr());
  const bool failed = PyErr_Occurred() != nullptr;
  if (failed) PyErr_Clear();
  if (failed || number > field.greatest) does_not_fit(field, value, path);
  return number;
}

/// Return the value that to_si would convert to this one, if it were a number on the wire.
double from_si(const FieldTable& field, double si) {
  if (field.kind != FieldKind::floating) {
    return ((si - field.offset) * field.denominator - field.addend) / field.numerator;
  }
  return (field.offset == 0 ? si : si - field.offset) * field.denominator / field.numerator;
}

/// Return the whole number nearest to an SI value; halves away from zero, as in the generated code.
double to_wire(const FieldTable& field, double si) { return std::round(from_si(field, si)); }

/// Check whether a scaled number is between the bounds' own wire values. A legal bound may round past itself.
bool in_wire_range(const FieldTable& field, double wire) {
  const double one = to_wire(field, field.minimum);
  const double other = to_wire(field, field.maximum);
  return wire >= std::min(one, other) && wire <= std::max(one, other);
}

std::uint64_t scaled_bits(const FieldTable& field, nb::handle value, const Path& path) {
  const double si = number_from(field, value, path);
  const double wire = to_wire(field, si);
  // As doubles both 2^64 - 1 and 2^63 - 1 round up to a number that does not fit.
  const double beyond = static_cast<double>(field.greatest) + 1;
  if (!(wire >= static_cast<double>(field.least) && wire < beyond)) does_not_fit(field, value, path);
  return field.is_signed ? static_cast<std::uint64_t>(static_cast<std::int64_t>(wire))
                         : static_cast<std::uint64_t>(wire);
}

/// Return the field's bits for a number that fits.
std::uint64_t raw_of(const FieldTable& field, std::uint64_t number) {
  return bits_of_number(number, field.width, field.coding);
}

std::string names_of(const std::vector<std::pair<nb::object, std::uint64_t>>& enumerators) {
  std::string out;
  for (const auto& entry : enumerators) out += (out.empty() ? "" : ", ") + nb::cast<std::string>(entry.first);
  return out;
}

std::uint64_t enum_bits(const FieldTable& field, nb::handle value, const Path& path) {
  for (const auto& [name, number] : field.enumerators) {
    if (name.equal(value)) return number;
  }
  if (PyLong_Check(value.ptr())) {
    const std::uint64_t bits = integer_bits(field, value, path);
    if (enumerator(field, bits).is_valid()) return bits;
  }
  throw_message_error(path.text() + " is " + shown(value) + "; expected one of " + names_of(field.enumerators));
}

std::uint64_t flag_bits(const FieldTable& field, nb::handle value, const Path& path) {
  if (PyLong_Check(value.ptr())) return integer_bits(field, value, path);
  if (PyUnicode_Check(value.ptr()) || PyObject_HasAttrString(value.ptr(), "__iter__") == 0) {
    wrong_type(path, value, "a list of flag names, or an integer");
  }
  std::uint64_t bits = 0;
  for (nb::handle entry : value) {
    bool known = false;
    for (const auto& [name, bit] : field.flags) {
      if (!name.equal(entry)) continue;
      bits |= std::uint64_t{1} << bit;
      known = true;
    }
    if (known) continue;
    if (PyLong_Check(entry.ptr())) {
      bits |= integer_bits(field, entry, path);
      continue;
    }
    std::string names;
    for (const auto& flag : field.flags) names += (names.empty() ? "" : ", ") + nb::cast<std::string>(flag.first);
    throw_message_error(path.text() + " has no flag " + shown(entry) + "; it has " + names);
  }
  return bits;
}

}  // namespace

std::string Path::text() const {
  std::string out = parent == nullptr ? name : parent->text() + "." + name;
  if (element >= 0) out += "[" + std::to_string(element) + "]";
  return out;
}

nb::object steal(PyObject* object) {
  if (object == nullptr) throw nb::python_error();
  return nb::steal(object);
}

std::string shown(nb::handle value) {
  const nb::object text = nb::module_::import_("wirebond.arguments").attr("shown")(value);
  return nb::cast<std::string>(text);
}

void throw_message_error(const std::string& text) {
  const nb::object type = nb::module_::import_("wirebond.errors").attr("MessageError");
  PyErr_SetObject(type.ptr(), nb::str(text.data(), text.size()).ptr());
  throw nb::python_error();
}

void wrong_type(const Path& path, nb::handle value, const std::string& expected) {
  throw_message_error(path.text() + " is " + shown(value) + " (" + Py_TYPE(value.ptr())->tp_name + "); expected " +
                      expected);
}

double float_of(const FieldTable& field, std::uint64_t raw) {
  if (field.size == 4) {
    const auto bits = static_cast<std::uint32_t>(raw);
    float value;
    std::memcpy(&value, &bits, sizeof value);
    return static_cast<double>(value);
  }
  double value;
  std::memcpy(&value, &raw, sizeof value);
  return value;
}

nb::object decode_element(const FieldTable& field, std::uint64_t raw) {
  switch (field.kind) {
    case FieldKind::boolean: return nb::borrow(raw != 0 ? Py_True : Py_False);
    case FieldKind::floating: {
      const double wire = float_of(field, raw);
      return steal(PyFloat_FromDouble(field.scaled ? to_si(field, wire) : wire));
    }
    case FieldKind::integer: {
      const std::uint64_t wire = whole_of(field, raw);
      if (field.has_flags) return flag_names(field, wire);
      if (nb::object name = enumerator(field, wire); name.is_valid()) return name;
      if (field.scaled) return steal(PyFloat_FromDouble(to_si(field, whole_as_double(field, wire))));
      return steal(field.is_signed ? PyLong_FromLongLong(static_cast<std::int64_t>(wire))
                                   : PyLong_FromUnsignedLongLong(wire));
    }
    default: throw std::logic_error("no number");
  }
}

std::string fault_of(const FieldTable& field, std::uint64_t raw) {
  double si = 0;
  double wire_number = 0;
  switch (field.kind) {
    case FieldKind::boolean: return raw <= 1 ? "" : " is " + std::to_string(raw) + ", a bool is 0 or 1";
    case FieldKind::floating: {
      const double wire = float_of(field, raw);
      if (!std::isfinite(wire)) return " is " + number_text(wire) + ", not a finite number";
      si = to_si(field, wire);
      // The generated code computes in the wire's own type, and has no value then.
      const bool is_double = field.size == sizeof(double);
      if (!std::isfinite(is_double ? si : static_cast<double>(static_cast<float>(si)))) {
        return " is " + number_text(si) + ", beyond a " + (is_double ? "64" : "32") + "-bit float";
      }
      break;
    }
    default: {
      const std::uint64_t wire = whole_of(field, raw);
      if (field.coding == Coding::bcd && wire == bcd_end(field.width)) {
        return " has the digits " + hex_text(raw) + ", and others than 0 to 9 are no number";
      }
      if (field.has_enum && !enumerator(field, wire).is_valid()) {
        return " is " + whole_text(field, wire) + ", which is no enumerator";
      }
      std::uint64_t rest = field.has_flags ? wire : 0;
      for (const auto& flag : field.flags) rest &= ~(std::uint64_t{1} << flag.second);
      if (rest != 0) return " has unnamed bits set: " + std::to_string(rest);
      wire_number = whole_as_double(field, wire);
      si = to_si(field, wire_number);
    }
  }
  if (!field.has_range || (si >= field.accepted_least && si <= field.accepted_most)) return "";
  if (field.scaled && field.kind != FieldKind::floating && in_wire_range(field, wire_number)) return "";
  return " = " + with_unit(number_text(si), field) + " is outside " + range_text(field);
}

std::uint64_t encode_element(const FieldTable& field, nb::handle value, const Path& path) {
  switch (field.kind) {
    case FieldKind::boolean: {
      const bool is_bool = PyBool_Check(value.ptr()) != 0;
      const bool is_bit = PyLong_Check(value.ptr()) && (value.equal(nb::int_(0)) || value.equal(nb::int_(1)));
      if (!is_bool && !is_bit) wrong_type(path, value, "true or false");
      return PyObject_IsTrue(value.ptr()) != 0 ? 1 : 0;
    }
    case FieldKind::floating: {
      double number = number_from(field, value, path);
      if (field.scaled) number = from_si(field, number);
      std::uint64_t bits = 0;
      if (field.size == 4) {
        const float narrow = static_cast<float>(number);
        if (!std::isfinite(narrow)) {
          throw_message_error(path.text() + " = " + number_text(number) +
                              " does not fit a 32-bit float, which holds at most 3.4028235e+38");
        }
        std::uint32_t narrow_bits;
        std::memcpy(&narrow_bits, &narrow, sizeof narrow);
        bits = narrow_bits;
      } else {
        std::memcpy(&bits, &number, sizeof number);
      }
      return bits;
    }
    case FieldKind::integer: {
      if (field.has_flags) return flag_bits(field, value, path);
      if (field.has_enum) return raw_of(field, enum_bits(field, value, path));
      if (field.scaled) return raw_of(field, scaled_bits(field, value, path));
      const nb::object index = nb::steal(PyIndex_Check(value.ptr()) != 0 ? PyNumber_Index(value.ptr()) : nullptr);
      if (!index.is_valid() && PyErr_Occurred() != nullptr) {
        // A numpy array has __index__, which raises; its __float__ decides.
        if (PyErr_ExceptionMatches(PyExc_TypeError) == 0) throw nb::python_error();
        PyErr_Clear();
      }
      if (index.is_valid()) {
        if (field.has_range) static_cast<void>(number_from(field, index, path));
        return raw_of(field, integer_bits(field, index, path));
      }
      const double number = number_from(field, value, path);
      if (number != std::floor(number)) wrong_type(path, value, "an integer");
      const nb::object whole = steal(PyLong_FromDouble(number));
      return raw_of(field, integer_bits(field, whole, path));
    }
    default: throw std::logic_error("no number");
  }
}

}  // namespace wirebond::engine
