// Converts a stream of bytes to Message objects for Python. Waits for nothing, opens nothing; time is an argument.
#include "decoder.hpp"

#include <algorithm>
#include <cmath>
#include <cstring>
#include <stdexcept>

#include "python_values.hpp"

namespace wirebond::engine {

BufferView::BufferView(nb::handle object) {
  if (PyObject_CheckBuffer(object.ptr()) == 0) {
    PyErr_Format(PyExc_TypeError, "expected bytes, a bytearray, a memoryview or another buffer, not %s",
                 Py_TYPE(object.ptr())->tp_name);
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

nb::list to_list(const std::shared_ptr<Batch>& batch, const std::vector<Event>& events, const nb::object& stamper) {
  nb::list out;
  const std::shared_ptr<const Batch> shared = batch;
  for (const Event& event : events) out.append(nb::cast(Message(shared, event, stamper)));
  return out;
}

Decoder::Decoder(std::shared_ptr<const ProtocolTable> protocol, std::shared_ptr<const FormatTable> format,
                 double idle_seconds)
    : protocol_(std::move(protocol)),
      format_(std::move(format)),
      workspace_(workspace_bytes(format_->source())),
      deframer_(format_->source(), workspace_.data(), static_cast<std::uint64_t>(std::ceil(idle_seconds * 1e6))),
      counts_(protocol_->messages().size(), 0),
      sequence_(format_) {}

void Decoder::expect(std::int16_t message, int place, std::optional<std::uint64_t> address) {
  deframer_.expect(message);
  HostAddressing::Rules rules;
  rules.sender_place = address ? place : -1;
  rules.only_last_asked = true;
  addressing_ = HostAddressing(format_->format(), rules);
  if (address) addressing_.asks(message, *address);
}

double Decoder::seconds(nb::handle value) {
  const double time = PyFloat_AsDouble(value.ptr());
  if (time == -1.0 && PyErr_Occurred() != nullptr) throw nb::python_error();
  if (!std::isfinite(time) || std::fabs(time) > 9e12) {
    const nb::object text = nb::str("t is {!r}; expected a finite number of seconds").format(value);
    const nb::object type = nb::module_::import_("wirebond.errors").attr("UsageError");
    PyErr_SetObject(type.ptr(), text.ptr());
    throw nb::python_error();
  }
  return time;
}

std::uint64_t Decoder::microseconds(double time) {
  if (time > latest_) latest_ = time;  // a clock that steps back must not count as a long silence
  return static_cast<std::uint64_t>(static_cast<std::int64_t>(std::llround(latest_ * 1e6)));
}

std::shared_ptr<Batch> Decoder::new_batch() const {
  const auto batch = std::make_shared<Batch>();
  batch->protocol = protocol_;
  batch->format = format_;
  return batch;
}

struct Decoder::Recording {
  Decoder& decoder;
  Batch& batch;
  double time = 0;
  bool keep = true;        ///< false: frames are only counted
  std::uint32_t read = 0;  ///< index of the read that brings the frames
  std::vector<Event> events{};
  std::vector<std::uint32_t> reads{};  ///< index of the read of each event

  void operator()(const Frame& frame) {
    if (frame.message >= 0) ++decoder.counts_[static_cast<std::size_t>(frame.message)];
    decoder.sequence_.take(frame);
    if (decoder.addressing_.is_foreign(frame)) return decoder.foreign_.add(frame);
    if (!keep) return;
    if (batch.bytes.size() > UINT32_MAX / 2) throw std::length_error("more than 2 GiB of frames in one call");
    events.push_back(record(frame, time, batch));
    reads.push_back(read);
  }
};

nb::list Decoder::feed(nb::handle bytes, nb::handle t) {
  const BufferView view(bytes);
  const double time = seconds(t);
  const std::uint64_t now = microseconds(time);
  const auto batch = new_batch();
  Recording sink{*this, *batch, time};
  deframer_.feed(view.data(), view.size(), now, sink);
  return to_list(batch, sink.events, stamper_);
}

nb::tuple Decoder::feed_reads(nb::handle buffer, nb::handle places, nb::handle sizes, nb::handle times, bool keep) {
  const BufferView view(buffer);
  const BufferView at(places);
  const BufferView of(sizes);
  const BufferView began(times);
  const std::size_t count = began.size() / sizeof(double);
  if (at.size() / sizeof(std::uint64_t) < count || of.size() / sizeof(std::uint32_t) < count) {
    throw std::invalid_argument("fewer places or sizes than times");
  }
  const auto batch = new_batch();
  Recording sink{*this, *batch};
  sink.keep = keep;
  for (std::size_t i = 0; i < count; ++i) {
    std::uint64_t place = 0;
    std::uint32_t size = 0;
    std::memcpy(&place, at.data() + i * sizeof place, sizeof place);
    std::memcpy(&size, of.data() + i * sizeof size, sizeof size);
    std::memcpy(&sink.time, began.data() + i * sizeof sink.time, sizeof sink.time);
    if (place > view.size() || size > view.size() - place) throw std::invalid_argument("a place lies outside");
    if (!std::isfinite(sink.time) || std::fabs(sink.time) > 9e12) throw std::invalid_argument("a time is not finite");
    sink.read = static_cast<std::uint32_t>(i);
    const std::uint64_t now = microseconds(sink.time);
    deframer_.idle(now, sink);
    deframer_.feed(view.data() + place, size, now, sink);
  }
  return nb::make_tuple(
      to_list(batch, sink.events, stamper_),
      nb::bytes(reinterpret_cast<const char*>(sink.reads.data()), sink.reads.size() * sizeof(std::uint32_t)));
}

nb::list Decoder::idle(nb::handle t) {
  const double time = seconds(t);
  const std::uint64_t now = microseconds(time);
  const auto batch = new_batch();
  Recording sink{*this, *batch, time};
  deframer_.idle(now, sink);
  return to_list(batch, sink.events, stamper_);
}

nb::list Decoder::finish() {
  const auto batch = new_batch();
  Recording sink{*this, *batch, latest_};
  deframer_.give_up(sink);
  return to_list(batch, sink.events, stamper_);
}

}  // namespace wirebond::engine
