// Nodes as Python objects and back, and what Python keeps for tables: names as interned texts, defaults as objects.
#pragma once

#include <nanobind/nanobind.h>

#include <memory>
#include <string>
#include <vector>

#include "wirebond/engine/node.hpp"
#include "wirebond/engine/protocol.hpp"

namespace wirebond::engine {

namespace nb = nanobind;

/// Return an owned reference; throws Python's exception if there is none.
nb::object steal(PyObject* object);

/// Return the text, the same object for equal texts. Needs the GIL.
nb::object interned(const std::string& text);

/// Return the name of the object's type. Needs the GIL.
std::string name_of_type(nb::handle object);

/// Convert a node to None, bool, int, float, str, bytes, list or dict. Needs the GIL.
nb::object to_object(const Node& node);

/// Convert one of these, or a tuple. Throws std::logic_error for anything else. Needs the GIL.
Node to_node(nb::handle object);

/// Return the node of these bytes. Needs the GIL.
Node unpacked(const nb::bytes& bytes);

/// What Python keeps for a field.
struct FieldObjects {
  nb::object key;  ///< its name
  nb::object default_value;
  std::vector<nb::object> enumerators;  ///< their names
  std::vector<nb::object> flags;

  static const FieldObjects& of(const FieldTable& field) { return *static_cast<const FieldObjects*>(field.kept.get()); }
};

/// What Python keeps for a message.
struct MessageObjects {
  nb::object name;
  nb::object sender;

  static const MessageObjects& of(const MessageTable& message) {
    return *static_cast<const MessageObjects*>(message.kept.get());
  }
};

/// Return the tables of these bytes, with what Python keeps. Needs the GIL, as does the end of the last reference.
std::shared_ptr<ProtocolTable> protocol_table(const nb::bytes& bytes);
std::shared_ptr<FormatTable> format_table(const nb::bytes& bytes);

/// Return the sentences as a list. Needs the GIL.
nb::list to_list(const std::vector<std::string>& sentences);

}  // namespace wirebond::engine
