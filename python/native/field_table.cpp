// Reads the steps of a layout. The loader has validated their fields: a surprise here is our own mistake.
#include "field_table.hpp"

#include <nanobind/stl/string.h>

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

void read_coding(FieldTable& table, nb::handle field) {
  const nb::object coding = field.attr("coding");
  table.coding = meant_by(codings, coding.attr("cpp"), "coding");
  table.is_signed = nb::cast<bool>(coding.attr("is_signed"));
  const nb::object limits = field.attr("whole_limits");
  table.least = nb::cast<std::int64_t>(nb::object(limits[0]));
  table.greatest = nb::cast<std::uint64_t>(nb::object(limits[1]));
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
    const nb::object accepted = field.attr("accepted_limits");
    table.accepted_least = as_double(nb::object(accepted[0]));
    table.accepted_most = as_double(nb::object(accepted[1]));
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

/// Read what a field means, and how one number of it lies in bytes; not how often it occurs.
FieldTable read_field(nb::handle field) {
  FieldTable table;
  table.name = text_of(field.attr("name"));
  table.key = interned(table.name);
  table.kind = meant_by(kinds, field.attr("kind"), "field kind");
  table.order = byte_order_of(field.attr("order"));
  table.is_variable = nb::cast<bool>(field.attr("is_variable"));
  if (table.kind == FieldKind::integer) read_coding(table, field);
  read_meaning(table, field);
  const nb::object digits = field.attr("digits");
  if (!digits.is_none()) {
    table.digits = Digits{nb::cast<std::uint8_t>(digits.attr("base")), nb::cast<std::uint8_t>(digits.attr("decimals"))};
  }
  if (table.kind != FieldKind::structure && !table.is_string()) {
    table.size = table.digits ? std::uint8_t{1} : nb::cast<std::uint8_t>(field.attr("size"));
    table.width = nb::cast<std::uint8_t>(field.attr("width"));
  }
  return table;
}

void read_slot(FieldTable& table, nb::handle part) {
  const nb::object slot = part.attr("slot");
  if (slot.is_none()) return;
  table.slot = nb::cast<int>(slot);
  table.counts = true;
}

void read_told(FieldTable& table, nb::handle step) {
  for (nb::handle told : step.attr("told")) {
    table.counters.push_back({nb::cast<std::size_t>(told.attr("slot")), nb::cast<std::uint64_t>(told.attr("per")),
                              text_of(told.attr("name"))});
  }
}

void read_characters(FieldTable& table, nb::handle step) {  // one value of this many bytes
  const nb::object field = step.attr("field");
  table.count = nb::cast<std::uint32_t>(field.attr("size"));
  table.max_count = nb::cast<std::uint32_t>(field.attr("max_size"));
  table.stride = 1;
  const nb::object end = field.attr("ends_with");
  if (!end.is_none()) table.ends_with = nb::cast<int>(end);
  for (nb::handle mark : field.attr("excludes")) {
    const auto bytes = nb::cast<nb::bytes>(mark);
    table.excludes.emplace_back(bytes.c_str(), bytes.size());
  }
  read_told(table, step);
}

/// Read the values that share a number's bits.
void read_members(FieldTable& container, nb::handle step) {
  const auto size = nb::cast<std::uint8_t>(step.attr("field").attr("size"));
  for (nb::handle member : step.attr("members")) {
    const nb::object field = member.attr("field");
    if (!nb::cast<bool>(field.attr("has_value"))) continue;
    FieldTable table = read_field(field);
    table.size = size;
    table.order = container.order;
    table.shift = nb::cast<std::uint8_t>(member.attr("low"));
    const auto pieces = nb::cast<nb::tuple>(member.attr("pieces"));
    for (std::size_t i = 0; pieces.size() > 1 && i < pieces.size(); ++i) {
      const nb::object piece = pieces[i];
      table.pieces.emplace_back(nb::cast<std::uint8_t>(piece[0]), nb::cast<std::uint8_t>(piece[1]));
    }
    read_slot(table, member);
    container.counts = container.counts || table.counts;
    container.fields.push_back(std::move(table));
  }
}

void read_times(FieldTable& table, nb::handle step) {
  const nb::object field = step.attr("field");
  const nb::object count = field.attr("count");
  if (count.is_none()) return;
  const nb::object packed = field.attr("packed");
  table.repeat = packed.is_none() ? Repeat::fixed : Repeat::packed;
  table.count = nb::cast<std::uint32_t>(count);
  if (!packed.is_none()) table.bit_order = bit_order_of(packed);
}

enum class StepKind : std::uint8_t { number, array, bits, characters, group, list };

constexpr std::pair<const char*, StepKind> step_kinds[] = {
    {"Number", StepKind::number},         {"Array", StepKind::array}, {"Bits", StepKind::bits},
    {"Characters", StepKind::characters}, {"Group", StepKind::group}, {"List", StepKind::list},
};

FieldTable read_step(nb::handle step) {
  const nb::object field = step.attr("field");
  FieldTable table = read_field(field);
  table.at = nb::cast<std::size_t>(step.attr("at"));
  table.stride = nb::cast<std::size_t>(field.attr("element_min_bytes"));
  switch (meant_by(step_kinds, step.attr("__class__").attr("__name__"), "step")) {
    case StepKind::number: read_slot(table, step); break;
    case StepKind::array: read_times(table, step); break;
    case StepKind::bits: read_members(table, step); break;
    case StepKind::characters: read_characters(table, step); break;
    case StepKind::group:
      read_times(table, step);
      table.fields = read_steps(step.attr("steps"));
      break;
    case StepKind::list:
      table.repeat = Repeat::listed;
      table.max_count = nb::cast<std::uint32_t>(field.attr("max_count"));
      table.fields = read_steps(step.attr("steps"));
      read_told(table, step);
      break;
  }
  return table;
}

}  // namespace

std::vector<FieldTable> read_steps(nb::handle steps) {
  std::vector<FieldTable> out;
  for (nb::handle step : steps) {
    if (nb::cast<bool>(step.attr("field").attr("has_value"))) out.push_back(read_step(step));
  }
  return out;
}

std::vector<FieldTable> read_numbers(nb::handle fields) {
  std::vector<FieldTable> out;
  for (nb::handle field : fields) out.push_back(read_field(field));
  return out;
}

}  // namespace wirebond::engine
