// Converts payload bytes to Python values and back, independent of their frame.
// One file: for each kind of value, the way in and the way out.
#include "fields.hpp"

#include <nanobind/stl/string.h>

#include <algorithm>
#include <cstdio>
#include <cstring>
#include <optional>
#include <string>
#include <string_view>

#include "characters.hpp"

namespace wirebond::engine {

namespace {

// ---- decoding -----------------------------------------------------------------------------------------------------

nb::dict decode_all(const std::vector<FieldTable>& fields, std::size_t place, Walk& walk);

nb::object decode_string(const FieldTable& field, std::size_t place, std::uint64_t promised, Walk& walk) {
  const char* const at = reinterpret_cast<const char*>(walk.at(place));
  const bool is_fixed = field.count != 0;
  std::size_t size = is_fixed ? field.count : walk.string_size(field, place, promised);
  // If another byte is in the place of the one that ends it, that byte is the string's last.
  if (field.ends_with >= 0 && at[size] != static_cast<char>(field.ends_with)) ++size;
  if (field.kind == FieldKind::bytes) return steal(PyBytes_FromStringAndSize(at, static_cast<Py_ssize_t>(size)));
  if (is_fixed) {  // padded with zeros
    const void* const end = std::memchr(at, 0, size);
    if (end != nullptr) size = static_cast<std::size_t>(static_cast<const char*>(end) - at);
  }
  return steal(PyUnicode_DecodeUTF8(at, static_cast<Py_ssize_t>(size), "replace"));
}

nb::object decode_characters(const FieldTable& field, std::size_t place, Walk& walk) {
  const Spelled found = read_characters(field, place, walk);
  return found.raw ? decode_element(field, *found.raw) : nb::none();
}

nb::object decode_one(const FieldTable& field, std::size_t place, Walk& walk) {
  if (field.kind == FieldKind::structure) return decode_all(field.fields, place, walk);
  return decode_element(field, load_raw(field, walk.at(place), 0));
}

nb::object decode_fixed(const FieldTable& field, std::size_t place, Walk& walk) {
  nb::object out = steal(PyList_New(static_cast<Py_ssize_t>(field.count)));
  for (std::uint32_t i = 0; i < field.count; ++i) {
    nb::object element = field.kind == FieldKind::structure
                             ? nb::object(decode_all(field.fields, place + i * field.stride, walk))
                             : decode_element(field, load_raw(field, walk.at(place), i));
    PyList_SET_ITEM(out.ptr(), static_cast<Py_ssize_t>(i), element.release().ptr());
  }
  return out;
}

nb::dict decode_all(const std::vector<FieldTable>& fields, std::size_t place, Walk& walk) {
  nb::dict out;
  Counts counts;
  for (const FieldTable& field : fields) {
    const std::size_t here = place + field.at;
    if (field.counts) counts.tell(field, walk.at(here));
    const std::uint64_t promised = field.is_variable ? counts.promised(field) : 0;
    const nb::object value = decode_field(field, here, promised, walk);
    if (PyDict_SetItem(out.ptr(), field.key.ptr(), value.ptr()) != 0) throw nb::python_error();
  }
  return out;
}

// ---- field rules --------------------------------------------------------------------------------------------------

void validate_all(const std::vector<FieldTable>& fields, std::size_t place, Walk& walk, const Path& path,
                  nb::list& out);

void add(nb::list& out, const Path& path, const std::string& fault) {
  const std::string text = path.text() + fault;
  if (!fault.empty()) out.append(nb::str(text.data(), text.size()));
}

/// Return the unit of a count.
std::string unit_of(const FieldTable& field, const Counter& counter) {
  return field.is_string() || counter.step > 1 ? " bytes" : " elements";
}

/// Check a list or string for which the payload promises more than it has, or more than the protocol allows.
void validate_promises(const FieldTable& field, const Counts& counts, std::size_t found, const Path& path,
                       nb::list& out) {
  for (const Counter& counter : field.counters) {
    const std::uint64_t told = counts.told(counter);
    const std::uint64_t step = counter.step;
    if (told == found * step) continue;
    const std::string limit = told % step != 0 ? "has " + std::to_string(step) + " for each element"
                              : told / step > field.max_count
                                  ? "has at most " + std::to_string(field.max_count * step)
                                  : "has " + std::to_string(found * step) + " in this payload";
    const Path counting{path.parent, counter.name};
    out.append(nb::str((counting.text() + " tells " + std::to_string(told) + unit_of(field, counter) + ", and " +
                        path.text() + " " + limit)
                           .c_str()));
  }
}

/// Report a string without the byte that ends it. `most`: bytes among which it may come.
void add_missing_end(const FieldTable& field, std::size_t most, const Path& path, nb::list& out) {
  char end[8];
  std::snprintf(end, sizeof end, "0x%02X", static_cast<unsigned>(field.ends_with) & 0xFFu);
  add(out, path,
      std::string(" does not end with ") + end + " within " + std::to_string(most + 1) +
          (most == 0 ? " byte" : " bytes"));
}

void validate_string(const FieldTable& field, std::size_t place, const Counts& counts, Walk& walk, const Path& path,
                     nb::list& out) {
  const char* const at = reinterpret_cast<const char*>(walk.at(place));
  const std::size_t most = std::min<std::size_t>(walk.spare, field.max_count);
  const std::size_t size = field.count != 0 ? field.count : walk.string_size(field, place, counts.promised(field));
  validate_promises(field, counts, size, path, out);
  if (field.ends_with >= 0 && at[size] != static_cast<char>(field.ends_with)) add_missing_end(field, most, path, out);
  if (field.kind == FieldKind::bytes) return;
  const nb::object text = nb::steal(PyUnicode_DecodeUTF8(at, static_cast<Py_ssize_t>(size), nullptr));
  if (text.is_valid()) return;
  PyErr_Clear();
  add(out, path, " is not UTF-8");
}

void validate_characters(const FieldTable& field, std::size_t place, Walk& walk, const Path& path, nb::list& out) {
  const std::size_t most = std::min<std::size_t>(walk.spare, field.max_count);
  const Spelled found = read_characters(field, place, walk);
  if (!found.is_ended) {
    add_missing_end(field, most, path, out);
  } else if (!found.raw) {
    const nb::object text = steal(
        PyUnicode_DecodeLatin1(reinterpret_cast<const char*>(found.at), static_cast<Py_ssize_t>(found.size), nullptr));
    add(out, path,
        " is " + shown(text) + ", which is no " + std::to_string(field.width) + "-bit number in " +
            (field.digits->base == 16 ? "hex" : "decimal") + " digits");
  } else {
    add(out, path, fault_of(field, *found.raw));
  }
}

void validate_element(const FieldTable& field, std::size_t place, std::size_t index, Walk& walk, const Path& path,
                      nb::list& out) {
  if (field.kind == FieldKind::structure) {
    validate_all(field.fields, place + index * field.stride, walk, path, out);
  } else {
    add(out, path, fault_of(field, load_raw(field, walk.at(place), index)));
  }
}

void validate_all(const std::vector<FieldTable>& fields, std::size_t place, Walk& walk, const Path& path,
                  nb::list& out) {
  Counts counts;
  for (const FieldTable& field : fields) {
    const std::size_t here = place + field.at;
    if (field.counts) counts.tell(field, walk.at(here));
    const std::uint64_t promised = field.is_variable ? counts.promised(field) : 0;
    const Path own{&path, field.name};
    if (field.digits) {
      validate_characters(field, here, walk, own, out);
    } else if (field.is_string()) {
      validate_string(field, here, counts, walk, own, out);
    } else if (field.repeat == Repeat::listed) {
      const std::size_t found = walk.elements(field, here, promised, [&](std::size_t i, std::size_t at) {
        const Path element{&path, field.name, static_cast<std::ptrdiff_t>(i)};
        validate_element(field, at, 0, walk, element, out);
      });
      validate_promises(field, counts, found, own, out);
    } else if (field.repeat == Repeat::once) {
      validate_element(field, here, 0, walk, own, out);
    } else {
      for (std::uint32_t i = 0; i < field.count; ++i) {
        const Path element{&path, field.name, static_cast<std::ptrdiff_t>(i)};
        validate_element(field, here, i, walk, element, out);
      }
    }
  }
}

// ---- encoding -----------------------------------------------------------------------------------------------------

/// A payload that grows where varying fields need bytes. Bytes that no field has written are zero.
struct Build {
  std::vector<std::uint8_t> payload;
  std::size_t shift = 0;
  std::vector<std::size_t> shifts{};  ///< after each count of a field of varying size outside any repetition
  unsigned repetitions = 0;           ///< how many surround the field being written, each with its own size

  std::uint8_t* at(std::size_t place) { return payload.data() + place + shift; }
  void note_shift(const FieldTable& field) {  // for each of its counts, in the order of the rules over a payload
    if (repetitions == 0) shifts.insert(shifts.end(), std::max<std::size_t>(field.counters.size(), 1), shift);
  }
  void insert(std::size_t place, std::size_t size) {
    payload.insert(payload.begin() + static_cast<std::ptrdiff_t>(place + shift), size, 0);
  }
};

/// A field that counts elements or bytes of others: with the caller's number, or theirs.
struct Count {
  const FieldTable* field = nullptr;
  std::size_t at = 0;  ///< in the payload
  bool is_given = false;
  std::optional<std::uint64_t> number;
};

/// `outer`: counters in the surrounding list of fields, if these are bits; otherwise null.
void encode_all(const std::vector<FieldTable>& fields, std::size_t place, nb::handle values, const Path& path,
                Build& build, std::vector<Count>* outer = nullptr);

/// Reconcile the number of `field`'s elements or bytes with the fields that count them.
void count_in(const FieldTable& field, std::vector<Count>& counts, std::size_t found, const Path& path, Build& build) {
  for (const Counter& counter : field.counters) {
    Count& count = counts[counter.slot];
    const std::uint64_t tells = found * counter.step;
    if (!count.number) {
      count.number = tells;
      store_raw(*count.field, build.payload.data() + count.at, 0, tells);
    }
    if (*count.number == tells) continue;
    const Path counting{path.parent, counter.name};
    throw_message_error(counting.text() + " is " + std::to_string(*count.number) + ", and " + path.text() +
                        ", which it counts, has " + std::to_string(tells) + unit_of(field, counter) +
                        (count.is_given ? "; leave " + counter.name + " out, it is counted" : ""));
  }
}

/// Return `0x0D 0x0A`, as in a protocol file.
std::string hex_text(const std::string& bytes) {
  std::string text;
  for (const char byte : bytes) {
    char one[6];
    std::snprintf(one, sizeof one, "0x%02X", static_cast<unsigned>(static_cast<unsigned char>(byte)));
    text += (text.empty() ? "" : " ") + std::string(one);
  }
  return text;
}

/// Return the bytes of a string, after checking its size.
nb::object string_bytes(const FieldTable& field, nb::handle value, const Path& path) {
  nb::object bytes;
  if (field.kind == FieldKind::text) {
    if (!PyUnicode_Check(value.ptr())) wrong_type(path, value, "text");
    bytes = nb::steal(PyUnicode_AsUTF8String(value.ptr()));
    if (!bytes.is_valid()) {
      PyErr_Clear();
      wrong_type(path, value, "text that UTF-8 can hold");
    }
  } else {
    if (!PyBytes_Check(value.ptr()) && !PyByteArray_Check(value.ptr())) wrong_type(path, value, "bytes");
    bytes = steal(PyBytes_FromObject(value.ptr()));
  }
  const auto size = static_cast<std::size_t>(PyBytes_GET_SIZE(bytes.ptr()));
  const std::size_t most = field.count != 0 ? field.count : field.max_count;
  if (size > most) {
    throw_message_error(path.text() + " has " + std::to_string(size) + " bytes; it holds at most " +
                        std::to_string(most));
  }
  const std::string_view data(PyBytes_AS_STRING(bytes.ptr()), size);
  const bool is_padded = field.kind == FieldKind::text && field.count != 0;
  if (field.ends_with >= 0 || is_padded) {
    const std::size_t end = data.find(static_cast<char>(is_padded ? 0 : field.ends_with));
    if (end != std::string_view::npos) {
      throw_message_error(path.text() + " would end at its byte " + std::to_string(end) +
                          (is_padded ? ", a zero, with which shorter texts are padded; leave that out"
                                     : ", which is the one that ends it on the wire; leave that out"));
    }
  }
  for (const std::string& mark : field.excludes) {
    const std::size_t at = data.find(mark);
    if (at != std::string_view::npos) {
      throw_message_error(path.text() + " has at its byte " + std::to_string(at) + " what " +
                          "ends or begins a frame on the wire (" + hex_text(mark) + "); leave that out");
    }
  }
  return bytes;
}

/// Encode a number in characters at its place.
void encode_characters(const FieldTable& field, std::size_t place, nb::handle value, const Path& path, Build& build) {
  const auto number = magnitude_of_raw(field, encode_element(field, value, path));
  const std::size_t size = field.count != 0 ? field.count : wirebond::detail::size_of_magnitude(*field.digits, number);
  if (field.count == 0) build.insert(place, size);
  wirebond::detail::write_magnitude(*field.digits, build.at(place), size, number);
  if (field.count != 0) return;
  build.shift += size;
  build.note_shift(field);
  if (field.ends_with >= 0) *build.at(place) = static_cast<std::uint8_t>(field.ends_with);
}

/// Return the size of a sequence, after checking it.
std::size_t sequence_size(const FieldTable& field, nb::handle value, const Path& path) {
  const bool is_list = field.repeat == Repeat::listed;
  const std::string wanted = is_list ? "at most " + std::to_string(field.max_count) : std::to_string(field.count);
  if (PyUnicode_Check(value.ptr()) || PyDict_Check(value.ptr()) || PySequence_Check(value.ptr()) == 0) {
    wrong_type(path, value, "a list of " + wanted);
  }
  const Py_ssize_t size = PySequence_Size(value.ptr());
  if (size < 0) throw nb::python_error();  // raised by the value's own __len__: passed to the caller
  if (is_list ? size > static_cast<Py_ssize_t>(field.max_count) : size != static_cast<Py_ssize_t>(field.count)) {
    throw_message_error(path.text() + " has " + std::to_string(size) + " elements; expected " + wanted);
  }
  return static_cast<std::size_t>(size);
}

nb::object item(nb::handle sequence, std::size_t index) {
  return steal(PySequence_GetItem(sequence.ptr(), static_cast<Py_ssize_t>(index)));
}

/// Encode a repeated field. None means a missing value: a fixed number of structures takes its fields' defaults.
std::size_t encode_elements(const FieldTable& field, std::size_t place, nb::handle value, const Path& path,
                            Build& build) {
  const bool is_list = field.repeat == Repeat::listed;
  const std::size_t size = value.is_none() ? field.count : sequence_size(field, value, path);
  if (is_list) build.insert(place, size * field.stride);
  if (is_list) build.repetitions += 1;
  for (std::size_t i = 0; i < size; ++i) {
    if (field.kind != FieldKind::structure) {
      store_raw(field, build.at(place), i, encode_element(field, item(value, i), path));
      continue;
    }
    const Path element{path.parent, path.name, static_cast<std::ptrdiff_t>(i)};
    const nb::object one = value.is_none() ? nb::object(nb::dict()) : item(value, i);
    encode_all(field.fields, place + i * field.stride, one, element, build);
  }
  if (is_list) {
    build.repetitions -= 1;
    build.shift += size * field.stride;
    build.note_shift(field);
  }
  return size;
}

/// Return the default for a missing value; none if the caller must give one.
nb::object stand_in(const FieldTable& field) {
  if (field.has_default) return field.default_value;
  if (field.kind == FieldKind::text) return nb::str("");
  if (field.kind == FieldKind::bytes) return nb::bytes("", 0);
  if (field.kind == FieldKind::structure && field.repeat == Repeat::once) return nb::dict();
  return nb::none();
}

/// May nobody give it a value? Of structures that are always there each field takes its own default.
bool may_be_left_out(const FieldTable& field) {
  if (field.has_default || field.is_string() || field.slot >= 0) return true;
  if (field.kind != FieldKind::structure || field.repeat == Repeat::listed) return false;
  return std::all_of(field.fields.begin(), field.fields.end(), may_be_left_out);
}

std::string names_of(const std::vector<FieldTable>& fields) {
  std::string names;
  for (const FieldTable& field : fields) names += (names.empty() ? "" : ", ") + field.name;
  return names;
}

void refuse_unknown(const std::vector<FieldTable>& fields, nb::dict values, const Path& path) {
  for (auto [key, value] : values) {
    bool found = false;
    for (const FieldTable& field : fields) found = found || field.key.equal(key);
    if (found) continue;
    throw_message_error(path.text() + " has no field " + shown(key) +
                        (fields.empty() ? "; it has no fields" : "; it has " + names_of(fields)));
  }
}

void encode_all(const std::vector<FieldTable>& fields, std::size_t place, nb::handle values, const Path& path,
                Build& build, std::vector<Count>* outer) {
  if (!PyDict_Check(values.ptr())) wrong_type(path, values, "a dict of " + names_of(fields));
  std::vector<Count> own_counts;
  std::vector<Count>& counts = outer != nullptr ? *outer : own_counts;
  Py_ssize_t used = 0;
  for (const FieldTable& field : fields) {
    const std::size_t here = place + field.at;
    const Path own{&path, field.name};
    nb::object value = nb::borrow(PyDict_GetItemWithError(values.ptr(), field.key.ptr()));
    const bool is_given = value.is_valid();
    if (!is_given && PyErr_Occurred() != nullptr) throw nb::python_error();
    used += is_given ? 1 : 0;
    if (field.slot >= 0) {
      const auto slot = static_cast<std::size_t>(field.slot);
      if (counts.size() <= slot) counts.resize(slot + 1);
      Count& count = counts[slot];
      count.field = &field;
      count.at = here + build.shift;
      count.is_given = is_given;
      if (!is_given) continue;  // it gets the size of what it counts
      count.number = encode_element(field, value, own);
    }
    if (!is_given) {
      value = stand_in(field);
      if (value.is_none() && !may_be_left_out(field)) {
        refuse_unknown(fields, nb::borrow<nb::dict>(values), path);  // a misspelt name explains the gap
        throw_message_error(path.text() + " needs " + field.name + ", which has no default");
      }
    }
    if (field.digits) {
      encode_characters(field, here, value, own, build);
    } else if (field.is_string()) {
      const nb::object bytes = string_bytes(field, value, own);
      const auto size = static_cast<std::size_t>(PyBytes_GET_SIZE(bytes.ptr()));
      if (field.count == 0) build.insert(here, size);
      if (size != 0) std::memcpy(build.at(here), PyBytes_AS_STRING(bytes.ptr()), size);
      if (field.count == 0) {
        build.shift += size;
        build.note_shift(field);
      }
      if (field.ends_with >= 0) *build.at(here) = static_cast<std::uint8_t>(field.ends_with);
      count_in(field, counts, size, own, build);
    } else if (field.repeat != Repeat::once) {
      if (is_given && value.is_none()) sequence_size(field, value, own);  // throws
      count_in(field, counts, encode_elements(field, here, value, own, build), own, build);
    } else if (field.kind == FieldKind::structure) {
      encode_all(field.fields, here, value, own, build, field.counts ? &counts : nullptr);
    } else {
      store_raw(field, build.at(here), 0, encode_element(field, value, own));
    }
  }
  if (used != PyDict_Size(values.ptr())) refuse_unknown(fields, nb::borrow<nb::dict>(values), path);
}

}  // namespace

nb::object decode_field(const FieldTable& field, std::size_t place, std::uint64_t promised, Walk& walk) {
  if (field.digits) return decode_characters(field, place, walk);
  if (field.is_string()) return decode_string(field, place, promised, walk);
  if (field.repeat == Repeat::once) return decode_one(field, place, walk);
  if (field.repeat != Repeat::listed) return decode_fixed(field, place, walk);
  nb::list out;
  walk.elements(field, place, promised, [&](std::size_t, std::size_t at) { out.append(decode_one(field, at, walk)); });
  return out;
}

nb::dict decode_fields(const MessageTable& message, const std::uint8_t* payload, std::size_t size) {
  Walk walk{payload, size - message.min_payload};
  return decode_all(message.fields, 0, walk);
}

nb::list find_violations(const MessageTable& message, const std::uint8_t* payload, std::size_t size) {
  nb::list out;
  Walk walk{payload, size - message.min_payload};
  validate_all(message.fields, 0, walk, Path{nullptr, message.name}, out);
  return out;
}

std::vector<std::uint8_t> encode_fields(const MessageTable& message, nb::dict values) {
  Build build{std::vector<std::uint8_t>(message.min_payload, 0)};
  encode_all(message.fields, 0, values, Path{nullptr, message.name}, build);
  for (const PayloadConstant& constant : message.constants) {
    const std::size_t shift = constant.behind == 0 ? 0 : build.shifts[constant.behind - 1u];
    build.payload[constant.at + shift] |= constant.value;
  }
  return std::move(build.payload);
}

}  // namespace wirebond::engine
