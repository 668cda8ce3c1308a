// Payload bytes to Python values and back. Which frame carried them does not matter here.
#pragma once

#include <cstddef>
#include <cstdint>
#include <vector>

#include "protocol.hpp"

namespace wirebond::engine {

/// All fields as a dict of SI values. `size` is at least message.min_payload. Needs the GIL.
nb::dict decode_fields(const MessageTable& message, const std::uint8_t* payload, std::size_t size);

/// Field rules that the payload breaks (not finite, out of range, unknown enumerator or flag), a sentence each.
nb::list find_violations(const MessageTable& message, const std::uint8_t* payload, std::size_t size);

/// The payload for these values. Throws MessageError (wirebond.errors) that names the fact and the limit:
/// unknown or missing field, wrong type, out of range, not finite, too long. Needs the GIL.
std::vector<std::uint8_t> encode_fields(const MessageTable& message, nb::dict values);

/// Raise wirebond.errors.MessageError.
[[noreturn]] void throw_message_error(const std::string& text);

/// One element as it lies on the wire: sign-extended integer.
std::int64_t load_signed(const FieldTable& field, const std::uint8_t* at);

/// One element of a float field.
double load_float(const FieldTable& field, const std::uint8_t* at);

}  // namespace wirebond::engine
