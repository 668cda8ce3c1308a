// Values as Python objects, for engine/fields.hpp. Everything needs the GIL.
#pragma once

#include <nanobind/nanobind.h>

#include <cstddef>
#include <cstdint>
#include <optional>
#include <string>
#include <string_view>
#include <utility>

#include "objects.hpp"
#include "wirebond/engine/element.hpp"
#include "wirebond/engine/fields.hpp"
#include "wirebond/engine/header.hpp"

namespace wirebond::engine {

/// See wirebond/engine/fields.hpp. Exceptions of the values' own code pass to the caller.
struct PythonValues {
  using Value = nb::object;
  using Ref = nb::handle;
  using List = nb::object;
  using Map = nb::dict;

  static constexpr const char* map_name = "a dict";

  // ---- making
  static nb::object none() { return nb::none(); }
  static nb::object boolean(bool value) { return nb::borrow(value ? Py_True : Py_False); }
  static nb::object floating(double value) { return steal(PyFloat_FromDouble(value)); }
  static nb::object integer(std::int64_t value) { return steal(PyLong_FromLongLong(value)); }
  static nb::object natural(std::uint64_t value) { return steal(PyLong_FromUnsignedLongLong(value)); }
  static nb::object text(std::string_view bytes) {
    return steal(PyUnicode_DecodeUTF8(bytes.data(), static_cast<Py_ssize_t>(bytes.size()), "replace"));
  }
  static nb::object bytes(std::string_view bytes) {
    return steal(PyBytes_FromStringAndSize(bytes.data(), static_cast<Py_ssize_t>(bytes.size())));
  }
  static nb::object enumerator(const FieldTable& field, std::size_t i) {
    return FieldObjects::of(field).enumerators[i];
  }
  static nb::object flag(const FieldTable& field, std::size_t i) { return FieldObjects::of(field).flags[i]; }
  static nb::object make_list(std::size_t size) { return steal(PyList_New(static_cast<Py_ssize_t>(size))); }
  static void put(nb::object& list, std::size_t i, nb::object&& value) {
    PyList_SetItem(list.ptr(), static_cast<Py_ssize_t>(i), value.release().ptr());
  }
  static void append(nb::object& list, nb::object&& value) {
    if (PyList_Append(list.ptr(), value.ptr()) != 0) throw nb::python_error();
  }
  static nb::dict make_map(std::size_t) { return nb::dict(); }
  static void set(nb::dict& map, const FieldTable& field, nb::object&& value) {
    if (PyDict_SetItem(map.ptr(), FieldObjects::of(field).key.ptr(), value.ptr()) != 0) throw nb::python_error();
  }
  static nb::object made(nb::object&& list) { return std::move(list); }
  static nb::object made(nb::dict&& map) { return nb::object(std::move(map)); }
  static nb::object default_value(const FieldTable& field) { return FieldObjects::of(field).default_value; }

  // ---- reading
  static bool is_none(nb::handle value) { return value.is_none(); }
  static bool is_integer(nb::handle value) { return PyLong_Check(value.ptr()) != 0; }
  static bool is_sequence(nb::handle value) {
    return PyUnicode_Check(value.ptr()) == 0 && PyDict_Check(value.ptr()) == 0 && PySequence_Check(value.ptr()) != 0;
  }
  static bool is_several(nb::handle value) {
    return PyUnicode_Check(value.ptr()) == 0 && PyObject_HasAttrString(value.ptr(), "__iter__") != 0;
  }
  static bool is_map(nb::handle value) { return PyDict_Check(value.ptr()) != 0; }
  static bool is_name(const FieldTable& field, nb::handle key) { return FieldObjects::of(field).key.equal(key); }
  static bool is_enumerator(const FieldTable& field, std::size_t i, nb::handle value) {
    return FieldObjects::of(field).enumerators[i].equal(value);
  }
  static bool is_flag(const FieldTable& field, std::size_t i, nb::handle value) {
    return FieldObjects::of(field).flags[i].equal(value);
  }
  static std::size_t size(nb::handle sequence) {
    const Py_ssize_t size = PySequence_Size(sequence.ptr());
    if (size < 0) throw nb::python_error();  // raised by the value's own __len__
    return static_cast<std::size_t>(size);
  }
  static std::size_t map_size(nb::handle map) { return static_cast<std::size_t>(PyDict_Size(map.ptr())); }
  static nb::object item(nb::handle sequence, std::size_t index) {
    return steal(PySequence_GetItem(sequence.ptr(), static_cast<Py_ssize_t>(index)));
  }
  static std::optional<nb::object> get(nb::handle map, const FieldTable& field) {
    PyObject* const found = PyDict_GetItemWithError(map.ptr(), FieldObjects::of(field).key.ptr());
    if (found != nullptr) return nb::borrow(found);
    if (PyErr_Occurred() != nullptr) throw nb::python_error();
    return std::nullopt;
  }
  template <class Each>
  static void each(nb::handle several, Each each) {
    for (nb::handle one : several) each(one);
  }
  template <class Each>
  static void each_key(nb::handle map, Each each) {
    for (auto [key, value] : nb::borrow<nb::dict>(map)) each(key);
  }
  template <class Each>
  static void each_item(nb::handle map, Each each) {
    for (auto [key, value] : nb::borrow<nb::dict>(map)) each(key, value);
  }

  static std::optional<bool> as_bool(nb::handle value) {
    const bool is_bool = PyBool_Check(value.ptr()) != 0;
    const bool is_bit = PyLong_Check(value.ptr()) && (value.equal(nb::int_(0)) || value.equal(nb::int_(1)));
    if (!is_bool && !is_bit) return std::nullopt;
    return PyObject_IsTrue(value.ptr()) != 0;
  }
  static double number(nb::handle value, const Path& path);
  static std::optional<std::int64_t> as_signed(nb::handle value) {
    const long long number = PyLong_AsLongLong(value.ptr());
    if (number == -1 && PyErr_Occurred() != nullptr) {
      PyErr_Clear();
      return std::nullopt;
    }
    return number;
  }
  static std::optional<std::uint64_t> as_unsigned(nb::handle value) {
    const unsigned long long number = PyLong_AsUnsignedLongLong(value.ptr());
    if (PyErr_Occurred() != nullptr) {
      PyErr_Clear();
      return std::nullopt;
    }
    return number;
  }
  /// Return the value as an int, if its type is one of integers.
  static std::optional<nb::object> index(nb::handle value);
  static nb::object whole(double number) { return steal(PyLong_FromDouble(number)); }

  /// Return a value's `repr`, shortened. Never raises: Python cannot print an integer of more than 4 300 digits.
  static std::string shown(nb::handle value);
  static std::string type_name(nb::handle value) { return name_of_type(value); }

  /// The bytes of a text, or of a bytes-like object.
  class Characters {
   public:
    Characters(const FieldTable& field, nb::handle value, const Path& path);
    std::string_view view() const {
      return {PyBytes_AsString(bytes_.ptr()), static_cast<std::size_t>(PyBytes_Size(bytes_.ptr()))};
    }

   private:
    nb::object bytes_;
  };
};

/// Raise `wirebond.errors.MessageError` with this sentence for a `MessageError`, in everything that `module` offers.
void translate_errors();

}  // namespace wirebond::engine
