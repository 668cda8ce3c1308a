// Numbers in characters: finds them in a payload, reads and writes them.
#pragma once

#include <cstddef>
#include <cstdint>
#include <optional>

#include "wirebond/digits.hpp"
#include "wirebond/engine/field_table.hpp"
#include "wirebond/engine/walk.hpp"

namespace wirebond::engine {

/// The characters of a number, and the bits that it would have in binary; none if they spell no number that it can be.
struct Spelled {
  const std::uint8_t* at = nullptr;
  std::size_t size = 0;
  bool is_ended = true;  ///< false: the byte that ends it is missing
  std::optional<std::uint64_t> raw;
};

/// Return the bits of the number that these characters spell.
inline std::optional<std::uint64_t> raw_of_characters(const FieldTable& field, const std::uint8_t* at,
                                                      std::size_t size) {
  wirebond::detail::Magnitude<std::uint64_t> found;
  if (!wirebond::detail::read_magnitude(*field.digits, at, size, found)) return std::nullopt;
  if (found.negative && !field.is_signed) return std::nullopt;
  const std::uint64_t most = low_bits(field.width) >> (field.is_signed ? 1 : 0);
  if (found.amount > most + (found.negative ? 1 : 0)) return std::nullopt;
  return (found.negative ? 0 - found.amount : found.amount) & low_bits(field.width);
}

/// Read the number that begins at walk.at(place), and move the walk past it.
inline Spelled read_characters(const FieldTable& field, std::size_t place, Walk& walk) {
  Spelled out;
  out.at = walk.at(place);
  out.size = field.count != 0 ? field.count : walk.string_size(field, place, SIZE_MAX);
  out.is_ended = field.ends_with < 0 || out.at[out.size] == static_cast<std::uint8_t>(field.ends_with);
  if (out.is_ended) out.raw = raw_of_characters(field, out.at, out.size);
  return out;
}

/// Return the number, without its sign, whose bits these are.
inline wirebond::detail::Magnitude<std::uint64_t> magnitude_of_raw(const FieldTable& field, std::uint64_t raw) {
  if (!field.is_signed) return {raw, false};
  return wirebond::detail::magnitude_of(from_twos_complement(raw, field.width));
}

}  // namespace wirebond::engine
