// Reads the steps of a layout. The loader has validated their fields: a surprise here is our own mistake.
#include "wirebond/engine/field_table.hpp"

#include <utility>

#include "wirebond/engine/words.hpp"

namespace wirebond::engine {

namespace {

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

void read_coding(FieldTable& table, const Node& field) {
  table.coding = meant_by(codings, field["coding"], "coding");
  table.is_signed = field["is_signed"].as<bool>();
  table.least = field["least"].as<std::int64_t>();
  table.greatest = field["greatest"].as<std::uint64_t>();
}

void read_meaning(FieldTable& table, const Node& field) {
  const Node& factors = field["factors"];
  table.scaled = !factors.is_none();
  if (table.scaled) {
    table.numerator = factors[0].as<double>();
    table.addend = factors[1].as<double>();
    table.denominator = factors[2].as<double>();
    table.offset = factors[3].as<double>();
  }
  table.unit = field["unit"].text();
  const Node& range = field["range"];
  if (!range.is_none()) {
    table.has_range = true;
    table.minimum = range[0].as<double>();
    table.maximum = range[1].as<double>();
    table.range_slack = range[2].as<double>();
    table.accepted_least = range[3].as<double>();
    table.accepted_most = range[4].as<double>();
  }
  table.default_value = field["default"];
  table.has_default = !table.default_value.is_none();
  for (const Node& entry : field["enum"].list()) table.enumerators.emplace_back(entry[0].text(), entry[1].bits());
  for (const Node& entry : field["flags"].list()) table.flags.emplace_back(entry[0].text(), entry[1].as<unsigned>());
  table.has_enum = !table.enumerators.empty();
  table.has_flags = !table.flags.empty();
}

/// Read a field's type and the coding of one number of it; not how often it occurs.
FieldTable read_field(const Node& field) {
  FieldTable table;
  table.name = field["name"].text();
  table.kind = meant_by(kinds, field["kind"], "field kind");
  table.order = byte_order_of(field["order"]);
  table.is_variable = field["is_variable"].as<bool>();
  if (table.kind == FieldKind::integer) read_coding(table, field);
  read_meaning(table, field);
  const Node& digits = field["digits"];
  if (!digits.is_none()) table.digits = Digits{digits[0].as<std::uint8_t>(), digits[1].as<std::uint8_t>()};
  if (table.kind != FieldKind::structure && !table.is_string()) {
    table.size = table.digits ? std::uint8_t{1} : field["size"].as<std::uint8_t>();
    table.width = field["width"].as<std::uint8_t>();
  }
  return table;
}

void read_slot(FieldTable& table, const Node& part) {
  const Node& slot = part["slot"];
  if (slot.is_none()) return;
  table.slot = slot.as<int>();
  table.counts = true;
}

void read_told(FieldTable& table, const Node& step) {
  for (const Node& told : step["told"].list()) {
    table.counters.push_back({told["slot"].as<std::size_t>(), told["per"].as<std::uint64_t>(), told["name"].text()});
  }
}

void read_characters(FieldTable& table, const Node& step) {  // one value of this many bytes
  table.count = step["size"].as<std::uint32_t>();
  table.max_count = step["max_size"].as<std::uint32_t>();
  table.stride = 1;
  const Node& end = step["ends_with"];
  if (!end.is_none()) table.ends_with = end.as<int>();
  for (const Node& mark : step["excludes"].list())
    table.excludes.emplace_back(mark.bytes().begin(), mark.bytes().end());
  read_told(table, step);
}

/// Read the values that share a number's bits.
void read_members(FieldTable& container, const Node& step) {
  const auto size = step["size"].as<std::uint8_t>();
  for (const Node& member : step["members"].list()) {
    FieldTable table = read_field(member["field"]);
    table.size = size;
    table.order = container.order;
    table.shift = member["low"].as<std::uint8_t>();
    const Node::List& pieces = member["pieces"].list();
    for (std::size_t i = 0; pieces.size() > 1 && i < pieces.size(); ++i) {
      table.pieces.emplace_back(pieces[i][0].as<std::uint8_t>(), pieces[i][1].as<std::uint8_t>());
    }
    read_slot(table, member);
    container.counts = container.counts || table.counts;
    container.fields.push_back(std::move(table));
  }
}

void read_times(FieldTable& table, const Node& step) {
  const Node& count = step["count"];
  if (count.is_none()) return;
  const Node& packed = step["packed"];
  table.repeat = packed.is_none() ? Repeat::fixed : Repeat::packed;
  table.count = count.as<std::uint32_t>();
  if (!packed.is_none()) table.bit_order = bit_order_of(packed);
}

enum class StepKind : std::uint8_t { number, array, bits, characters, group, list };

constexpr std::pair<const char*, StepKind> step_kinds[] = {
    {"Number", StepKind::number},         {"Array", StepKind::array}, {"Bits", StepKind::bits},
    {"Characters", StepKind::characters}, {"Group", StepKind::group}, {"List", StepKind::list},
};

FieldTable read_step(const Node& step) {
  FieldTable table = read_field(step["field"]);
  table.at = step["at"].as<std::size_t>();
  table.stride = step["stride"].as<std::size_t>();
  switch (meant_by(step_kinds, step["step"], "step")) {
    case StepKind::number: read_slot(table, step); break;
    case StepKind::array: read_times(table, step); break;
    case StepKind::bits: read_members(table, step); break;
    case StepKind::characters: read_characters(table, step); break;
    case StepKind::group:
      read_times(table, step);
      table.fields = read_steps(step["steps"]);
      break;
    case StepKind::list:
      table.repeat = Repeat::listed;
      table.max_count = step["max_count"].as<std::uint32_t>();
      table.fields = read_steps(step["steps"]);
      read_told(table, step);
      break;
  }
  return table;
}

}  // namespace

std::vector<FieldTable> read_steps(const Node& steps) {
  std::vector<FieldTable> out;
  for (const Node& step : steps.list()) out.push_back(read_step(step));
  return out;
}

std::vector<FieldTable> read_numbers(const Node& fields) {
  std::vector<FieldTable> out;
  for (const Node& field : fields.list()) out.push_back(read_field(field));
  return out;
}

}  // namespace wirebond::engine
