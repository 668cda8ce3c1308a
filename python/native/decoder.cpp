// Received messages as Python sees them.
#include "decoder.hpp"

#include <nanobind/stl/optional.h>
#include <nanobind/stl/shared_ptr.h>

#include <algorithm>
#include <cmath>
#include <cstring>
#include <stdexcept>

#include "python_values.hpp"

namespace wirebond::engine {

BufferView::BufferView(nb::handle object) {
  if (PyObject_CheckBuffer(object.ptr()) == 0) {
    PyErr_Format(PyExc_TypeError, "expected bytes, a bytearray, a memoryview or another buffer, not %s",
                 name_of_type(object).c_str());
    throw nb::python_error();
  }
  if (PyObject_GetBuffer(object.ptr(), &view_, PyBUF_SIMPLE) == 0) {
    data_ = static_cast<const std::uint8_t*>(view_.buf);
    return;
  }
  PyErr_Clear();
  if (PyObject_GetBuffer(object.ptr(), &view_, PyBUF_FULL_RO) != 0) throw nb::python_error();
  gathered_.resize(size());  // its bytes are not adjacent, like those of every second element
  if (PyBuffer_ToContiguous(gathered_.data(), &view_, view_.len, 'C') != 0) {
    PyBuffer_Release(&view_);
    throw nb::python_error();
  }
  data_ = gathered_.data();
}

nb::object Message::name() const {
  return table() != nullptr ? MessageObjects::of(*table()).name : nb::object(nb::str("unknown"));
}

nb::object Message::sender() const {
  return table() != nullptr ? MessageObjects::of(*table()).sender : nb::object(nb::none());
}

nb::bytes Message::raw() const {
  return nb::bytes(reinterpret_cast<const char*>(batch_->bytes.data() + event_.wire_at), event_.wire_size);
}

nb::bytes Message::payload() const {
  return nb::bytes(reinterpret_cast<const char*>(payload_bytes()), event_.payload_size);
}

nb::object Message::fields() {
  if (!fields_.is_valid()) {
    fields_ = table() != nullptr ? decode_fields<PythonValues>(*table(), payload_bytes(), event_.payload_size)
                                 : nb::object(nb::dict());
  }
  return fields_;
}

nb::object Message::field(nb::str name) {
  const nb::object all = fields();
  nb::object value = nb::borrow(PyDict_GetItemWithError(all.ptr(), name.ptr()));
  if (value.is_valid()) return value;
  if (PyErr_Occurred() != nullptr) throw nb::python_error();
  const nb::object names = nb::str(", ").attr("join")(all);
  const nb::object text = nb::str("{} has no field {!r}; it has {}")
                              .format(this->name(), name, nb::len(all) == 0 ? nb::object(nb::str("none")) : names);
  PyErr_SetObject(PyExc_KeyError, text.ptr());
  throw nb::python_error();
}

nb::list Message::violations() const {
  if (table() == nullptr) return nb::list();
  std::vector<std::string> found = find_violations(*table(), payload_bytes(), event_.payload_size);
  add_header_violations(*batch_->format, event_.form, batch_->headers.data() + event_.header_at, found);
  return to_list(found);
}

nb::object Message::header() const {
  return decode_header<PythonValues>(*batch_->format, event_.form, batch_->headers.data() + event_.header_at);
}

nb::object Message::stamped(std::size_t place) {
  if (!stamp_.is_valid()) {
    if (!stamper_.is_valid() || stamper_.is_none()) return nb::none();
    nb::object found = stamper_(nb::find(this));
    if (found.is_none()) return found;  // the MCU's clock may be known later
    stamp_ = std::move(found);
  }
  return stamp_[place];
}

nb::list to_list(const Arrivals& arrivals, const nb::object& stamper) {
  nb::list out;
  const std::shared_ptr<const Batch> shared = arrivals.batch;
  for (const Event& event : arrivals.events) out.append(nb::cast(Message(shared, event, stamper)));
  return out;
}

namespace {

/// A decoder whose messages are stamped.
struct StampedDecoder : Decoder {
  using Decoder::Decoder;
  nb::object stamper;  ///< of later messages; see Message
};

bool is_time(double time) { return std::isfinite(time) && std::fabs(time) <= 9e12; }

double seconds(nb::handle value) {
  const double time = PyFloat_AsDouble(value.ptr());
  if (time == -1.0 && PyErr_Occurred() != nullptr) throw nb::python_error();
  if (!is_time(time)) {
    const nb::object text = nb::str("t is {!r}; expected a finite number of seconds").format(value);
    const nb::object type = nb::module_::import_("wirebond.errors").attr("UsageError");
    PyErr_SetObject(type.ptr(), text.ptr());
    throw nb::python_error();
  }
  return time;
}

nb::list feed(StampedDecoder& decoder, nb::handle bytes, nb::handle t) {
  const BufferView view(bytes);
  return to_list(decoder.feed(view.data(), view.size(), seconds(t)), decoder.stamper);
}

/// Process many reads at once: `idle` and `feed` for each. `places` (u64) and `sizes` (u32) locate their bytes in
/// `buffer`, `times` (f64) are their starts. Returns the messages, and for each the index of its read (u32). Without
/// `keep` they are only counted.
nb::tuple feed_reads(StampedDecoder& decoder, nb::handle buffer, nb::handle places, nb::handle sizes, nb::handle times,
                     bool keep) {
  const BufferView view(buffer);
  const BufferView at(places);
  const BufferView of(sizes);
  const BufferView began(times);
  const std::size_t count = began.size() / sizeof(double);
  if (at.size() / sizeof(std::uint64_t) < count || of.size() / sizeof(std::uint32_t) < count) {
    throw std::invalid_argument("fewer places or sizes than times");
  }
  Arrivals found = decoder.none();
  std::vector<std::uint32_t> reads;
  for (std::size_t i = 0; i < count; ++i) {
    std::uint64_t place = 0;
    std::uint32_t size = 0;
    double time = 0;
    std::memcpy(&place, at.data() + i * sizeof place, sizeof place);
    std::memcpy(&size, of.data() + i * sizeof size, sizeof size);
    std::memcpy(&time, began.data() + i * sizeof time, sizeof time);
    if (place > view.size() || size > view.size() - place) throw std::invalid_argument("a place is outside the data");
    if (!is_time(time)) throw std::invalid_argument("a time is not finite");
    decoder.read(view.data() + place, size, time, keep, found);
    reads.resize(found.events.size(), static_cast<std::uint32_t>(i));
  }
  return nb::make_tuple(to_list(found, decoder.stamper), nb::bytes(reads.data(), reads.size() * sizeof(std::uint32_t)));
}

}  // namespace

void bind_decoder(nb::module_& m) {
  nb::class_<StampedDecoder>(m, "Decoder")
      .def(
          "__init__",
          [](StampedDecoder* self, std::shared_ptr<const ProtocolTable> protocol,
             std::shared_ptr<const FormatTable> format,
             double idle_seconds) { new (self) StampedDecoder(std::move(protocol), std::move(format), idle_seconds); },
          nb::arg("protocol"), nb::arg("format"), nb::arg("idle_seconds"))
      .def("feed", &feed, nb::arg("bytes").none(), nb::arg("t").none())
      .def("feed_reads", &feed_reads, nb::arg("buffer"), nb::arg("places"), nb::arg("sizes"), nb::arg("times"),
           nb::arg("keep"))
      .def(
          "expect",
          [](StampedDecoder& self, std::int16_t message, int place, std::optional<std::uint64_t> address) {
            self.expect(message, place, address);
          },
          nb::arg("message"), nb::arg("place") = -1, nb::arg("address") = nb::none())
      .def(
          "idle", [](StampedDecoder& self, nb::handle t) { return to_list(self.idle(seconds(t)), self.stamper); },
          nb::arg("t").none())
      .def("finish", [](StampedDecoder& self) { return to_list(self.finish(), self.stamper); })
      .def(
          "set_stamper", [](StampedDecoder& self, nb::object stamper) { self.stamper = std::move(stamper); },
          nb::arg("stamper").none())
      .def("stats", [](const StampedDecoder& self) { return to_object(self.account()); });
}

}  // namespace wirebond::engine
