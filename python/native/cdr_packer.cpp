// Converts a received message to the bytes (CDR) of a ROS 2 topic, with a plan made once from the mapping. No DDS.
#include "cdr_packer.hpp"

#include <nanobind/stl/string.h>

#include <algorithm>
#include <cmath>
#include <cstring>
#include <type_traits>

#include "objects.hpp"
#include "wirebond/engine/element.hpp"

namespace wirebond::engine {

namespace {

static_assert(__BYTE_ORDER__ == __ORDER_LITTLE_ENDIAN__, "plans are for little-endian bytes");

template <class Number>
bool store(std::uint8_t* to, Number number) {
  std::memcpy(to, &number, sizeof number);
  return true;
}

template <class Number>
bool is_negative(Number number) {
  if constexpr (std::is_signed_v<Number>) return number < 0;
  return false;
}

/// Returns false if this type cannot hold the integer.
template <class Target, class Given>
bool store_integer(std::uint8_t* to, Given number) {
  const auto narrow = static_cast<Target>(number);
  if (static_cast<Given>(narrow) != number || is_negative(narrow) != is_negative(number)) return false;
  return store(to, narrow);
}

/// Store as struct.pack does: a finite number that is too large for 32 bits is an error.
bool store_float(std::uint8_t* to, char code, double number) {
  if (code == 'd') return store(to, number);
  if (code != 'f') return false;
  const auto narrow = static_cast<float>(number);
  return (std::isinf(number) || !std::isinf(narrow)) && store(to, narrow);
}

template <class Given>
bool store_as(std::uint8_t* to, char code, Given number) {
  switch (code) {
    case 'b': return store_integer<std::int8_t>(to, number);
    case 'B': return store_integer<std::uint8_t>(to, number);
    case 'h': return store_integer<std::int16_t>(to, number);
    case 'H': return store_integer<std::uint16_t>(to, number);
    case 'i': return store_integer<std::int32_t>(to, number);
    case 'I': return store_integer<std::uint32_t>(to, number);
    case 'q': return store_integer<std::int64_t>(to, number);
    case 'Q': return store_integer<std::uint64_t>(to, number);
    default: return store_float(to, code, static_cast<double>(number));
  }
}

std::vector<std::size_t> places_of(nb::handle offsets) {
  std::vector<std::size_t> out;
  for (nb::handle offset : offsets) out.push_back(nb::cast<std::size_t>(offset));
  return out;
}

std::string bytes_of(nb::handle value) {
  const auto bytes = nb::cast<nb::bytes>(value);
  return std::string(bytes.c_str(), bytes.size());
}

/// Read the bytes for each number that the field can have; others are left to Python.
std::vector<std::pair<std::uint64_t, std::string>> read_choices(const FieldTable& field, bool is_bool,
                                                                nb::handle chosen) {
  std::vector<std::pair<std::uint64_t, std::string>> out;
  for (auto [word, bytes] : nb::cast<nb::dict>(chosen)) {
    const std::string name = nb::cast<std::string>(word);
    if (is_bool) {
      out.emplace_back(name == "true" ? 1 : 0, bytes_of(bytes));
      continue;
    }
    for (const auto& [enumerator, number] : field.enumerators) {
      if (enumerator == name) out.emplace_back(number, bytes_of(bytes));
    }
  }
  return out;
}

}  // namespace

std::unique_ptr<CdrPacker> CdrPacker::make(std::shared_ptr<const ProtocolTable> protocol, nb::handle plan) {
  auto packer = std::make_unique<CdrPacker>();
  const int message = protocol->find(nb::cast<std::string>(plan.attr("message")));
  if (message < 0) return nullptr;
  packer->message_ = static_cast<std::int16_t>(message);
  packer->data_ = bytes_of(plan.attr("data"));
  packer->seconds_ = places_of(plan.attr("seconds"));
  packer->nanoseconds_ = places_of(plan.attr("nanoseconds"));
  const std::vector<FieldTable>& fields = protocol->messages()[static_cast<std::size_t>(message)].fields;
  for (nb::handle each : plan.attr("values")) {
    Value value;
    value.at = nb::cast<std::size_t>(each.attr("at"));
    value.code = nb::cast<std::string>(each.attr("code")).at(0);
    value.scale = nb::cast<double>(each.attr("scale"));
    value.offset = nb::cast<double>(each.attr("offset"));
    value.is_linear = value.scale != 1.0 || value.offset != 0.0;
    if (!find(fields, each.attr("path"), value)) return nullptr;
    const bool is_bool = value.flag >= 0 || value.field->kind == FieldKind::boolean;
    const nb::object chosen = each.attr("chosen");
    value.is_chosen = !chosen.is_none();
    if (value.is_chosen) {
      value.chosen = read_choices(*value.field, is_bool, chosen);
    } else if (is_bool != (value.code == '?')) {
      return nullptr;
    } else if (value.flag < 0 && value.field->has_enum) {
      return nullptr;  // a name
    }
    packer->values_.push_back(std::move(value));
  }
  packer->protocol_ = std::move(protocol);
  return packer;
}

/// Find the number at this path. Returns false if its place is not the same in every payload.
bool CdrPacker::find(const std::vector<FieldTable>& fields, nb::handle path, Value& value) {
  const std::vector<FieldTable>* among = &fields;
  const auto steps = nb::cast<nb::tuple>(path);
  for (std::size_t i = 0; i < steps.size();) {
    const std::string name = nb::cast<std::string>(nb::object(steps[i++]));
    const FieldTable* found = nullptr;
    for (const FieldTable& field : *among) {
      if (field.is_variable) return false;
      if (field.name == name) {
        found = &field;
        break;
      }
    }
    if (found == nullptr || found->is_characters() || found->repeat == Repeat::listed) return false;
    value.field = found;
    value.place += found->at;
    value.index = 0;
    if (found->repeat != Repeat::once) {
      if (i == steps.size()) return false;
      value.index = std::stoul(nb::cast<std::string>(nb::object(steps[i++])));
      if (value.index >= found->count) return false;
    }
    if (found->kind == FieldKind::structure) {
      value.place += value.index * found->stride;
      among = &found->fields;
      continue;
    }
    if (i == steps.size()) return true;
    if (i + 1 != steps.size()) return false;
    for (const auto& [flag, bit] : found->flags) {
      if (flag == nb::cast<std::string>(nb::object(steps[i]))) value.flag = static_cast<int>(bit);
    }
    return value.flag >= 0;
  }
  return false;
}

bool CdrPacker::put(const Value& value, std::uint64_t raw, std::uint8_t* to) {
  const FieldTable& field = *value.field;
  if (value.flag >= 0) raw = (raw >> value.flag) & 1u;
  const bool is_bool = value.flag >= 0 || field.kind == FieldKind::boolean;
  if (is_bool) raw = raw != 0 ? 1 : 0;
  const bool is_float = field.kind == FieldKind::floating;
  const std::uint64_t wire = is_bool || is_float ? raw : whole_of(field, raw);
  if (value.is_chosen) {
    for (const auto& [one, bytes] : value.chosen) {
      if (one != wire) continue;
      std::memcpy(to, bytes.data(), bytes.size());
      return true;
    }
    return false;
  }
  if (is_bool) return store(to, static_cast<std::uint8_t>(raw));
  if (!is_float && !field.scaled && !value.is_linear) {
    return field.is_signed ? store_as(to, value.code, static_cast<std::int64_t>(wire)) : store_as(to, value.code, wire);
  }
  double si = is_float ? float_of(field, raw) : whole_as_double(field, wire);
  if (field.scaled) si = to_si(field, si);
  if (value.is_linear) {
    const double scaled = si * value.scale;
    si = scaled + value.offset;
  }
  return store_float(to, value.code, si);
}

nb::list CdrPacker::pack(nb::list messages, nb::list stamps_ns) const {
  nb::list out;
  const std::size_t count = std::min(messages.size(), stamps_ns.size());
  for (std::size_t i = 0; i < count; ++i) {
    out.append(pack_one(nb::cast<const Message&>(messages[i]), nb::cast<std::int64_t>(stamps_ns[i])));
  }
  return out;
}

nb::object CdrPacker::pack_one(const Message& message, std::int64_t stamp_ns) const {
  constexpr std::int64_t second_ns = 1'000'000'000;
  const Event& event = message.event();
  const Batch& batch = message.batch();
  if (event.message != message_ || batch.protocol != protocol_) return nb::none();
  std::int64_t seconds = stamp_ns / second_ns;
  std::int64_t rest = stamp_ns % second_ns;
  if (rest < 0) {
    seconds -= 1;
    rest += second_ns;
  }
  const bool fits = static_cast<std::int32_t>(seconds) == seconds;
  if (!fits && !seconds_.empty()) return nb::none();
  nb::bytes out(data_.data(), data_.size());
  auto* const to = reinterpret_cast<std::uint8_t*>(PyBytes_AsString(out.ptr()));  // no other reference exists yet
  for (const std::size_t at : seconds_) store(to + at, static_cast<std::int32_t>(seconds));
  for (const std::size_t at : nanoseconds_) store(to + at, static_cast<std::uint32_t>(rest));
  const std::uint8_t* const payload = batch.bytes.data() + event.payload_at;
  for (const Value& value : values_) {
    if (!put(value, load_raw(*value.field, payload + value.place, value.index), to + value.at)) return nb::none();
  }
  return out;
}

nb::list stamps_ns(nb::list messages, std::int64_t ahead_ns) {
  nb::list out;
  for (nb::handle each : messages) {
    Message& message = nb::cast<Message&>(each);
    const nb::object stamp = message.stamp();
    const double seconds = stamp.is_none() ? message.time() : nb::cast<double>(stamp);
    out.append(static_cast<std::int64_t>(seconds * 1e9) + ahead_ns);
  }
  return out;
}

}  // namespace wirebond::engine
