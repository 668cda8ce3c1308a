// Converts the numbers of a frame outside its payload to Python values and back, and makes the frame around a payload.
#pragma once

#include <nanobind/nanobind.h>

#include <array>
#include <cstddef>
#include <cstdint>
#include <vector>

#include "protocol.hpp"

namespace wirebond::engine {

/// A value for each header field of the format, as bits on the wire; `given`: those from the caller.
struct GivenHeader {
  std::array<std::uint64_t, max_header_fields> values{};
  std::uint32_t given = 0;

  HeaderValues view() const { return {values.data(), given}; }
};

/// Return the header fields of a received frame by name, with values like those of message fields. `bits` holds one
/// value for each field of the form. Needs the GIL.
nb::dict header_dict(const FormatTable& format, std::size_t form, const std::uint64_t* bits);

/// Add a sentence to `out` for each of these values that breaks a rule of its field. Needs the GIL.
void add_header_violations(const FormatTable& format, std::size_t form, const std::uint64_t* bits, nb::list& out);

/// Convert values by name to bits; others get the sender's defaults. Throws MessageError for an unknown name, and for a
/// value that its field does not allow. Needs the GIL.
GivenHeader encode_header(const FormatTable& format, nb::dict header);

/// Return the wire bytes of the frame around a payload of message `index`, in the first form that the header values
/// allow and that can carry the message. `form`: in this one; -1: the first. Throws MessageError if there is none.
std::vector<std::uint8_t> seal_frame(const FormatTable& format, const ProtocolTable& protocol, std::size_t index,
                                     const std::vector<std::uint8_t>& payload, const GivenHeader& header,
                                     int form = -1);

}  // namespace wirebond::engine
