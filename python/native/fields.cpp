// Payload bytes to Python values and back. Which frame carried them does not matter here.
#include "fields.hpp"

#include <nanobind/stl/string.h>

#include <cmath>
#include <cstring>
#include <limits>

namespace wirebond::engine {

namespace {

nb::object steal(PyObject* object) {
  if (object == nullptr) throw nb::python_error();
  return nb::steal(object);
}

std::string number_text(double value) {
  char* const text = PyOS_double_to_string(value, 'r', 0, 0, nullptr);
  if (text == nullptr) throw nb::python_error();
  std::string out = text;
  PyMem_Free(text);
  return out;
}

std::string shown(nb::handle value) {
  std::string out = nb::cast<std::string>(nb::repr(value));
  if (out.size() > 80) out = out.substr(0, 77) + "...";
  return out;
}

std::string with_unit(const std::string& text, const FieldTable& field) {
  return field.unit.empty() ? text : text + " " + field.unit;
}

std::uint64_t load_unsigned(const FieldTable& field, const std::uint8_t* at) {
  return load_bytes(at, field.size, field.order);
}

double to_si(const FieldTable& field, double wire) { return wire * field.numerator / field.denominator + field.offset; }

/// The enumerator's name for these bits (two's complement in 64 bits), or an invalid object.
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
  for (unsigned bit = 0; rest != 0;
       ++bit, rest >>= 1) {  // unnamed bits keep their value, so that encoding gives it back
    if (rest & 1u) names.append(steal(PyLong_FromUnsignedLongLong(std::uint64_t{1} << bit)));
  }
  return names;
}

nb::object decode_element(const FieldTable& field, const std::uint8_t* at) {
  switch (field.kind) {
    case FieldKind::boolean: return nb::borrow(load_unsigned(field, at) != 0 ? Py_True : Py_False);
    case FieldKind::floating: {
      const double wire = load_float(field, at);
      return steal(PyFloat_FromDouble(field.scaled ? to_si(field, wire) : wire));
    }
    case FieldKind::unsigned_integer: {
      const std::uint64_t wire = load_unsigned(field, at);
      if (field.has_flags) return flag_names(field, wire);
      if (nb::object name = enumerator(field, wire); name.is_valid()) return name;
      if (field.scaled) return steal(PyFloat_FromDouble(to_si(field, static_cast<double>(wire))));
      return steal(PyLong_FromUnsignedLongLong(wire));
    }
    case FieldKind::signed_integer: {
      const std::int64_t wire = load_signed(field, at);
      if (nb::object name = enumerator(field, static_cast<std::uint64_t>(wire)); name.is_valid()) return name;
      if (field.scaled) return steal(PyFloat_FromDouble(to_si(field, static_cast<double>(wire))));
      return steal(PyLong_FromLongLong(wire));
    }
    case FieldKind::text:
    case FieldKind::bytes: break;
  }
  throw std::logic_error("a string is no element");
}

std::size_t string_size(const FieldTable& field, std::size_t payload_size) {
  if (field.size != 0) return field.max_size;
  const std::size_t rest = payload_size - field.at;
  return rest < field.max_size ? rest : field.max_size;
}

nb::object decode_string(const FieldTable& field, const std::uint8_t* payload, std::size_t payload_size) {
  const char* const at = reinterpret_cast<const char*>(payload + field.at);
  std::size_t size = string_size(field, payload_size);
  if (field.kind == FieldKind::bytes) return steal(PyBytes_FromStringAndSize(at, static_cast<Py_ssize_t>(size)));
  if (field.size != 0) {  // padded with zeros
    const void* const end = std::memchr(at, 0, size);
    if (end != nullptr) size = static_cast<std::size_t>(static_cast<const char*>(end) - at);
  }
  return steal(PyUnicode_DecodeUTF8(at, static_cast<Py_ssize_t>(size), "replace"));
}

bool is_string(const FieldTable& field) { return field.kind == FieldKind::text || field.kind == FieldKind::bytes; }

std::string place(const MessageTable& message, const FieldTable& field, std::uint32_t element) {
  std::string text = message.name + "." + field.name;
  if (field.is_array) text += "[" + std::to_string(element) + "]";
  return text;
}

std::string range_text(const FieldTable& field) {
  return with_unit(number_text(field.minimum) + " ... " + number_text(field.maximum), field);
}

/// The broken rule of one element, or an empty string.
std::string violation_of(const MessageTable& message, const FieldTable& field, std::uint32_t element,
                         const std::uint8_t* at) {
  double si = 0;
  if (field.kind == FieldKind::floating) {
    const double wire = load_float(field, at);
    if (!std::isfinite(wire))
      return place(message, field, element) + " is " + number_text(wire) + ", not a finite number";
    si = to_si(field, wire);
  } else if (field.kind == FieldKind::boolean) {
    const std::uint64_t wire = load_unsigned(field, at);
    return wire <= 1 ? "" : place(message, field, element) + " is " + std::to_string(wire) + ", a bool is 0 or 1";
  } else if (field.kind == FieldKind::signed_integer) {
    const std::int64_t wire = load_signed(field, at);
    si = to_si(field, static_cast<double>(wire));
    if (field.has_enum && !enumerator(field, static_cast<std::uint64_t>(wire)).is_valid()) {
      return place(message, field, element) + " is " + std::to_string(wire) + ", which is no enumerator";
    }
  } else {
    const std::uint64_t wire = load_unsigned(field, at);
    si = to_si(field, static_cast<double>(wire));
    if (field.has_enum && !enumerator(field, wire).is_valid()) {
      return place(message, field, element) + " is " + std::to_string(wire) + ", which is no enumerator";
    }
    if (field.has_flags) {
      std::uint64_t rest = wire;
      for (const auto& flag : field.flags) rest &= ~(std::uint64_t{1} << flag.second);
      if (rest != 0) return place(message, field, element) + " has unnamed bits set: " + std::to_string(rest);
    }
  }
  if (field.has_range && !(si >= field.minimum && si <= field.maximum)) {
    return place(message, field, element) + " = " + with_unit(number_text(si), field) + " is outside " +
           range_text(field);
  }
  return "";
}

[[noreturn]] void wrong_type(const MessageTable& message, const FieldTable& field, nb::handle value,
                             const char* expected) {
  throw_message_error(message.name + "." + field.name + " is " + shown(value) + " (" + Py_TYPE(value.ptr())->tp_name +
                      "); expected " + expected);
}

double number_from(const MessageTable& message, const FieldTable& field, nb::handle value) {
  if (PyUnicode_Check(value.ptr())) wrong_type(message, field, value, "a number");
  const double number = PyFloat_AsDouble(value.ptr());
  if (number == -1.0 && PyErr_Occurred() != nullptr) {
    const bool overflow = PyErr_ExceptionMatches(PyExc_OverflowError) != 0;
    PyErr_Clear();
    if (!overflow) wrong_type(message, field, value, "a number");
    throw_message_error(message.name + "." + field.name + " is too large for a 64-bit number");
  }
  if (!std::isfinite(number)) {
    throw_message_error(message.name + "." + field.name + " is " + number_text(number) + ", not a finite number");
  }
  if (field.has_range && !(number >= field.minimum && number <= field.maximum)) {
    throw_message_error(message.name + "." + field.name + " = " + with_unit(number_text(number), field) +
                        " is outside " + range_text(field));
  }
  return number;
}

[[noreturn]] void does_not_fit(const MessageTable& message, const FieldTable& field, nb::handle value) {
  const bool is_signed = field.kind == FieldKind::signed_integer;
  const unsigned bits = 8u * field.size - (is_signed ? 1u : 0u);
  const double high = std::ldexp(1.0, static_cast<int>(bits)) - 1;
  const double low = is_signed ? -high - 1 : 0;
  std::string limits;
  if (field.scaled) {
    double from = to_si(field, low);
    double to = to_si(field, high);
    if (from > to) std::swap(from, to);
    limits = with_unit(number_text(from) + " ... " + number_text(to), field);
  } else if (is_signed) {
    const std::int64_t least = field.size == 8 ? std::numeric_limits<std::int64_t>::min() : -(std::int64_t{1} << bits);
    limits = std::to_string(least) + " ... " + std::to_string(-(least + 1));
  } else {
    limits = "0 ... " + std::to_string(detail::mask_of(bits));
  }
  throw_message_error(message.name + "." + field.name + " = " + shown(value) + " does not fit its " +
                      std::to_string(8 * field.size) + "-bit wire type, which holds " + limits);
}

/// Two's complement bits of an integer that Python holds, checked against the field's width.
std::uint64_t integer_bits(const MessageTable& message, const FieldTable& field, nb::handle value) {
  const unsigned bits = 8u * field.size;
  if (field.kind == FieldKind::signed_integer) {
    const long long number = PyLong_AsLongLong(value.ptr());
    const bool failed = number == -1 && PyErr_Occurred() != nullptr;
    if (failed) PyErr_Clear();
    const long long limit = bits == 64 ? 0 : 1LL << (bits - 1);
    if (failed || (bits < 64 && (number < -limit || number >= limit))) does_not_fit(message, field, value);
    return static_cast<std::uint64_t>(number);
  }
  const unsigned long long number = PyLong_AsUnsignedLongLong(value.ptr());
  const bool failed = PyErr_Occurred() != nullptr;
  if (failed) PyErr_Clear();
  if (failed || number > detail::mask_of(bits)) does_not_fit(message, field, value);
  return number;
}

std::uint64_t scaled_bits(const MessageTable& message, const FieldTable& field, nb::handle value) {
  const double si = number_from(message, field, value);
  const double wire = std::nearbyint((si - field.offset) * field.denominator / field.numerator);
  const bool is_signed = field.kind == FieldKind::signed_integer;
  const double high = std::ldexp(1.0, static_cast<int>(8u * field.size - (is_signed ? 1u : 0u)));
  const double low = is_signed ? -high : 0;
  if (!(wire >= low && wire < high)) does_not_fit(message, field, value);
  return is_signed ? static_cast<std::uint64_t>(static_cast<std::int64_t>(wire)) : static_cast<std::uint64_t>(wire);
}

std::string names_of(const std::vector<std::pair<nb::object, std::uint64_t>>& enumerators) {
  std::string out;
  for (const auto& entry : enumerators) out += (out.empty() ? "" : ", ") + nb::cast<std::string>(entry.first);
  return out;
}

std::uint64_t enum_bits(const MessageTable& message, const FieldTable& field, nb::handle value) {
  for (const auto& [name, number] : field.enumerators) {
    if (name.equal(value)) return number;
  }
  if (PyLong_Check(value.ptr())) {
    const std::uint64_t bits = integer_bits(message, field, value);
    if (enumerator(field, bits).is_valid()) return bits;
  }
  throw_message_error(message.name + "." + field.name + " is " + shown(value) + "; expected one of " +
                      names_of(field.enumerators));
}

std::uint64_t flag_bits(const MessageTable& message, const FieldTable& field, nb::handle value) {
  if (PyLong_Check(value.ptr())) return integer_bits(message, field, value);
  if (PyUnicode_Check(value.ptr()) || PyObject_HasAttrString(value.ptr(), "__iter__") == 0) {
    wrong_type(message, field, value, "a list of flag names, or an integer");
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
      bits |= integer_bits(message, field, entry);
      continue;
    }
    std::string names;
    for (const auto& flag : field.flags) names += (names.empty() ? "" : ", ") + nb::cast<std::string>(flag.first);
    throw_message_error(message.name + "." + field.name + " has no flag " + shown(entry) + "; it has " + names);
  }
  return bits;
}

void encode_element(const MessageTable& message, const FieldTable& field, nb::handle value, std::uint8_t* at) {
  switch (field.kind) {
    case FieldKind::boolean: {
      const bool is_bool = PyBool_Check(value.ptr()) != 0;
      const bool is_bit = PyLong_Check(value.ptr()) && (value.equal(nb::int_(0)) || value.equal(nb::int_(1)));
      if (!is_bool && !is_bit) wrong_type(message, field, value, "true or false");
      store_bytes(at, PyObject_IsTrue(value.ptr()) != 0 ? 1 : 0, field.size, field.order);
      return;
    }
    case FieldKind::floating: {
      double number = number_from(message, field, value);
      if (field.scaled) number = (number - field.offset) * field.denominator / field.numerator;
      std::uint64_t bits = 0;
      if (field.size == 4) {
        const float narrow = static_cast<float>(number);
        if (!std::isfinite(narrow)) {
          throw_message_error(message.name + "." + field.name + " = " + number_text(number) +
                              " does not fit a 32-bit float, which holds at most 3.4028235e+38");
        }
        std::uint32_t narrow_bits;
        std::memcpy(&narrow_bits, &narrow, sizeof narrow);
        bits = narrow_bits;
      } else {
        std::memcpy(&bits, &number, sizeof number);
      }
      store_bytes(at, bits, field.size, field.order);
      return;
    }
    case FieldKind::unsigned_integer:
    case FieldKind::signed_integer: {
      std::uint64_t bits;
      if (field.has_flags) {
        bits = flag_bits(message, field, value);
      } else if (field.has_enum) {
        bits = enum_bits(message, field, value);
      } else if (field.scaled) {
        bits = scaled_bits(message, field, value);
      } else {
        const nb::object index = nb::steal(PyNumber_Index(value.ptr()));
        if (!index.is_valid()) {
          PyErr_Clear();
          const double number = number_from(message, field, value);
          if (number != std::floor(number)) wrong_type(message, field, value, "an integer");
          const nb::object whole = steal(PyLong_FromDouble(number));
          bits = integer_bits(message, field, whole);
        } else {
          if (field.has_range) static_cast<void>(number_from(message, field, index));
          bits = integer_bits(message, field, index);
        }
      }
      store_bytes(at, bits, field.size, field.order);
      return;
    }
    case FieldKind::text:
    case FieldKind::bytes: break;
  }
  throw std::logic_error("a string is no element");
}

void encode_string(const MessageTable& message, const FieldTable& field, nb::handle value,
                   std::vector<std::uint8_t>& payload) {
  nb::object bytes;
  if (field.kind == FieldKind::text) {
    if (!PyUnicode_Check(value.ptr())) wrong_type(message, field, value, "text");
    bytes = nb::steal(PyUnicode_AsUTF8String(value.ptr()));
    if (!bytes.is_valid()) {
      PyErr_Clear();
      wrong_type(message, field, value, "text that UTF-8 can hold");
    }
  } else {
    if (!PyBytes_Check(value.ptr()) && !PyByteArray_Check(value.ptr())) wrong_type(message, field, value, "bytes");
    bytes = steal(PyBytes_FromObject(value.ptr()));
  }
  const auto size = static_cast<std::size_t>(PyBytes_GET_SIZE(bytes.ptr()));
  if (size > field.max_size) {
    throw_message_error(message.name + "." + field.name + " has " + std::to_string(size) + " bytes; it holds at most " +
                        std::to_string(field.max_size));
  }
  const std::size_t needed = field.at + (field.size != 0 ? field.max_size : size);
  if (payload.size() < needed) payload.resize(needed);
  std::memcpy(payload.data() + field.at, PyBytes_AS_STRING(bytes.ptr()), size);
}

nb::object neutral_value(const FieldTable& field) {
  switch (field.kind) {
    case FieldKind::text: return nb::str("");
    case FieldKind::bytes: return nb::bytes("", 0);
    default: return nb::none();
  }
}

void encode_field(const MessageTable& message, const FieldTable& field, nb::handle value,
                  std::vector<std::uint8_t>& payload) {
  if (is_string(field)) {
    encode_string(message, field, value, payload);
    return;
  }
  std::uint8_t* const at = payload.data() + field.at;
  if (!field.is_array) {
    encode_element(message, field, value, at);
    return;
  }
  if (PyUnicode_Check(value.ptr()) || PySequence_Check(value.ptr()) == 0) {
    wrong_type(message, field, value, ("a list of " + std::to_string(field.count)).c_str());
  }
  const Py_ssize_t length = PySequence_Size(value.ptr());
  if (length != static_cast<Py_ssize_t>(field.count)) {
    PyErr_Clear();
    throw_message_error(message.name + "." + field.name + " has " + std::to_string(length) + " elements; expected " +
                        std::to_string(field.count));
  }
  for (std::uint32_t i = 0; i < field.count; ++i) {
    const nb::object element = steal(PySequence_GetItem(value.ptr(), static_cast<Py_ssize_t>(i)));
    encode_element(message, field, element, at + static_cast<std::size_t>(i) * field.size);
  }
}

}  // namespace

void throw_message_error(const std::string& text) {
  const nb::object type = nb::module_::import_("wirebond.errors").attr("MessageError");
  PyErr_SetString(type.ptr(), text.c_str());
  throw nb::python_error();
}

std::int64_t load_signed(const FieldTable& field, const std::uint8_t* at) {
  const std::uint64_t bits = load_unsigned(field, at);
  const unsigned unused = 64u - 8u * field.size;
  return static_cast<std::int64_t>(bits << unused) >> unused;
}

double load_float(const FieldTable& field, const std::uint8_t* at) {
  if (field.size == 4) {
    const auto bits = static_cast<std::uint32_t>(load_unsigned(field, at));
    float value;
    std::memcpy(&value, &bits, sizeof value);
    return static_cast<double>(value);
  }
  const std::uint64_t bits = load_unsigned(field, at);
  double value;
  std::memcpy(&value, &bits, sizeof value);
  return value;
}

nb::dict decode_fields(const MessageTable& message, const std::uint8_t* payload, std::size_t size) {
  nb::dict out;
  for (const FieldTable& field : message.fields) {
    nb::object value;
    if (is_string(field)) {
      value = decode_string(field, payload, size);
    } else if (!field.is_array) {
      value = decode_element(field, payload + field.at);
    } else {
      value = steal(PyList_New(static_cast<Py_ssize_t>(field.count)));
      for (std::uint32_t i = 0; i < field.count; ++i) {
        nb::object element = decode_element(field, payload + field.at + static_cast<std::size_t>(i) * field.size);
        PyList_SET_ITEM(value.ptr(), static_cast<Py_ssize_t>(i), element.release().ptr());
      }
    }
    if (PyDict_SetItem(out.ptr(), field.key.ptr(), value.ptr()) != 0) throw nb::python_error();
  }
  return out;
}

nb::list find_violations(const MessageTable& message, const std::uint8_t* payload, std::size_t size) {
  nb::list out;
  for (const FieldTable& field : message.fields) {
    if (is_string(field)) {
      if (field.kind != FieldKind::text) continue;
      const nb::object text =
          nb::steal(PyUnicode_DecodeUTF8(reinterpret_cast<const char*>(payload + field.at),
                                         static_cast<Py_ssize_t>(string_size(field, size)), nullptr));
      if (!text.is_valid()) {
        PyErr_Clear();
        out.append(nb::str((place(message, field, 0) + " is not UTF-8").c_str()));
      }
      continue;
    }
    for (std::uint32_t i = 0; i < field.count; ++i) {
      const std::string broken =
          violation_of(message, field, i, payload + field.at + static_cast<std::size_t>(i) * field.size);
      if (!broken.empty()) out.append(nb::str(broken.c_str()));
    }
  }
  return out;
}

std::vector<std::uint8_t> encode_fields(const MessageTable& message, nb::dict values) {
  std::vector<std::uint8_t> payload(message.min_payload, 0);
  std::size_t used = 0;
  for (const FieldTable& field : message.fields) {
    nb::object value = nb::borrow(PyDict_GetItemWithError(values.ptr(), field.key.ptr()));
    if (value.is_valid()) {
      ++used;
    } else {
      if (PyErr_Occurred() != nullptr) throw nb::python_error();
      value = field.has_default ? field.default_value : neutral_value(field);
      if (value.is_none()) {
        throw_message_error(message.name + " needs " + field.name + ", which has no default");
      }
    }
    encode_field(message, field, value, payload);
  }
  if (used == values.size()) return payload;
  std::string known;
  for (const FieldTable& field : message.fields) known += (known.empty() ? "" : ", ") + field.name;
  for (auto [key, value] : values) {
    bool found = false;
    for (const FieldTable& field : message.fields) found = found || field.key.equal(key);
    if (found) continue;
    throw_message_error(message.name + " has no field " + shown(key) +
                        (known.empty() ? "; it has no fields" : "; it has " + known));
  }
  return payload;
}

}  // namespace wirebond::engine
