// Reads the model's fields. The loader has validated them: a surprise here is our own mistake.
#include "field_table.hpp"

#include <nanobind/stl/string.h>

#include <stdexcept>
#include <utility>

#include "words.hpp"

namespace wirebond::engine {

namespace {

nb::object interned(const std::string& text) { return nb::steal(PyUnicode_InternFromString(text.c_str())); }

double as_double(nb::handle value) {
  const double result = PyFloat_AsDouble(value.ptr());
  if (result == -1.0 && PyErr_Occurred() != nullptr) throw nb::python_error();
  return result;
}

constexpr std::pair<const char*, FieldKind> kinds[] = {
    {"integer", FieldKind::integer}, {"float", FieldKind::floating}, {"bool", FieldKind::boolean},
    {"text", FieldKind::text},       {"bytes", FieldKind::bytes},    {"struct", FieldKind::structure},
    {"bits", FieldKind::structure},
};

constexpr std::pair<const char*, Coding> codings[] = {
    {"binary", Coding::binary},
    {"sign_magnitude", Coding::sign_magnitude},
    {"bcd", Coding::bcd},
};

void read_repeat(FieldTable& table, nb::handle field) {
  const nb::object count = field.attr("count");
  table.max_count = nb::cast<std::uint32_t>(field.attr("max_count"));
  table.stride = nb::cast<std::size_t>(field.attr("element_min_bytes"));
  if (table.is_characters()) {  // one value of this many bytes
    table.count = nb::cast<std::uint32_t>(field.attr("size"));
    table.max_count = nb::cast<std::uint32_t>(field.attr("max_size"));
    table.stride = 1;
    const nb::object end = field.attr("ends_with");
    if (!end.is_none()) table.ends_with = nb::cast<int>(end);
    for (nb::handle mark : field.attr("excludes")) {
      const auto bytes = nb::cast<nb::bytes>(mark);
      table.excludes.emplace_back(bytes.c_str(), bytes.size());
    }
    return;
  }
  if (table.max_count != 0) {
    table.repeat = Repeat::listed;
  } else if (!count.is_none()) {
    const nb::object packed = field.attr("packed");
    table.repeat = packed.is_none() ? Repeat::fixed : Repeat::packed;
    table.count = nb::cast<std::uint32_t>(count);
    if (!packed.is_none()) table.bit_order = bit_order_of(packed);
  }
}

void read_meaning(FieldTable& table, nb::handle field) {
  table.scaled = nb::cast<bool>(field.attr("is_scaled"));
  if (table.scaled) {
    const nb::object factors = field.attr("double_factors");
    table.numerator = as_double(factors[0]);
    table.addend = as_double(factors[1]);
    table.denominator = as_double(factors[2]);
    table.offset = as_double(factors[3]);
  }
  table.unit = text_of(field.attr("unit"));
  const nb::object minimum = field.attr("minimum");
  if (!minimum.is_none()) {
    table.has_range = true;
    table.minimum = as_double(minimum);
    table.maximum = as_double(field.attr("maximum"));
    table.range_slack = as_double(field.attr("double_slack"));
  }
  table.default_value = field.attr("default");
  table.has_default = !table.default_value.is_none();
  for (nb::handle entry : field.attr("enum")) {
    const std::uint64_t bits = PyLong_AsUnsignedLongLongMask(nb::object(entry[1]).ptr());
    table.enumerators.emplace_back(interned(text_of(entry[0])), bits);
  }
  for (nb::handle entry : field.attr("flags")) {
    table.flags.emplace_back(interned(text_of(entry[0])), nb::cast<unsigned>(entry[1]));
  }
  table.has_enum = !table.enumerators.empty();
  table.has_flags = !table.flags.empty();
}

FieldTable read_field(nb::handle field, std::size_t at) {
  FieldTable table;
  table.name = text_of(field.attr("name"));
  table.key = interned(table.name);
  table.kind = meant_by(kinds, field.attr("kind"), "field kind");
  table.order = byte_order_of(field.attr("order"));
  table.at = at;
  table.is_variable = nb::cast<bool>(field.attr("is_variable"));
  const nb::object digits = field.attr("digits");
  if (!digits.is_none()) {
    table.digits = Digits{nb::cast<std::uint8_t>(digits.attr("base")), nb::cast<std::uint8_t>(digits.attr("decimals"))};
  }
  if (table.kind == FieldKind::integer) {
    const nb::object coding = field.attr("coding");
    table.coding = meant_by(codings, coding.attr("cpp"), "coding");
    table.is_signed = nb::cast<bool>(coding.attr("is_signed"));
  }
  read_repeat(table, field);
  read_meaning(table, field);
  if (table.kind == FieldKind::integer) {
    const nb::object limits = field.attr("whole_limits");
    table.least = nb::cast<std::int64_t>(nb::object(limits[0]));
    table.greatest = nb::cast<std::uint64_t>(nb::object(limits[1]));
  }
  if (table.kind != FieldKind::structure && !table.is_string()) {
    table.size = table.digits ? std::uint8_t{1} : nb::cast<std::uint8_t>(field.attr("size"));
    table.width = nb::cast<std::uint8_t>(field.attr("width"));
  }
  return table;
}

/// Read the fields that share a number's bits.
std::vector<FieldTable> read_bits(nb::handle container) {
  const auto size = nb::cast<std::uint8_t>(container.attr("size"));
  const ByteOrder order = byte_order_of(container.attr("order"));
  const bool from_low = bit_order_of(container.attr("first")) == BitOrder::low_first;
  std::vector<FieldTable> out;
  unsigned passed = 0;
  for (nb::handle field : container.attr("fields")) {
    const auto width = nb::cast<unsigned>(field.attr("bits_here"));
    const unsigned shift = from_low ? passed : 8u * size - passed - width;
    passed += width;
    if (text_of(field.attr("kind")) == "padding") continue;
    FieldTable table = read_field(field, 0);
    table.size = size;
    table.order = order;
    table.shift = static_cast<std::uint8_t>(shift);
    for (nb::handle piece : field.attr("split")) {
      table.pieces.emplace_back(nb::cast<std::uint8_t>(piece[0]), nb::cast<std::uint8_t>(piece[1]));
    }
    out.push_back(std::move(table));
  }
  return out;
}

}  // namespace

namespace {

/// Find the field of this name, or that among the bits of a field (`state.number`); null if there is none.
FieldTable* find_counter(std::vector<FieldTable>& fields, const std::string& name, FieldTable** outer) {
  for (FieldTable& field : fields) {
    *outer = &field;
    if (field.name == name) return &field;
    if (field.kind != FieldKind::structure || name.compare(0, field.name.size() + 1, field.name + ".") != 0) continue;
    for (FieldTable& run : field.fields) {
      if (name.compare(field.name.size() + 1, std::string::npos, run.name) == 0) return &run;
    }
  }
  return nullptr;
}

}  // namespace

std::vector<FieldTable> read_fields(nb::handle fields) {
  std::vector<FieldTable> out;
  std::size_t at = 0;
  int slots = 0;
  for (nb::handle field : fields) {
    const std::string kind = text_of(field.attr("kind"));
    if (kind != "padding") {
      FieldTable table = read_field(field, at);
      if (kind == "bits") table.fields = read_bits(field);
      if (kind == "struct") table.fields = read_fields(field.attr("fields"));
      for (nb::handle counter : field.attr("counters")) {
        const std::string name = text_of(counter[0]);
        FieldTable* outer = nullptr;
        FieldTable* const counting = find_counter(out, name, &outer);
        if (counting == nullptr) throw std::logic_error("no field " + name + " to count " + table.name);
        if (counting->slot < 0) counting->slot = slots++;
        outer->counts = true;
        table.counters.push_back({static_cast<std::size_t>(counting->slot), nb::cast<std::uint64_t>(counter[1]), name});
      }
      out.push_back(std::move(table));
    }
    at += nb::cast<std::size_t>(field.attr("min_wire_bytes"));
  }
  return out;
}

}  // namespace wirebond::engine
