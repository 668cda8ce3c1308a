// Rows of payloads as columns of numbers, without an object for each message.
#pragma once

#include <cstddef>
#include <cstdint>
#include <cstring>
#include <limits>
#include <string>
#include <type_traits>
#include <utility>
#include <vector>

#include "wirebond/engine/characters.hpp"
#include "wirebond/engine/element.hpp"
#include "wirebond/engine/rows.hpp"
#include "wirebond/engine/walk.hpp"

namespace wirebond::engine {

/// One column: a field that is not a structure, of the message or of one element of a group.
struct Column {
  std::string name;  ///< dotted: `position.x`, `joints[3].position`
  const FieldTable* field;
  std::size_t at;                             ///< in the payload, if nothing before it varies in size
  bool moves = false;                         ///< something before it varies in size
  bool may_lack = false;                      ///< in an element that is not in every row
  std::vector<const std::uint8_t*> places{};  ///< place in each row, if it moves; null: the row lacks it
  std::vector<double> numbers{};              ///< of a number in characters: its values; NaN: the row has none

  /// Check whether its values are not numbers: a string, or a list of varying size.
  bool holds_values() const { return field->is_string() || field->repeat == Repeat::listed; }
};

/// Return the columns of a message, in the order of its fields.
std::vector<Column> columns_of(const MessageTable& message);

/// Check whether the field is flattened: a structure or group, into `elements_of` elements. A counted group has its
/// maximum number.
inline bool is_flattened(const FieldTable& field) { return field.kind == FieldKind::structure; }

inline std::size_t elements_of(const FieldTable& field) {
  return field.repeat == Repeat::listed ? field.max_count : field.repeat == Repeat::once ? 1 : field.count;
}

/// Return the value of a number.
inline double value_of(const FieldTable& field, std::uint64_t raw) {
  const double wire =
      field.kind == FieldKind::floating ? float_of(field, raw) : whole_as_double(field, whole_of(field, raw));
  return field.scaled ? to_si(field, wire) : wire;
}

namespace detail {

/// Skip the columns of an element that this row lacks.
template <class Keep>
void skip_columns(const std::vector<FieldTable>& fields, std::vector<Column>& columns, std::size_t& next, Keep& keep) {
  for (const FieldTable& field : fields) {
    if (is_flattened(field)) {
      for (std::size_t i = 0; i < elements_of(field); ++i) skip_columns(field.fields, columns, next, keep);
      continue;
    }
    Column& column = columns[next];
    column.places.push_back(nullptr);
    if (field.digits) column.numbers.push_back(std::numeric_limits<double>::quiet_NaN());
    if (column.holds_values()) keep.none(next);
    ++next;
  }
}

/// Read one row: its values that are not numbers, and the places of those that move. `next` counts the columns.
template <class Keep>
void read_row(const std::vector<FieldTable>& fields, std::size_t place, Walk& walk, std::vector<Column>& columns,
              std::size_t& next, Keep& keep) {
  Counts counts;
  for (const FieldTable& field : fields) {
    const std::size_t here = place + field.at;
    if (field.counts) counts.tell(field, walk.at(here));  // one of its bits may count, too
    if (is_flattened(field)) {
      const auto read = [&](std::size_t, std::size_t at) { read_row(field.fields, at, walk, columns, next, keep); };
      std::size_t found = 0;
      if (field.repeat == Repeat::listed) {
        found = walk.elements(field, here, counts.promised(field), read);
      } else {
        for (; found < elements_of(field); ++found) read(found, here + found * field.stride);
      }
      for (; found < elements_of(field); ++found) skip_columns(field.fields, columns, next, keep);
      continue;
    }
    Column& column = columns[next];
    if (column.moves) column.places.push_back(walk.at(here));
    if (field.digits) {
      const Spelled spelled = read_characters(field, here, walk);
      column.numbers.push_back(spelled.raw ? value_of(field, *spelled.raw) : std::numeric_limits<double>::quiet_NaN());
    } else if (column.holds_values()) {
      keep.value(next, field, here, field.is_variable ? counts.promised(field) : 0, walk);
    }
    ++next;
  }
}

}  // namespace detail

/// Find the parts without a fixed place in the rows. `keep.value(column, field, place, promised, walk)` takes each
/// value that is not a number, and moves the walk past it; `keep.none(column)` is called for a row that lacks one.
template <class Keep>
void read_rows(const MessageTable& message, const Rows& rows, std::vector<Column>& columns, Keep& keep) {
  const bool varies = row_bytes(message) == 0;
  bool walks = false;
  for (const Column& column : columns) walks = walks || column.moves || column.holds_values() || column.field->digits;
  for (std::size_t i = 0; walks && i < rows.offsets.size(); ++i) {
    const std::size_t begin = varies ? rows.begin_of(i) : i * message.min_payload;
    const std::size_t size = varies ? rows.ends[i] - begin : message.min_payload;
    Walk walk{rows.payloads.data() + begin, size - message.min_payload};
    std::size_t next = 0;
    detail::read_row(message.fields, 0, walk, columns, next, keep);
  }
  if (!varies) return;
  for (Column& column : columns) {  // rows have no stride: every column uses places
    for (std::size_t i = 0; !column.moves && i < rows.offsets.size(); ++i) {
      column.places.push_back(rows.payloads.data() + rows.begin_of(i) + column.at);
    }
    column.moves = true;
  }
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

/// Check whether an element's bytes on the wire are this type's in memory.
template <class T>
bool stands_as(const FieldTable& field) {
#if defined(__BYTE_ORDER__) && __BYTE_ORDER__ == __ORDER_LITTLE_ENDIAN__
  return (std::is_floating_point_v<T> == (field.kind == FieldKind::floating)) && field.kind != FieldKind::boolean &&
         field.repeat != Repeat::packed && field.size == sizeof(T) && field.width == 8 * sizeof(T) &&
         (field.order == ByteOrder::little || sizeof(T) == 1) && !field.scaled && field.pieces.empty() &&
         field.coding == Coding::binary;
#else
  static_cast<void>(field);
  return false;
#endif
}

/// Fill `values` with the column's numbers, `field->count` for each row. `value` converts a number's bits to an
/// element; for a row that lacks the column the element is unchanged.
template <class T, class Value>
void fill_column(const Column& column, const Rows& rows, std::size_t stride, T* values, Value value) {
  const FieldTable& field = *column.field;
  const std::size_t count = rows.offsets.size();
  const std::size_t elements = field.count;
  const auto each_place = [&](auto take) {
    T* out = values;
    const std::uint8_t* row = rows.payloads.data() + column.at;
    for (std::size_t i = 0; i < count; ++i, row += stride, out += elements) {
      const std::uint8_t* const at = column.moves ? column.places[i] : row;
      if (at != nullptr) take(out, at);
    }
  };
  if (stands_as<T>(field)) {
    if (elements == 1) {
      each_place([](T* out, const std::uint8_t* at) { std::memcpy(out, at, sizeof(T)); });
    } else {
      each_place([&](T* out, const std::uint8_t* at) { std::memcpy(out, at, elements * sizeof(T)); });
    }
    return;
  }
  with_load(field, [&](auto load) {
    each_place([&](T* out, const std::uint8_t* at) {
      for (std::size_t i = 0; i < elements; ++i) out[i] = static_cast<T>(value(load(at, i)));
    });
  });
}

}  // namespace wirebond::engine
