// Converts payload bytes to Python values and back, independent of their frame.
#pragma once

#include <cstddef>
#include <cstdint>
#include <vector>

#include "element.hpp"
#include "protocol.hpp"
#include "walk.hpp"

namespace wirebond::engine {

/// Return all fields as a dict of SI values: a dict for a structure, a list for a repeated field. `size` is at least
/// message.min_payload; a list that promises more elements than there are has the existing ones. Needs the GIL.
nb::dict decode_fields(const MessageTable& message, const std::uint8_t* payload, std::size_t size);

/// Return a sentence for each field rule that the payload breaks (not finite, out of range, unknown enumerator or flag,
/// more elements promised than there are). Needs the GIL.
nb::list find_violations(const MessageTable& message, const std::uint8_t* payload, std::size_t size);

/// Return the payload for these values. Throws MessageError (wirebond.errors) that names the fact and the limit:
/// unknown or missing field, wrong type, out of range, not finite, too long. Needs the GIL.
std::vector<std::uint8_t> encode_fields(const MessageTable& message, nb::dict values);

/// Return the value of the field that begins at walk.at(at), and move the walk past it. Needs the GIL.
nb::object decode_field(const FieldTable& field, std::size_t at, std::uint64_t promised, Walk& walk);

}  // namespace wirebond::engine
