// One number among a payload's bytes, and the rules for its value.
#include "wirebond/engine/element.hpp"

#include <algorithm>
#include <cmath>
#include <cstring>

#include "wirebond/engine/errors.hpp"
#include "wirebond/engine/text.hpp"

namespace wirebond::engine {

namespace {

/// `whole`: as `whole_of` returns it.
std::string whole_text(const FieldTable& field, std::uint64_t whole) {
  return field.is_signed ? std::to_string(static_cast<std::int64_t>(whole)) : std::to_string(whole);
}

std::string with_unit(const std::string& text, const FieldTable& field) {
  return field.unit.empty() ? text : text + " " + field.unit;
}

std::string range_text(const FieldTable& field) {
  return with_unit(number_text(field.minimum) + " ... " + number_text(field.maximum), field);
}

/// Return the whole number nearest to an SI value; halves away from zero, as in the generated code.
double to_wire(const FieldTable& field, double si) { return std::round(from_si(field, si)); }

/// Check whether a scaled number is between the bounds' own wire values. A legal bound may round past itself.
bool in_wire_range(const FieldTable& field, double wire) {
  const double one = to_wire(field, field.minimum);
  const double other = to_wire(field, field.maximum);
  return wire >= std::min(one, other) && wire <= std::max(one, other);
}

}  // namespace

std::string Path::text() const {
  std::string out = parent == nullptr ? name : parent->text() + "." + name;
  if (element >= 0) out += "[" + std::to_string(element) + "]";
  return out;
}

double float_of(const FieldTable& field, std::uint64_t raw) {
  if (field.size == 4) {
    const auto bits = static_cast<std::uint32_t>(raw);
    float value;
    std::memcpy(&value, &bits, sizeof value);
    return static_cast<double>(value);
  }
  double value;
  std::memcpy(&value, &raw, sizeof value);
  return value;
}

std::string fault_of(const FieldTable& field, std::uint64_t raw) {
  double si = 0;
  double wire_number = 0;
  switch (field.kind) {
    case FieldKind::boolean: return raw <= 1 ? "" : " is " + std::to_string(raw) + ", a bool is 0 or 1";
    case FieldKind::floating: {
      const double wire = float_of(field, raw);
      if (!std::isfinite(wire)) return " is " + number_text(wire) + ", not a finite number";
      si = to_si(field, wire);
      // The generated code computes in the wire's own type, and has no value then.
      const bool is_double = field.size == sizeof(double);
      if (!std::isfinite(is_double ? si : static_cast<double>(static_cast<float>(si)))) {
        return " is " + number_text(si) + ", beyond a " + (is_double ? "64" : "32") + "-bit float";
      }
      break;
    }
    default: {
      const std::uint64_t wire = whole_of(field, raw);
      if (field.coding == Coding::bcd && wire == bcd_end(field.width)) {
        return " has the digits " + hex_text(raw) + ", and others than 0 to 9 are not a number";
      }
      if (field.has_enum && enumerator_of(field, wire) < 0) {
        return " is " + whole_text(field, wire) + ", which is not an enumerator";
      }
      std::uint64_t rest = field.has_flags ? wire : 0;
      for (const auto& flag : field.flags) rest &= ~(std::uint64_t{1} << flag.second);
      if (rest != 0) return " has unnamed bits set: " + std::to_string(rest);
      wire_number = whole_as_double(field, wire);
      si = to_si(field, wire_number);
    }
  }
  if (!field.has_range || (si >= field.accepted_least && si <= field.accepted_most)) return "";
  if (field.scaled && field.kind != FieldKind::floating && in_wire_range(field, wire_number)) return "";
  return " = " + with_unit(number_text(si), field) + " is outside " + range_text(field);
}

void check_number(const FieldTable& field, double value, const Path& path) {
  if (!std::isfinite(value)) throw MessageError(path.text() + " is " + number_text(value) + ", not a finite number");
  if (field.has_range &&
      !(value >= field.accepted_least - field.range_slack && value <= field.accepted_most + field.range_slack)) {
    throw MessageError(path.text() + " = " + with_unit(number_text(value), field) + " is outside " + range_text(field));
  }
}

std::uint64_t float_bits(const FieldTable& field, double value, const Path& path) {
  const double wire = field.scaled ? from_si(field, value) : value;
  std::uint64_t bits = 0;
  if (field.size != 4) {
    std::memcpy(&bits, &wire, sizeof wire);
    return bits;
  }
  const auto narrow = static_cast<float>(wire);
  if (!std::isfinite(narrow)) {
    throw MessageError(path.text() + " = " + number_text(wire) +
                       " does not fit a 32-bit float, which holds at most 3.4028235e+38");
  }
  std::uint32_t narrow_bits;
  std::memcpy(&narrow_bits, &narrow, sizeof narrow);
  return narrow_bits;
}

void does_not_fit(const FieldTable& field, const std::string& shown, const Path& path) {
  std::string text = std::to_string(field.least) + " ... " + std::to_string(field.greatest);
  if (field.scaled) {
    double from = to_si(field, static_cast<double>(field.least));
    double to = to_si(field, static_cast<double>(field.greatest));
    if (from > to) std::swap(from, to);
    text = with_unit(number_text(from) + " ... " + number_text(to), field);
  }
  throw MessageError(path.text() + " = " + shown + " does not fit its " + std::to_string(field.width) +
                     "-bit wire type, which holds " + text);
}

bool scaled_whole(const FieldTable& field, double value, std::uint64_t& whole) {
  const double wire = to_wire(field, value);
  // As doubles both 2^64 - 1 and 2^63 - 1 round up to a number that does not fit.
  const double beyond = static_cast<double>(field.greatest) + 1;
  if (!(wire >= static_cast<double>(field.least) && wire < beyond)) return false;
  whole =
      field.is_signed ? static_cast<std::uint64_t>(static_cast<std::int64_t>(wire)) : static_cast<std::uint64_t>(wire);
  return true;
}

}  // namespace wirebond::engine
