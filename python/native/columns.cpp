// Captures and streams as numpy columns, without a Python object per message.
#include "columns.hpp"

#include <nanobind/ndarray.h>
#include <nanobind/stl/shared_ptr.h>

#include <algorithm>
#include <chrono>
#include <cmath>
#include <condition_variable>
#include <cstring>
#include <exception>
#include <mutex>
#include <stdexcept>
#include <thread>
#include <type_traits>
#include <vector>

#include "decoder.hpp"
#include "python_values.hpp"
#include "wirebond/engine/account.hpp"
#include "wirebond/engine/capture.hpp"
#include "wirebond/engine/columns.hpp"
#include "wirebond/engine/follower.hpp"

namespace wirebond::engine {

namespace {

constexpr std::size_t watched_size = std::size_t{1} << 18;  // bytes; a smaller capture needs no progress display

/// Call `each` with a zero of the smallest integer type that holds the field's numbers.
template <class Each>
nb::object with_integer_type(const FieldTable& field, Each each) {
  if (field.is_signed) {
    if (field.width <= 8) return each(std::int8_t{0});
    if (field.width <= 16) return each(std::int16_t{0});
    if (field.width <= 32) return each(std::int32_t{0});
    return each(std::int64_t{0});
  }
  if (field.width <= 8) return each(std::uint8_t{0});
  if (field.width <= 16) return each(std::uint16_t{0});
  if (field.width <= 32) return each(std::uint32_t{0});
  return each(std::uint64_t{0});
}

/// Make a numpy array over `values`, which `owner` keeps alive: one element per row, or `field->count` of them.
template <class T>
nb::object array_over(T* values, std::size_t rows, const FieldTable* field, const nb::capsule& owner) {
  if (field != nullptr && field->repeat != Repeat::once) {
    const std::size_t shape[2] = {rows, field->count};
    return nb::cast(nb::ndarray<nb::numpy, T>(values, 2, shape, owner));
  }
  const std::size_t shape[1] = {rows};
  return nb::cast(nb::ndarray<nb::numpy, T>(values, 1, shape, owner));
}

template <class T>
nb::object make_array(std::vector<T>&& values) {
  auto* const owned = new std::vector<T>(std::move(values));
  const nb::capsule owner(owned, [](void* p) noexcept { delete static_cast<std::vector<T>*>(p); });
  return array_over(owned->data(), owned->size(), nullptr, owner);
}

/// Make a column. `value` converts a number's bits to an element.
template <class T, class Value>
nb::object column_of(const Column& column, const Rows& rows, std::size_t stride, Value value) {
  const std::size_t count = rows.offsets.size();
  T* const values = new T[count * column.field->count];  // each is written below
  const nb::capsule owner(values, [](void* p) noexcept { delete[] static_cast<T*>(p); });
  fill_column(column, rows, stride, values, value);
  return array_over(values, count, column.field, owner);
}

/// Make a column of numbers that a row may lack: floats, NaN for such a row.
nb::object lacking_column(const Column& column, const Rows& rows, std::size_t stride) {
  const std::size_t count = rows.offsets.size();
  const std::size_t size = count * column.field->count;
  auto* const values = new double[size];
  const nb::capsule owner(values, [](void* p) noexcept { delete[] static_cast<double*>(p); });
  std::fill(values, values + size, std::nan(""));
  fill_column(column, rows, stride, values, [&](std::uint64_t bits) { return value_of(*column.field, bits); });
  return array_over(values, count, column.field, owner);
}

nb::object number_column(Column& column, const Rows& rows, std::size_t stride) {
  if (column.field->digits) return make_array(std::move(column.numbers));
  if (column.may_lack) return lacking_column(column, rows, stride);
  const FieldTable& field = *column.field;
  const auto whole = [&](std::uint64_t bits) { return whole_of(field, bits); };
  const auto real = [&](std::uint64_t bits) { return float_of(field, bits); };
  const auto scale = [&](double wire) { return to_si(field, wire); };
  switch (field.kind) {
    case FieldKind::boolean:
      return column_of<std::uint8_t>(column, rows, stride, [](std::uint64_t bits) { return bits != 0 ? 1 : 0; })
          .attr("view")("bool");
    case FieldKind::floating:
      if (field.scaled) {
        return column_of<double>(column, rows, stride, [&](std::uint64_t bits) { return scale(real(bits)); });
      }
      if (field.size < sizeof(double)) return column_of<float>(column, rows, stride, real);
      return column_of<double>(column, rows, stride, real);
    default:
      if (field.scaled) {
        return column_of<double>(column, rows, stride,
                                 [&](std::uint64_t bits) { return scale(whole_as_double(field, whole(bits))); });
      }
      return with_integer_type(field,
                               [&](auto zero) { return column_of<decltype(zero)>(column, rows, stride, whole); });
  }
}

/// Keeps the values for which numpy has no type, as lists by column.
struct Objects {
  std::vector<nb::list> lists;

  void value(std::size_t column, const FieldTable& field, std::size_t place, std::uint64_t promised, Walk& walk) {
    lists[column].append(decode_field<PythonValues>(field, place, promised, walk));
  }
  void none(std::size_t column) { lists[column].append(nb::none()); }
};

nb::dict columns_of(const MessageTable& message, const Rows& rows) {
  std::vector<Column> columns = columns_of(message);
  Objects objects{std::vector<nb::list>(columns.size())};
  read_rows(message, rows, columns, objects);
  nb::dict out;
  for (std::size_t i = 0; i < columns.size(); ++i) {
    Column& column = columns[i];
    out[column.name.c_str()] =
        column.holds_values() ? nb::object(objects.lists[i]) : number_column(column, rows, message.min_payload);
  }
  return out;
}

template <class T, class Value>
nb::object header_column_of(const Rows& rows, std::size_t place, std::size_t fields, Value value) {
  std::vector<T> out;
  out.reserve(rows.offsets.size());
  for (std::size_t i = place; i < rows.header.size(); i += fields) out.push_back(static_cast<T>(value(rows.header[i])));
  return make_array(std::move(out));
}

/// Make a column of one header field of all frames, with the type that a message's field has in its column.
nb::object header_column(const FieldTable& field, const Rows& rows, std::size_t place, std::size_t fields) {
  const auto whole = [&](std::uint64_t bits) { return whole_of(field, bits); };
  if (field.scaled) {
    return header_column_of<double>(
        rows, place, fields, [&](std::uint64_t bits) { return to_si(field, whole_as_double(field, whole(bits))); });
  }
  return with_integer_type(field,
                           [&](auto zero) { return header_column_of<decltype(zero)>(rows, place, fields, whole); });
}

/// Add `header.servo` after the message's own columns. A column of the message with this name stays.
void add_header_columns(const FormatTable& format, const Rows& rows, nb::dict& columns) {
  const std::vector<FieldTable>& fields = format.header();
  for (std::size_t place = 0; place < fields.size(); ++place) {
    const std::string name = "header." + fields[place].name;
    if (!columns.contains(name.c_str())) {
      columns[name.c_str()] = header_column(fields[place], rows, place, fields.size());
    }
  }
}

/// Decode without the GIL; take it from time to time, and at the end, for `progress(done, size)` and for Ctrl-C.
template <class Decode>
Capture decode_watched(Decode decode, std::size_t total, nb::handle progress) {
  std::atomic<std::uint64_t> done{0};
  std::atomic<bool> cancelled{false};
  bool ready = false;
  std::mutex mutex;  // guards `ready`
  std::condition_variable is_ready;
  Capture capture;
  std::exception_ptr fault;
  std::thread work([&] {
    try {
      capture = decode(done, cancelled);
    } catch (...) {
      fault = std::current_exception();
    }
    const std::lock_guard<std::mutex> lock(mutex);
    ready = true;
    is_ready.notify_one();
  });
  bool interrupted = false;
  const auto finished = [&] {
    const nb::gil_scoped_release release;
    std::unique_lock<std::mutex> lock(mutex);
    return is_ready.wait_for(lock, std::chrono::milliseconds(100), [&] { return ready; });
  };
  const auto tell = [&] {
    interrupted = PyErr_CheckSignals() != 0;
    if (interrupted || progress.is_none()) return;
    const nb::object told = nb::steal(PyObject_CallFunction(progress.ptr(), "KK", done.load(), std::uint64_t{total}));
    interrupted = !told.is_valid();
  };
  while (!finished()) {
    if (!interrupted) tell();
    cancelled = interrupted;
  }
  work.join();
  if (!interrupted && !fault) tell();
  if (interrupted) throw nb::python_error();
  if (fault) std::rethrow_exception(fault);
  return capture;
}

template <class Decode>
Capture decode(Decode decode, std::size_t size, nb::handle progress) {
  if (size >= watched_size) return decode_watched(decode, size, progress);
  const nb::gil_scoped_release release;  // the buffer view holds the capture
  std::atomic<std::uint64_t> done{0};
  const std::atomic<bool> cancelled{false};
  return decode(done, cancelled);
}

/// Events between the reads of a capture.
struct TimingMarks {
  std::vector<std::size_t> breaks;                             ///< the port was closed before the read of this index
  std::vector<std::pair<std::size_t, std::int16_t>> expected;  ///< before this read, this message was requested
};

/// Read `breaks` and `expected` of `reads`.
TimingMarks read_marks(const nb::dict& reads) {
  TimingMarks marks;
  for (nb::handle index : nb::list(reads["breaks"])) marks.breaks.push_back(nb::cast<std::size_t>(index));
  for (nb::handle one : nb::list(reads["expected"])) {
    marks.expected.emplace_back(nb::cast<std::size_t>(one[0]), nb::cast<std::int16_t>(one[1]));
  }
  return marks;
}

/// Throw if the ends of the reads fall, or are after the bytes.
void check_reads(const std::uint64_t* ends, std::size_t count, std::size_t size) {
  std::uint64_t last = 0;
  for (std::size_t i = 0; i < count; ++i) {
    if (ends[i] < last || ends[i] > size) throw std::invalid_argument("the reads do not fit");
    last = ends[i];
  }
}

/// Return the tables of the found messages, by name: "messages" of `decode_columns`. Takes the rows, and leaves the
/// rest of the capture. `with_empty`: also tables of messages that did not occur.
nb::dict message_tables(const ProtocolTable& protocol, const FormatTable& format, Capture&& capture,
                        bool with_empty = false) {
  const auto add_places = [](nb::dict& table, Rows& rows) {
    if (!rows.times.empty()) table["t"] = make_array(std::move(rows.times));
    if (!rows.sizes.empty()) table["size"] = make_array(std::move(rows.sizes));
    table["offset"] = make_array(std::move(rows.offsets));
  };
  nb::dict messages;
  for (std::size_t i = 0; i < capture.messages.size(); ++i) {
    const MessageTable& message = protocol.messages()[i];
    Rows& rows = capture.messages[i];
    if (rows.offsets.empty() && !with_empty) continue;
    nb::dict fields = columns_of(message, rows);
    add_header_columns(format, rows, fields);
    nb::dict table;
    table["fields"] = fields;
    add_places(table, rows);
    messages[MessageObjects::of(message).name] = table;
  }
  Rows& unknown = capture.unknown;
  if (!unknown.offsets.empty()) {
    nb::dict fields;
    fields["id"] = make_array(std::move(unknown.ids));
    add_header_columns(format, unknown, fields);
    nb::dict table;
    table["fields"] = fields;
    add_places(table, unknown);
    messages["unknown"] = table;
  }
  return messages;
}

/// Make the tables for Python, of a capture of this many bytes.
nb::dict tables_of(const std::shared_ptr<const ProtocolTable>& protocol,
                   const std::shared_ptr<const FormatTable>& format, Capture&& capture, std::size_t size) {
  std::vector<std::uint64_t> counts;
  for (const Rows& rows : capture.messages) counts.push_back(rows.offsets.size());
  nb::dict out;
  out["messages"] = message_tables(*protocol, *format, std::move(capture));
  SequenceBook sequence(format);
  for (const SeenNumber& seen : capture.numbers) sequence.take(seen);
  out["stats"] = to_object(
      account_node(capture.account, capture.unlisted, size, 0, *protocol, counts, *format, sequence.account()));
  return out;
}

/// Return {"messages": {name: {"offset": u64 array, "fields": {field: array}}}, "stats": {…}}. Messages that did not
/// occur are skipped. Scaled fields are float64 in SI units; others keep their wire type; arrays have shape (rows,
/// count); fields of structures have dotted names; strings, groups and arrays of varying size are lists of values.
/// Frames with an unknown id are under "unknown": offset and id. `threads` share a large capture;
/// `progress(done, size)` is called from time to time and at the end, unless it is None or the capture is small.
nb::dict decode_columns(const std::shared_ptr<const ProtocolTable>& protocol,
                        const std::shared_ptr<const FormatTable>& format, nb::handle bytes, unsigned threads,
                        nb::handle progress) {
  const BufferView view(bytes);
  const auto work = [&](std::atomic<std::uint64_t>& done, const std::atomic<bool>& cancelled) {
    return decode_capture(*protocol, *format, view.data(), view.size(), threads, done, cancelled);
  };
  return tables_of(protocol, format, decode(work, view.size(), progress), view.size());
}

/// Do the same for bytes that came read by read; each table has `t`: start of the read that completed the frame.
/// `reads`: `ends` (u64 each, in the capture) and `times` (f64, seconds, not falling) as buffers, `idle` in seconds,
/// `breaks` (the port was closed before the read of this index), `expected` (before the read of this index, this
/// message was requested). One thread works.
nb::dict decode_timed_columns(const std::shared_ptr<const ProtocolTable>& protocol,
                              const std::shared_ptr<const FormatTable>& format, nb::handle bytes, const nb::dict& reads,
                              nb::handle progress) {
  const BufferView view(bytes);
  const BufferView ends(reads["ends"]);
  const BufferView times(reads["times"]);
  Timing timing;
  timing.ends = reinterpret_cast<const std::uint64_t*>(ends.data());
  timing.times = reinterpret_cast<const double*>(times.data());
  timing.count = std::min(ends.size(), times.size()) / sizeof(std::uint64_t);
  timing.idle_us = static_cast<std::uint64_t>(std::ceil(nb::cast<double>(reads["idle"]) * 1e6));
  TimingMarks marks = read_marks(reads);
  timing.breaks = std::move(marks.breaks);
  timing.expected = std::move(marks.expected);
  check_reads(timing.ends, timing.count, view.size());
  const auto work = [&](std::atomic<std::uint64_t>& done, const std::atomic<bool>& cancelled) {
    return decode_timed(*protocol, *format, view.data(), timing, done, cancelled);
  };
  return tables_of(protocol, format, decode(work, view.size(), progress), view.size());
}

/// `reads`: as for `decode_timed_columns`, without `idle`; a break after the last read has the index of the next one.
nb::dict feed(Follower& follower, nb::handle bytes, const nb::dict& reads) {
  const BufferView view(bytes);
  const BufferView ends(reads["ends"]);
  const BufferView times(reads["times"]);
  TimingMarks marks = read_marks(reads);
  Reads given;
  given.ends = reinterpret_cast<const std::uint64_t*>(ends.data());
  given.times = reinterpret_cast<const double*>(times.data());
  given.count = std::min(ends.size(), times.size()) / sizeof(std::uint64_t);
  given.breaks = std::move(marks.breaks);
  given.expected = std::move(marks.expected);
  check_reads(given.ends, given.count, view.size());
  return message_tables(follower.protocol(), follower.format(), follower.feed(view.data(), given));
}

}  // namespace

void bind_columns(nb::module_& m) {
  m.def("decode_columns", &decode_columns, nb::arg("protocol"), nb::arg("format"), nb::arg("capture").none(),
        nb::arg("threads"), nb::arg("progress").none());
  m.def("decode_timed_columns", &decode_timed_columns, nb::arg("protocol"), nb::arg("format"), nb::arg("capture"),
        nb::arg("reads"), nb::arg("progress").none());
  nb::class_<Follower>(m, "Follower")
      .def(
          "__init__",
          [](Follower* self, std::shared_ptr<const ProtocolTable> protocol, std::shared_ptr<const FormatTable> format,
             double idle_seconds) { new (self) Follower(std::move(protocol), std::move(format), idle_seconds); },
          nb::arg("protocol"), nb::arg("format"), nb::arg("idle_seconds"))
      .def("feed", &feed, nb::arg("bytes"), nb::arg("reads"))
      .def(
          "idle", [](Follower& self, double t) { return message_tables(self.protocol(), self.format(), self.idle(t)); },
          nb::arg("t"))
      .def("tables",
           [](const Follower& self) { return message_tables(self.protocol(), self.format(), self.empty(), true); })
      .def("settled", &Follower::settled)
      .def("stats", [](const Follower& self) { return to_object(self.account()); });
}

}  // namespace wirebond::engine
