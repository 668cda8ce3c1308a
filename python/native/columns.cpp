// Converts a whole capture to numpy columns, without a Python object per message.
// One file: a capture is cut into parts, and the parts are joined again.
#include "columns.hpp"

#include <nanobind/ndarray.h>

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
#include "wirebond/engine/characters.hpp"

namespace wirebond::engine {

namespace {

constexpr std::size_t watched_size = std::size_t{1} << 18;  // bytes; a smaller capture needs no progress display

/// One column: a field that is no structure, of the message or of one element of a group.
struct Column {
  std::string name;  ///< dotted: `position.x`, `joints[3].position`
  const FieldTable* field;
  std::size_t at;                           ///< in the payload, if nothing before it varies in size
  bool moves = false;                       ///< something before it varies in size
  bool may_lack = false;                    ///< in an element that is not in every row
  std::vector<const std::uint8_t*> places;  ///< place in each row, if it moves; null: the row lacks it
  nb::object objects;                       ///< a list of values, if numpy has no type for them
  std::vector<double> numbers;              ///< of a number in characters: its values; NaN: the row has none
};

/// Check whether the field becomes a list of Python values: it varies in size, and is no group.
bool holds_objects(const FieldTable& field) { return field.is_string() || field.repeat == Repeat::listed; }

/// Check whether the field is flattened: a structure or group, into `elements_of` elements. A counted group has its
/// maximum number.
bool is_flattened(const FieldTable& field) { return field.kind == FieldKind::structure; }

std::size_t elements_of(const FieldTable& field) {
  return field.repeat == Repeat::listed ? field.max_count : field.repeat == Repeat::once ? 1 : field.count;
}

void add_columns(const std::vector<FieldTable>& fields, const std::string& prefix, std::size_t place, bool& moves,
                 bool may_lack, std::vector<Column>& out) {
  for (const FieldTable& field : fields) {
    if (is_flattened(field)) {
      const bool is_counted = field.repeat == Repeat::listed;
      moves = moves || is_counted;
      for (std::size_t i = 0; i < elements_of(field); ++i) {
        const std::string index = field.repeat == Repeat::once ? "" : "[" + std::to_string(i) + "]";
        add_columns(field.fields, prefix + field.name + index + ".", place + field.at + i * field.stride, moves,
                    may_lack || is_counted, out);
      }
      continue;
    }
    out.push_back({prefix + field.name, &field, place + field.at, moves, may_lack, {}, {}, {}});
    if (holds_objects(field)) out.back().objects = nb::list();
    moves = moves || field.is_variable;
  }
}

/// Skip the columns of an element that this row lacks.
void skip_columns(const std::vector<FieldTable>& fields, std::vector<Column>& columns, std::size_t& next) {
  for (const FieldTable& field : fields) {
    if (is_flattened(field)) {
      for (std::size_t i = 0; i < elements_of(field); ++i) skip_columns(field.fields, columns, next);
      continue;
    }
    Column& column = columns[next++];
    column.places.push_back(nullptr);
    if (field.digits) column.numbers.push_back(std::nan(""));
    if (column.objects.is_valid()) nb::borrow<nb::list>(column.objects).append(nb::none());
  }
}

/// Return the value of an integer or a float.
double value_of(const FieldTable& field, std::uint64_t raw) {
  const double wire =
      field.kind == FieldKind::floating ? float_of(field, raw) : whole_as_double(field, whole_of(field, raw));
  return field.scaled ? to_si(field, wire) : wire;
}

double number_of(const FieldTable& field, const Spelled& spelled) {
  return spelled.raw ? value_of(field, *spelled.raw) : std::nan("");
}

/// Read one row's values of the columns with objects, and places of those that move. `next` counts the columns.
void read_row(const std::vector<FieldTable>& fields, std::size_t place, Walk& walk, std::vector<Column>& columns,
              std::size_t& next) {
  Counts counts;
  for (const FieldTable& field : fields) {
    const std::size_t here = place + field.at;
    if (field.counts) counts.tell(field, walk.at(here));  // one of its bits may count, too
    if (is_flattened(field)) {
      const auto read = [&](std::size_t, std::size_t at) { read_row(field.fields, at, walk, columns, next); };
      std::size_t found = 0;
      if (field.repeat == Repeat::listed) {
        found = walk.elements(field, here, counts.promised(field), read);
      } else {
        for (; found < elements_of(field); ++found) read(found, here + found * field.stride);
      }
      for (; found < elements_of(field); ++found) skip_columns(field.fields, columns, next);
      continue;
    }
    Column& column = columns[next++];
    if (column.moves) column.places.push_back(walk.at(here));
    if (field.digits) column.numbers.push_back(number_of(field, read_characters(field, here, walk)));
    if (!column.objects.is_valid()) continue;
    const std::uint64_t promised = field.is_variable ? counts.promised(field) : 0;
    nb::borrow<nb::list>(column.objects).append(decode_field<PythonValues>(field, here, promised, walk));
  }
}

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

/// Call `each_row` with the function that loads element `index` of the field at `at`: one loop for each way to load, so
/// that no loop decides for every element.
template <class EachRow>
void with_load(const FieldTable& field, EachRow each_row) {
  const auto whole = [&](auto bytes) {
    constexpr unsigned size = decltype(bytes)::value;
    if (field.order == ByteOrder::little) {
      each_row(
          [](const std::uint8_t* at, std::size_t i) { return load_bytes<size, ByteOrder::little>(at + i * size); });
    } else {
      each_row([](const std::uint8_t* at, std::size_t i) { return load_bytes<size, ByteOrder::big>(at + i * size); });
    }
  };
  const bool is_whole = field.repeat != Repeat::packed && field.width == 8 * field.size && field.pieces.empty();
  if (field.repeat == Repeat::packed) {
    each_row([&](const std::uint8_t* at, std::size_t i) { return load_packed_raw(field, at, i); });
  } else if (is_whole && field.size == 1) {
    whole(std::integral_constant<unsigned, 1>{});
  } else if (is_whole && field.size == 2) {
    whole(std::integral_constant<unsigned, 2>{});
  } else if (is_whole && field.size == 4) {
    whole(std::integral_constant<unsigned, 4>{});
  } else if (is_whole && field.size == 8) {
    whole(std::integral_constant<unsigned, 8>{});
  } else {
    each_row([&](const std::uint8_t* at, std::size_t i) { return load_plain_raw(field, at, i); });
  }
}

/// Check whether an element's bytes on the wire are as numpy needs them.
template <class T>
bool stands_as(const FieldTable& field) {
#if defined(__BYTE_ORDER__) && __BYTE_ORDER__ == __ORDER_LITTLE_ENDIAN__
  return field.kind != FieldKind::boolean && field.repeat != Repeat::packed && field.size == sizeof(T) &&
         field.width == 8 * sizeof(T) && (field.order == ByteOrder::little || sizeof(T) == 1) && !field.scaled &&
         field.pieces.empty() && field.coding == Coding::binary;
#else
  static_cast<void>(field);
  return false;
#endif
}

/// Make a column. `value` converts a number's bits to an element.
template <class T, class Value>
nb::object column_of(const Column& column, const Rows& rows, std::size_t stride, Value value) {
  const FieldTable& field = *column.field;
  const std::size_t count = rows.offsets.size();
  const std::size_t elements = field.count;
  T* const values = new T[count * elements];  // each is written below
  const nb::capsule owner(values, [](void* p) noexcept { delete[] static_cast<T*>(p); });
  const auto each_place = [&](auto take) {
    T* out = values;
    const std::uint8_t* row = rows.payloads.data() + column.at;
    for (std::size_t i = 0; i < count; ++i, row += stride, out += elements) {
      take(out, column.moves ? column.places[i] : row);
    }
  };
  if (stands_as<T>(field)) {
    if (elements == 1) {
      each_place([](T* out, const std::uint8_t* at) { std::memcpy(out, at, sizeof(T)); });
    } else {
      each_place([&](T* out, const std::uint8_t* at) { std::memcpy(out, at, elements * sizeof(T)); });
    }
  } else {
    with_load(field, [&](auto load) {
      each_place([&](T* out, const std::uint8_t* at) {
        for (std::size_t i = 0; i < elements; ++i) out[i] = static_cast<T>(value(load(at, i)));
      });
    });
  }
  return array_over(values, count, &field, owner);
}

/// Make a column of numbers that a row may lack: floats, NaN for such a row.
nb::object lacking_column(const Column& column) {
  const FieldTable& field = *column.field;
  const std::size_t elements = field.count;
  std::vector<double> values(column.places.size() * elements, std::nan(""));
  with_load(field, [&](auto load) {
    for (std::size_t row = 0; row < column.places.size(); ++row) {
      const std::uint8_t* const at = column.places[row];
      for (std::size_t i = 0; at != nullptr && i < elements; ++i)
        values[row * elements + i] = value_of(field, load(at, i));
    }
  });
  auto* const owned = new std::vector<double>(std::move(values));
  const nb::capsule owner(owned, [](void* p) noexcept { delete static_cast<std::vector<double>*>(p); });
  return array_over(owned->data(), column.places.size(), &field, owner);
}

nb::object number_column(Column& column, const Rows& rows, std::size_t stride) {
  if (column.field->digits) return make_array(std::move(column.numbers));
  if (column.may_lack) return lacking_column(column);
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

nb::dict columns_of(const MessageTable& message, const Rows& rows) {
  std::vector<Column> columns;
  bool moves = false;
  add_columns(message.fields, "", 0, moves, false, columns);
  const bool varies = message.max_payload != message.min_payload;
  bool walks = false;
  for (const Column& column : columns)
    walks = walks || column.moves || column.objects.is_valid() || column.field->digits;
  for (std::size_t i = 0; walks && i < rows.offsets.size(); ++i) {
    const std::size_t begin = varies ? rows.begin_of(i) : i * message.min_payload;
    const std::size_t size = varies ? rows.ends[i] - begin : message.min_payload;
    Walk walk{rows.payloads.data() + begin, size - message.min_payload};
    std::size_t next = 0;
    read_row(message.fields, 0, walk, columns, next);
  }
  if (varies) {  // then rows have no stride: every column uses places
    for (Column& column : columns) {
      for (std::size_t i = 0; !column.moves && i < rows.offsets.size(); ++i) {
        column.places.push_back(rows.payloads.data() + rows.begin_of(i) + column.at);
      }
      column.moves = true;
    }
  }
  nb::dict out;
  for (Column& column : columns) {
    out[column.name.c_str()] =
        column.objects.is_valid() ? column.objects : number_column(column, rows, message.min_payload);
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

}  // namespace

TimingMarks read_marks(const nb::dict& reads) {
  TimingMarks marks;
  for (nb::handle index : nb::list(reads["breaks"])) marks.breaks.push_back(nb::cast<std::size_t>(index));
  for (nb::handle one : nb::list(reads["expected"])) {
    marks.expected.emplace_back(nb::cast<std::size_t>(one[0]), nb::cast<std::int16_t>(one[1]));
  }
  return marks;
}

void check_reads(const std::uint64_t* ends, std::size_t count, std::size_t size) {
  std::uint64_t last = 0;
  for (std::size_t i = 0; i < count; ++i) {
    if (ends[i] < last || ends[i] > size) throw std::invalid_argument("the reads do not fit");
    last = ends[i];
  }
}

nb::dict message_tables(const ProtocolTable& protocol, const FormatTable& format, Capture&& capture, bool with_empty) {
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

nb::dict decode_columns(const std::shared_ptr<const ProtocolTable>& protocol,
                        const std::shared_ptr<const FormatTable>& format, nb::handle bytes, unsigned threads,
                        nb::handle progress) {
  const BufferView view(bytes);
  const auto work = [&](std::atomic<std::uint64_t>& done, const std::atomic<bool>& cancelled) {
    return decode_capture(*protocol, *format, view.data(), view.size(), threads, done, cancelled);
  };
  return tables_of(protocol, format, decode(work, view.size(), progress), view.size());
}

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

}  // namespace wirebond::engine
