// Values as Python objects, for engine/fields.hpp.
#include "python_values.hpp"

#include <nanobind/stl/string.h>

#include "ended_threads.hpp"

namespace wirebond::engine {

namespace {

nb::object message_error() { return nb::module_::import_("wirebond.errors").attr("MessageError"); }

std::string no_number(const Path& path, nb::handle value) {
  return path.text() + " is " + PythonValues::shown(value) + " (" + name_of_type(value) + "); expected a number";
}

/// Check whether its type defines how it becomes a number. An exception of that function belongs to the caller, and
/// passes.
bool is_number(nb::handle value) {
  auto* const type = reinterpret_cast<PyTypeObject*>(value.type().ptr());
  return PyType_GetSlot(type, Py_nb_float) != nullptr || PyType_GetSlot(type, Py_nb_index) != nullptr;
}

/// Raise MessageError for a value that could have been a number, with its exception as the cause.
[[noreturn]] void no_number_because(nb::python_error cause, const Path& path, nb::handle value) {
  const nb::object error = message_error()(nb::str(no_number(path, value).c_str()));
  PyException_SetCause(error.ptr(), nb::borrow(cause.value()).release().ptr());
  PyErr_SetObject(reinterpret_cast<PyObject*>(Py_TYPE(error.ptr())), error.ptr());
  throw nb::python_error();
}

}  // namespace

double PythonValues::number(nb::handle value, const Path& path) {
  if (PyUnicode_Check(value.ptr()) || !is_number(value)) throw MessageError(no_number(path, value));
  const double number = PyFloat_AsDouble(value.ptr());
  if (number != -1.0 || PyErr_Occurred() == nullptr) return number;
  if (PyErr_ExceptionMatches(PyExc_TypeError) != 0) no_number_because(nb::python_error(), path, value);
  if (PyLong_Check(value.ptr()) == 0) throw nb::python_error();  // raised by the value's own __float__
  PyErr_Clear();
  throw MessageError(path.text() + " is too large for a 64-bit number");
}

std::optional<nb::object> PythonValues::index(nb::handle value) {
  if (PyIndex_Check(value.ptr()) == 0) return std::nullopt;
  nb::object index = nb::steal(PyNumber_Index(value.ptr()));
  if (index.is_valid()) return index;
  // A numpy array has __index__, which raises; its __float__ decides.
  if (PyErr_ExceptionMatches(PyExc_TypeError) == 0) throw nb::python_error();
  PyErr_Clear();
  return std::nullopt;
}

std::string PythonValues::shown(nb::handle value) {
  return nb::cast<std::string>(nb::module_::import_("wirebond.arguments").attr("shown")(value));
}

PythonValues::Characters::Characters(const FieldTable& field, nb::handle value, const Path& path) {
  if (field.kind == FieldKind::text) {
    if (!PyUnicode_Check(value.ptr())) wrong_type<PythonValues>(path, value, "text");
    bytes_ = nb::steal(PyUnicode_AsUTF8String(value.ptr()));
    if (bytes_.is_valid()) return;
    PyErr_Clear();
    wrong_type<PythonValues>(path, value, "text that UTF-8 can hold");
  }
  if (!PyBytes_Check(value.ptr()) && !PyByteArray_Check(value.ptr())) wrong_type<PythonValues>(path, value, "bytes");
  bytes_ = steal(PyBytes_FromObject(value.ptr()));
}

void translate_errors() {
  nb::register_exception_translator([](const std::exception_ptr& error, void*) {
    EndedThreads::sleep_if_ended(error);
    try {
      std::rethrow_exception(error);
    } catch (const MessageError& refused) {
      const std::string_view text = refused.what();
      PyErr_SetObject(message_error().ptr(), nb::str(text.data(), text.size()).ptr());
    }
  });
}

}  // namespace wirebond::engine
