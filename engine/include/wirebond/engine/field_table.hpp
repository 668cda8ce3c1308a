// A message's layout as tables, read from those that wirebond.protocol.tables makes. Bytes belong to element and
// fields.
#pragma once

#include <cstddef>
#include <cstdint>
#include <memory>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "wirebond/bits.hpp"
#include "wirebond/bytes.hpp"
#include "wirebond/digits.hpp"
#include "wirebond/engine/node.hpp"

namespace wirebond::engine {

/// Bit fields are a structure whose fields are loaded from the same bytes. Tables contain no padding.
enum class FieldKind : std::uint8_t { integer, floating, boolean, text, bytes, structure };

/// How often a field occurs.
enum class Repeat : std::uint8_t {
  once,
  fixed,   ///< `count` elements
  listed,  ///< up to `max_count` elements
  packed,  ///< `count` elements, bit by bit
};

/// A field that counts another one.
struct Counter {
  std::size_t slot = 0;    ///< index among the counters in this list of fields
  std::uint64_t step = 1;  ///< its value per element or byte
  std::string name;        ///< `state.number` for one among the bits of `state`
};

/// One field. `value = (wire * numerator + addend) / denominator + offset`: exact whole numbers, so that only one
/// rounding remains and 9 * 0.001 is 0.009, not 0.009000000000000001. `offset` is zero if whole numbers can express it,
/// and `addend` of a float always.
struct FieldTable {
  std::string name;
  FieldKind kind = FieldKind::integer;
  Repeat repeat = Repeat::once;

  // Place.
  std::size_t at = 0;      ///< bytes from the start of its list of fields, if nothing before it varies in size
  std::size_t stride = 0;  ///< minimum wire bytes of one element
  std::uint32_t count = 1;
  std::uint32_t max_count = 0;        ///< of a list: elements; of a string of varying size: bytes
  bool is_variable = false;           ///< its size varies, or that of a field in it
  bool counts = false;                ///< it, or one of its bits, counts elements or bytes of others
  int slot = -1;                      ///< index among the counters in its list of fields; -1: it counts nothing
  std::vector<Counter> counters;      ///< the first counts its elements, others agree; none: as many as the payload has
  int ends_with = -1;                 ///< of a string: the byte after it, included in its minimum size; -1: none
  std::vector<std::string> excludes;  ///< of a text: delimiters of its frame, which it must not contain

  // One number.
  std::uint8_t size = 1;  ///< bytes that it is loaded from; for a bit field, those of all of them
  ByteOrder order = ByteOrder::little;
  std::uint8_t shift = 0;                                     ///< position of its lowest bit in these bytes
  std::uint8_t width = 8;                                     ///< bits
  std::vector<std::pair<std::uint8_t, std::uint8_t>> pieces;  ///< lowest bit and width of each, if it has several
  BitOrder bit_order = BitOrder::low_first;
  Coding coding = Coding::binary;  ///< of an integer
  bool is_signed = false;          ///< of an integer: its coding has negative numbers
  std::int64_t least = 0;          ///< of an integer: the least that fits on the wire
  std::uint64_t greatest = 0;      ///< of an integer: the greatest that fits
  std::optional<Digits> digits;    ///< it is sent in characters, at a place as that of a string

  // Meaning.
  bool scaled = false;
  double numerator = 1;
  double addend = 0;
  double denominator = 1;
  double offset = 0;
  std::string unit;
  bool has_range = false;
  double minimum = 0;
  double maximum = 0;
  double range_slack = 0;     ///< rounding error that a bound may have
  double accepted_least = 0;  ///< minimum and maximum as the wire carries them: see `Field.accepted_limits`
  double accepted_most = 0;
  bool has_default = false;
  Node default_value;
  bool has_enum = false;
  std::vector<std::pair<std::string, std::uint64_t>> enumerators;  ///< name, value (two's complement in 64 bits)
  bool has_flags = false;
  std::vector<std::pair<std::string, unsigned>> flags;  ///< name, bit

  std::vector<FieldTable> fields;  ///< of a structure

  std::shared_ptr<const void> kept;  ///< kept by a language for this field, such as its names as objects; or null

  bool is_string() const { return kind == FieldKind::text || kind == FieldKind::bytes; }

  /// Check whether it is a string on the wire: one, or a number in characters.
  bool is_characters() const { return is_string() || digits.has_value(); }
};

/// Return tables of these steps of a layout.
std::vector<FieldTable> read_steps(const Node& steps);

/// Return tables of numbers without places, such as header fields.
std::vector<FieldTable> read_numbers(const Node& fields);

}  // namespace wirebond::engine
