// Nodes as Python objects and back, and what Python keeps for tables: names as interned texts, defaults as objects.
#include "objects.hpp"

#include <nanobind/stl/string.h>

#include <cstdint>
#include <stdexcept>
#include <utility>

namespace wirebond::engine {

namespace {

nb::object text_object(const std::string& text) {
  return steal(PyUnicode_DecodeUTF8(text.data(), static_cast<Py_ssize_t>(text.size()), "replace"));
}

void keep(std::vector<FieldTable>& fields) {
  for (FieldTable& field : fields) {
    auto objects = std::make_shared<FieldObjects>();
    objects->key = interned(field.name);
    objects->default_value = to_object(field.default_value);
    for (const auto& [name, number] : field.enumerators) objects->enumerators.push_back(interned(name));
    for (const auto& [name, bit] : field.flags) objects->flags.push_back(interned(name));
    field.kept = std::move(objects);
    keep(field.fields);
  }
}

}  // namespace

nb::object steal(PyObject* object) {
  if (object == nullptr) throw nb::python_error();
  return nb::steal(object);
}

nb::object interned(const std::string& text) { return steal(PyUnicode_InternFromString(text.c_str())); }

std::string name_of_type(nb::handle object) {
  return nb::cast<std::string>(nb::object(object.type().attr("__name__")));
}

nb::object to_object(const Node& node) {
  if (node.is_none()) return nb::none();
  if (node.is_bool()) return nb::borrow(node.as<bool>() ? Py_True : Py_False);
  if (node.is_integer()) {
    return steal(node.is_negative() ? PyLong_FromLongLong(node.as<std::int64_t>())
                                    : PyLong_FromUnsignedLongLong(node.bits()));
  }
  if (node.is_float()) return steal(PyFloat_FromDouble(node.as<double>()));
  if (node.is_text()) return text_object(node.text());
  if (node.is_bytes()) return nb::bytes(node.bytes().data(), node.bytes().size());
  if (node.is_list()) {
    nb::list out;
    for (const Node& one : node.list()) out.append(to_object(one));
    return out;
  }
  nb::dict out;
  for (const auto& [key, value] : node.map()) out[interned(key)] = to_object(value);
  return out;
}

Node to_node(nb::handle object) {
  PyObject* const at = object.ptr();
  if (object.is_none()) return {};
  if (PyBool_Check(at)) return Node(at == Py_True);
  if (PyLong_Check(at)) {
    int overflow = 0;
    const long long number = PyLong_AsLongLongAndOverflow(at, &overflow);
    return overflow == 0 ? Node(number) : Node(nb::cast<std::uint64_t>(object));
  }
  if (PyFloat_Check(at)) return Node(PyFloat_AsDouble(at));
  if (PyUnicode_Check(at)) {
    Py_ssize_t size = 0;
    const char* const text = PyUnicode_AsUTF8AndSize(at, &size);
    if (text == nullptr) throw nb::python_error();
    return Node(std::string(text, static_cast<std::size_t>(size)));
  }
  if (PyBytes_Check(at)) {
    const auto* const from = reinterpret_cast<const std::uint8_t*>(PyBytes_AsString(at));
    return Node(Node::Bytes(from, from + PyBytes_Size(at)));
  }
  if (PyTuple_Check(at) || PyList_Check(at)) {
    Node::List out;
    for (nb::handle one : object) out.push_back(to_node(one));
    return Node(std::move(out));
  }
  if (!PyDict_Check(at)) throw std::logic_error("the engine was given a value of a kind that no table has");
  Node::Map out;
  for (auto [key, value] : nb::borrow<nb::dict>(object)) out.emplace_back(to_node(key).text(), to_node(value));
  return Node(std::move(out));
}

Node unpacked(const nb::bytes& bytes) { return unpacked(static_cast<const std::uint8_t*>(bytes.data()), bytes.size()); }

std::shared_ptr<ProtocolTable> protocol_table(const nb::bytes& bytes) {
  auto table = std::make_shared<ProtocolTable>(unpacked(bytes));
  for (MessageTable& message : table->messages()) {
    message.kept = std::make_shared<MessageObjects>(MessageObjects{interned(message.name), interned(message.sender)});
    keep(message.fields);
  }
  return table;
}

std::shared_ptr<FormatTable> format_table(const nb::bytes& bytes) {
  auto table = std::make_shared<FormatTable>(unpacked(bytes));
  keep(table->header());
  return table;
}

nb::list to_list(const std::vector<std::string>& sentences) {
  nb::list out;
  for (const std::string& sentence : sentences) out.append(text_object(sentence));
  return out;
}

}  // namespace wirebond::engine
