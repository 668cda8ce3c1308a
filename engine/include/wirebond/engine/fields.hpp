// Converts payload bytes to values of a language and back, independent of their frame.
//
// `V` is how a language has values. What it has to offer is seen from its use here: `NodeValues` is the plainest one.
//
//   V::Value            a value that is kept
//   V::Ref              one that is only looked at
//   V::List, V::Map     lists and maps while they are made
//   V::Characters       keeps the bytes of a text or of bytes, for `view()`
//
// One file: for each kind of value, the way in and the way out.
#pragma once

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <cstring>
#include <optional>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include "wirebond/engine/characters.hpp"
#include "wirebond/engine/element.hpp"
#include "wirebond/engine/errors.hpp"
#include "wirebond/engine/protocol.hpp"
#include "wirebond/engine/text.hpp"
#include "wirebond/engine/walk.hpp"

namespace wirebond::engine {

/// Return a sentence for each field rule that the payload breaks (not finite, out of range, unknown enumerator or flag,
/// more elements promised than there are). `size` is at least message.min_payload.
std::vector<std::string> find_violations(const MessageTable& message, const std::uint8_t* payload, std::size_t size);

/// Return the unit in which a field is counted.
inline const char* unit_of(const FieldTable& field, const Counter& counter) {
  return field.is_string() || counter.step > 1 ? " bytes" : " elements";
}

// ---- decoding -----------------------------------------------------------------------------------------------------

template <class V>
typename V::Value flag_names(const FieldTable& field, std::uint64_t wire) {
  auto names = V::make_list(0);
  std::uint64_t rest = wire;
  for (std::size_t i = 0; i < field.flags.size(); ++i) {
    const unsigned bit = field.flags[i].second;
    if ((wire >> bit) & 1u) V::append(names, V::flag(field, i));
    rest &= ~(std::uint64_t{1} << bit);
  }
  for (unsigned bit = 0; rest != 0; ++bit, rest >>= 1) {  // unnamed bits keep their value, so that encoding restores it
    if (rest & 1u) V::append(names, V::natural(std::uint64_t{1} << bit));
  }
  return V::made(std::move(names));
}

/// Return the value of one number.
template <class V>
typename V::Value decode_element(const FieldTable& field, std::uint64_t raw) {
  switch (field.kind) {
    case FieldKind::boolean: return V::boolean(raw != 0);
    case FieldKind::floating: {
      const double wire = float_of(field, raw);
      return V::floating(field.scaled ? to_si(field, wire) : wire);
    }
    default: {
      const std::uint64_t wire = whole_of(field, raw);
      if (field.has_flags) return flag_names<V>(field, wire);
      if (const std::ptrdiff_t found = enumerator_of(field, wire); found >= 0) {
        return V::enumerator(field, static_cast<std::size_t>(found));
      }
      if (field.scaled) return V::floating(to_si(field, whole_as_double(field, wire)));
      return field.is_signed ? V::integer(static_cast<std::int64_t>(wire)) : V::natural(wire);
    }
  }
}

template <class V>
typename V::Value decode_all(const std::vector<FieldTable>& fields, std::size_t place, Walk& walk);

template <class V>
typename V::Value decode_string(const FieldTable& field, std::size_t place, std::uint64_t promised, Walk& walk) {
  const char* const at = reinterpret_cast<const char*>(walk.at(place));
  const bool is_fixed = field.count != 0;
  std::size_t size = is_fixed ? field.count : walk.string_size(field, place, promised);
  // If another byte is in the place of the one that ends it, that byte is the string's last.
  if (field.ends_with >= 0 && at[size] != static_cast<char>(field.ends_with)) ++size;
  if (field.kind == FieldKind::bytes) return V::bytes(std::string_view(at, size));
  if (is_fixed) {  // padded with zeros
    const void* const end = std::memchr(at, 0, size);
    if (end != nullptr) size = static_cast<std::size_t>(static_cast<const char*>(end) - at);
  }
  return V::text(std::string_view(at, size));
}

template <class V>
typename V::Value decode_one(const FieldTable& field, std::size_t place, Walk& walk) {
  if (field.kind == FieldKind::structure) return decode_all<V>(field.fields, place, walk);
  return decode_element<V>(field, load_raw(field, walk.at(place), 0));
}

template <class V>
typename V::Value decode_fixed(const FieldTable& field, std::size_t place, Walk& walk) {
  auto out = V::make_list(field.count);
  for (std::uint32_t i = 0; i < field.count; ++i) {
    V::put(out, i,
           field.kind == FieldKind::structure ? decode_all<V>(field.fields, place + i * field.stride, walk)
                                              : decode_element<V>(field, load_raw(field, walk.at(place), i)));
  }
  return V::made(std::move(out));
}

/// Return the value of the field that begins at walk.at(place), and move the walk past it. `promised`: how many
/// elements or bytes the payload promises.
template <class V>
typename V::Value decode_field(const FieldTable& field, std::size_t place, std::uint64_t promised, Walk& walk) {
  if (field.digits) {
    const Spelled found = read_characters(field, place, walk);
    return found.raw ? decode_element<V>(field, *found.raw) : V::none();
  }
  if (field.is_string()) return decode_string<V>(field, place, promised, walk);
  if (field.repeat == Repeat::once) return decode_one<V>(field, place, walk);
  if (field.repeat != Repeat::listed) return decode_fixed<V>(field, place, walk);
  auto out = V::make_list(0);
  walk.elements(field, place, promised,
                [&](std::size_t, std::size_t at) { V::append(out, decode_one<V>(field, at, walk)); });
  return V::made(std::move(out));
}

template <class V>
typename V::Value decode_all(const std::vector<FieldTable>& fields, std::size_t place, Walk& walk) {
  auto out = V::make_map(fields.size());
  Counts counts;
  for (const FieldTable& field : fields) {
    const std::size_t here = place + field.at;
    if (field.counts) counts.tell(field, walk.at(here));
    const std::uint64_t promised = field.is_variable ? counts.promised(field) : 0;
    V::set(out, field, decode_field<V>(field, here, promised, walk));
  }
  return V::made(std::move(out));
}

/// Return all fields as a map of SI values: a map for a structure, a list for a repeated field. `size` is at least
/// message.min_payload; a list that promises more elements than there are has the existing ones.
template <class V>
typename V::Value decode_fields(const MessageTable& message, const std::uint8_t* payload, std::size_t size) {
  Walk walk{payload, size - message.min_payload};
  return decode_all<V>(message.fields, 0, walk);
}

// ---- encoding one number ------------------------------------------------------------------------------------------

/// Throw "path is value (type); expected …".
template <class V>
[[noreturn]] void wrong_type(const Path& path, typename V::Ref value, const std::string& expected) {
  throw MessageError(path.text() + " is " + V::shown(value) + " (" + V::type_name(value) + "); expected " + expected);
}

template <class V>
double number_from(const FieldTable& field, typename V::Ref value, const Path& path) {
  const double number = V::number(value, path);
  check_number(field, number, path);
  return number;
}

/// Return an integer as two's complement in 64 bits, after checking it against the field's bits.
template <class V>
std::uint64_t integer_bits(const FieldTable& field, typename V::Ref value, const Path& path) {
  if (field.is_signed) {
    const std::optional<std::int64_t> number = V::as_signed(value);
    if (!number || *number < field.least || *number > static_cast<std::int64_t>(field.greatest)) {
      does_not_fit(field, V::shown(value), path);
    }
    return static_cast<std::uint64_t>(*number);
  }
  const std::optional<std::uint64_t> number = V::as_unsigned(value);
  if (!number || *number > field.greatest) does_not_fit(field, V::shown(value), path);
  return *number;
}

template <class V>
std::uint64_t enum_bits(const FieldTable& field, typename V::Ref value, const Path& path) {
  for (std::size_t i = 0; i < field.enumerators.size(); ++i) {
    if (V::is_enumerator(field, i, value)) return field.enumerators[i].second;
  }
  if (V::is_integer(value)) {
    const std::uint64_t bits = integer_bits<V>(field, value, path);
    if (enumerator_of(field, bits) >= 0) return bits;
  }
  throw MessageError(path.text() + " is " + V::shown(value) + "; expected one of " + names_of(field.enumerators));
}

template <class V>
std::uint64_t flag_bits(const FieldTable& field, typename V::Ref value, const Path& path) {
  if (V::is_integer(value)) return integer_bits<V>(field, value, path);
  if (!V::is_several(value)) wrong_type<V>(path, value, "a list of flag names, or an integer");
  std::uint64_t bits = 0;
  V::each(value, [&](typename V::Ref entry) {
    bool known = false;
    for (std::size_t i = 0; i < field.flags.size(); ++i) {
      if (!V::is_flag(field, i, entry)) continue;
      bits |= std::uint64_t{1} << field.flags[i].second;
      known = true;
    }
    if (known) return;
    if (!V::is_integer(entry)) {
      throw MessageError(path.text() + " has no flag " + V::shown(entry) + "; it has " + names_of(field.flags));
    }
    bits |= integer_bits<V>(field, entry, path);
  });
  return bits;
}

/// Return the bits of a value. Throws MessageError with a sentence about `path`.
template <class V>
std::uint64_t encode_element(const FieldTable& field, typename V::Ref value, const Path& path) {
  switch (field.kind) {
    case FieldKind::boolean: {
      const std::optional<bool> is_set = V::as_bool(value);
      if (!is_set) wrong_type<V>(path, value, "true or false");
      return *is_set ? 1 : 0;
    }
    case FieldKind::floating: return float_bits(field, number_from<V>(field, value, path), path);
    default: {
      if (field.has_flags) return flag_bits<V>(field, value, path);
      if (field.has_enum) return bits_of_whole(field, enum_bits<V>(field, value, path));
      if (field.scaled) {
        std::uint64_t whole = 0;
        if (!scaled_whole(field, number_from<V>(field, value, path), whole)) {
          does_not_fit(field, V::shown(value), path);
        }
        return bits_of_whole(field, whole);
      }
      if (const std::optional<typename V::Value> index = V::index(value)) {
        if (field.has_range) static_cast<void>(number_from<V>(field, *index, path));
        return bits_of_whole(field, integer_bits<V>(field, *index, path));
      }
      const double number = number_from<V>(field, value, path);
      if (number != std::floor(number)) wrong_type<V>(path, value, "an integer");
      return bits_of_whole(field, integer_bits<V>(field, V::whole(number), path));
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

/// Reconcile the number of `field`'s elements or bytes with the fields that count them.
void count_in(const FieldTable& field, std::vector<Count>& counts, std::size_t found, const Path& path, Build& build);

/// Check that a text or bytes fit their field, and contain nothing that would end them on the wire.
void check_string(const FieldTable& field, std::string_view data, const Path& path);

/// Write a number in characters at its place: its bits.
void write_characters(const FieldTable& field, std::size_t place, std::uint64_t raw, Build& build);

/// Check whether a caller may leave the field out. A structure that is always there takes the defaults of its fields.
bool may_be_left_out(const FieldTable& field);

/// `outer`: counters in the surrounding list of fields, if these are bits; otherwise null.
template <class V>
void encode_all(const std::vector<FieldTable>& fields, std::size_t place, typename V::Ref values, const Path& path,
                Build& build, std::vector<Count>* outer = nullptr);

/// Return the size of a sequence, after checking it.
template <class V>
std::size_t sequence_size(const FieldTable& field, typename V::Ref value, const Path& path) {
  const bool is_list = field.repeat == Repeat::listed;
  const std::string wanted = is_list ? "at most " + std::to_string(field.max_count) : std::to_string(field.count);
  if (!V::is_sequence(value)) wrong_type<V>(path, value, "a list of " + wanted);
  const std::size_t size = V::size(value);
  if (is_list ? size > field.max_count : size != field.count) {
    throw MessageError(path.text() + " has " + std::to_string(size) + " elements; expected " + wanted);
  }
  return size;
}

/// Encode a repeated field. None means a missing value: a fixed number of structures takes its fields' defaults.
template <class V>
std::size_t encode_elements(const FieldTable& field, std::size_t place, typename V::Ref value, const Path& path,
                            Build& build) {
  const bool is_list = field.repeat == Repeat::listed;
  const std::size_t size = V::is_none(value) ? field.count : sequence_size<V>(field, value, path);
  if (is_list) build.insert(place, size * field.stride);
  if (is_list) build.repetitions += 1;
  for (std::size_t i = 0; i < size; ++i) {
    if (field.kind != FieldKind::structure) {
      store_raw(field, build.at(place), i, encode_element<V>(field, V::item(value, i), path));
      continue;
    }
    const Path element{path.parent, path.name, static_cast<std::ptrdiff_t>(i)};
    const typename V::Value one = V::is_none(value) ? V::made(V::make_map(0)) : V::item(value, i);
    encode_all<V>(field.fields, place + i * field.stride, one, element, build);
  }
  if (is_list) {
    build.repetitions -= 1;
    build.shift += size * field.stride;
    build.note_shift(field);
  }
  return size;
}

/// Return the default for a missing value; none if the caller must give one.
template <class V>
typename V::Value stand_in(const FieldTable& field) {
  if (field.has_default) return V::default_value(field);
  if (field.kind == FieldKind::text) return V::text({});
  if (field.kind == FieldKind::bytes) return V::bytes({});
  if (field.kind == FieldKind::structure && field.repeat == Repeat::once) return V::made(V::make_map(0));
  return V::none();
}

template <class V>
void refuse_unknown(const std::vector<FieldTable>& fields, typename V::Ref values, const Path& path) {
  V::each_key(values, [&](typename V::Ref key) {
    for (const FieldTable& field : fields) {
      if (V::is_name(field, key)) return;
    }
    throw MessageError(path.text() + " has no field " + V::shown(key) +
                       (fields.empty() ? "; it has no fields" : "; it has " + names_of(fields)));
  });
}

template <class V>
void encode_one(const FieldTable& field, std::size_t here, typename V::Ref value, bool is_given, const Path& own,
                Build& build, std::vector<Count>& counts) {
  if (field.digits) {
    write_characters(field, here, encode_element<V>(field, value, own), build);
  } else if (field.is_string()) {
    const typename V::Characters characters(field, value, own);
    const std::string_view data = characters.view();
    check_string(field, data, own);
    if (field.count == 0) build.insert(here, data.size());
    if (!data.empty()) std::memcpy(build.at(here), data.data(), data.size());
    if (field.count == 0) {
      build.shift += data.size();
      build.note_shift(field);
    }
    if (field.ends_with >= 0) *build.at(here) = static_cast<std::uint8_t>(field.ends_with);
    count_in(field, counts, data.size(), own, build);
  } else if (field.repeat != Repeat::once) {
    if (is_given && V::is_none(value)) sequence_size<V>(field, value, own);  // throws
    count_in(field, counts, encode_elements<V>(field, here, value, own, build), own, build);
  } else if (field.kind == FieldKind::structure) {
    encode_all<V>(field.fields, here, value, own, build, field.counts ? &counts : nullptr);
  } else {
    store_raw(field, build.at(here), 0, encode_element<V>(field, value, own));
  }
}

template <class V>
void encode_all(const std::vector<FieldTable>& fields, std::size_t place, typename V::Ref values, const Path& path,
                Build& build, std::vector<Count>* outer) {
  if (!V::is_map(values)) wrong_type<V>(path, values, V::map_name + (" of " + names_of(fields)));
  std::vector<Count> own_counts;
  std::vector<Count>& counts = outer != nullptr ? *outer : own_counts;
  std::size_t used = 0;
  for (const FieldTable& field : fields) {
    const std::size_t here = place + field.at;
    const Path own{&path, field.name};
    std::optional<typename V::Value> value = V::get(values, field);
    const bool is_given = value.has_value();
    used += is_given ? 1 : 0;
    if (field.slot >= 0) {
      const auto slot = static_cast<std::size_t>(field.slot);
      if (counts.size() <= slot) counts.resize(slot + 1);
      Count& count = counts[slot];
      count.field = &field;
      count.at = here + build.shift;
      count.is_given = is_given;
      if (!is_given) continue;  // it gets the size of the elements that it counts
      count.number = encode_element<V>(field, *value, own);
    }
    if (!is_given) {
      value = stand_in<V>(field);
      if (V::is_none(*value) && !may_be_left_out(field)) {
        refuse_unknown<V>(fields, values, path);  // a misspelt name explains the gap
        throw MessageError(path.text() + " needs " + field.name + ", which has no default");
      }
    }
    encode_one<V>(field, here, *value, is_given, own, build, counts);
  }
  if (used != V::map_size(values)) refuse_unknown<V>(fields, values, path);
}

/// Write the constants of the message between its fields.
void write_constants(const MessageTable& message, Build& build);

/// Return the payload for these values. Throws MessageError that names the fact and the limit: unknown or missing
/// field, wrong type, out of range, not finite, too long.
template <class V>
std::vector<std::uint8_t> encode_fields(const MessageTable& message, typename V::Ref values) {
  Build build{std::vector<std::uint8_t>(message.min_payload, 0)};
  encode_all<V>(message.fields, 0, values, Path{nullptr, message.name}, build);
  write_constants(message, build);
  return std::move(build.payload);
}

}  // namespace wirebond::engine
