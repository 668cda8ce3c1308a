// The engine's Python interface: classes and functions only, no algorithm.
#include <nanobind/nanobind.h>
#include <nanobind/stl/optional.h>
#include <nanobind/stl/shared_ptr.h>
#include <nanobind/stl/string.h>
#include <nanobind/stl/unique_ptr.h>

#include "cdr_command.hpp"
#include "cdr_packer.hpp"
#include "columns.hpp"
#include "decoder.hpp"
#include "ended_threads.hpp"
#include "link_core_binding.hpp"
#include "mcap_records.hpp"
#include "objects.hpp"
#include "packing.hpp"
#include "ports.hpp"
#include "python_values.hpp"

namespace nb = nanobind;
using namespace nb::literals;
using namespace wirebond::engine;

namespace wirebond::engine {
extern const char* const interface_bytes;  // written by engine_interface.py
extern const char* const interface_shapes;
}  // namespace wirebond::engine

namespace {

int traverse_message(PyObject* self, visitproc visit, void* arg) {
#if PY_VERSION_HEX >= 0x03090000
  Py_VISIT(Py_TYPE(self));
#endif
  if (!nb::inst_ready(self)) return 0;
  int found = 0;
  nb::inst_ptr<Message>(self)->visit([&](const nb::object& kept) {
    if (found == 0 && kept.is_valid()) found = visit(kept.ptr(), arg);
  });
  return found;
}

int clear_message(PyObject* self) {
  nb::inst_ptr<Message>(self)->visit([](nb::object& kept) { kept.reset(); });
  return 0;
}

PyType_Slot message_slots[] = {
    {Py_tp_traverse, reinterpret_cast<void*>(traverse_message)},
    {Py_tp_clear, reinterpret_cast<void*>(clear_message)},
    {0, nullptr},
};

nb::bytes encode(const ProtocolTable& protocol, const FormatTable& format, std::size_t index, nb::dict values,
                 nb::dict header, int form) {
  const MessageTable& message = protocol.messages().at(index);
  const GivenHeader given = encode_header<PythonValues>(format, header);
  const std::vector<std::uint8_t> wire =
      seal_frame(format, protocol, index, encode_fields<PythonValues>(message, values), given, form);
  return nb::bytes(reinterpret_cast<const char*>(wire.data()), wire.size());
}

/// Return one value for each header field of the format, by index.
nb::list header_bits(const FormatTable& format, nb::dict header) {
  const GivenHeader given = encode_header<PythonValues>(format, header);
  nb::list out;
  for (std::size_t i = 0; i < format.header().size(); ++i) out.append(given.values[i]);
  return out;
}

}  // namespace

NB_MODULE(_engine, m) {
  // A thread that sleeps in a link when the interpreter ends keeps its objects: that is not a leak of the program.
  nb::set_leak_warnings(false);
  m.doc() = "Compiled engine of wirebond. Use the wirebond package; this module's names are private.";
  m.attr("interface") = nb::make_tuple(interface_bytes, interface_shapes);

  translate_errors();
  m.def("hold_ended_threads", &EndedThreads::hold);
  nb::module_::import_("atexit").attr("register")(m.attr("hold_ended_threads"));

  nb::class_<ProtocolTable>(m, "ProtocolTable").def(nb::new_(&protocol_table), "table"_a);
  nb::class_<FormatTable>(m, "FormatTable").def(nb::new_(&format_table), "table"_a);

  nb::class_<Message>(m, "Message", nb::type_slots(message_slots), "One frame that passed every check.")
      .def_prop_ro("name", &Message::name,
                   "The message's name; 'unknown' for an unknown id or a payload too short for it.")
      .def_prop_ro("sender", &Message::sender, "'host', 'mcu' or 'both'; None for an unknown message.")
      .def_prop_ro("fields", &Message::fields, "Values in SI units by field name, decoded when first asked for.")
      .def_prop_ro("violations", &Message::violations, "Field rules that it breaks, a sentence each.")
      .def_prop_ro("header", &Message::header, "Values of the frame's named header fields.")
      .def_prop_ro("raw", &Message::raw, "The frame's bytes as received, delimiters included.")
      .def_prop_ro("payload", &Message::payload, "The payload's bytes.")
      .def_prop_ro("id", &Message::id, "The id on the wire.")
      .def_prop_ro("t", &Message::time, "Time of the feed that completed it, in seconds.")
      .def_prop_ro("stamp", &Message::stamp, "The host's time of the MCU's time stamp, in seconds; or None.")
      .def_prop_ro("stamp_error", &Message::stamp_error, "Seconds by which it is wrong at most; or None.")
      .def_prop_ro("offset", &Message::offset, "Of its first byte in the stream.")
      .def("__getitem__", &Message::field, "name"_a, "The value of this field. KeyError where it has none.")
      .def(
          "__contains__",
          [](Message& self, nb::handle name) {
            const int found = PyDict_Contains(self.fields().ptr(), name.ptr());
            if (found < 0) throw nb::python_error();
            return found != 0;
          },
          "name"_a.none(), "Has it a field of this name?")
      .def(
          "__iter__", [](Message& self) { return nb::iter(self.fields()); }, "The names of its fields, in their order.")
      .def(
          "keys", [](Message& self) { return self.fields().attr("keys")(); },
          "The names of its fields, so that dict(message) is possible.")
      .def("__repr__",
           [](Message& self) { return nb::str("<wirebond.Message {} {}>").format(self.name(), self.fields()); });

  nb::class_<CdrPacker>(m, "CdrPacker")
      .def_static("make", &CdrPacker::make, "protocol"_a, "plan"_a)
      .def("pack", &CdrPacker::pack, "messages"_a, "stamps_ns"_a);
  m.def("stamps_ns", &stamps_ns, "messages"_a, "ahead_ns"_a);
  nb::class_<CdrCommand>(m, "CdrCommand")
      .def_static("make", &CdrCommand::make, "protocol"_a, "format"_a, "plan"_a, "bounds"_a)
      .def("frames", &CdrCommand::frames, "messages"_a, "first"_a = 0);

  m.def("encode", &encode, "protocol"_a, "format"_a, "index"_a, "values"_a, "header"_a, "form"_a = -1);
  m.def("header_bits", &header_bits, "format"_a, "header"_a);
  m.def("pack_messages", &pack_messages, "messages"_a);
  m.def("unpack_messages", &unpack_messages, "protocol"_a, "format"_a, "records"_a, "shift"_a = 0.0,
        "stamper"_a = nb::none());
  m.def("message_records", &message_records, "buffer"_a, "at"_a, "end"_a);
  m.def("gathered", &gathered, "buffer"_a, "places"_a, "sizes"_a);
  m.def("packed_records", &packed_records, "buffer"_a, "pieces"_a, "decoded"_a, "payloads"_a);
  bind_decoder(m);
  bind_columns(m);
  bind_link_core(m);
  bind_ports(m);
}
