// The numbers of a frame that are no payload: to Python values and back, and the frame around a payload.
#pragma once

#include <nanobind/nanobind.h>

#include <array>
#include <cstddef>
#include <cstdint>
#include <vector>

#include "protocol.hpp"

namespace wirebond::engine {

/// A value for each header field of the format, as bits on the wire; `given` are those that the caller gave.
struct GivenHeader {
  std::array<std::uint64_t, max_header_fields> values{};
  std::uint32_t given = 0;

  HeaderValues view() const { return {values.data(), given}; }
};

/// The header fields of a received frame by name, as message fields give their values. `bits` holds one for each field
/// of the form. Needs the GIL.
nb::dict header_dict(const FormatTable& format, std::size_t form, const std::uint64_t* bits);

/// Add a sentence to `out` for each of these values that breaks a rule of its field. Needs the GIL.
void add_header_violations(const FormatTable& format, std::size_t form, const std::uint64_t* bits, nb::list& out);

/// Values by name to bits; the sender's defaults for all others. Throws MessageError for an unknown name, and for a
/// value that its field does not allow. Needs the GIL.
GivenHeader encode_header(const FormatTable& format, nb::dict header);

/// The frame around a payload of message `index`, in the first form that the header values allow and that can carry the
/// message: wire bytes. `form`: in this one; -1: the first. Throws MessageError when there is none.
std::vector<std::uint8_t> seal_frame(const FormatTable& format, const ProtocolTable& protocol, std::size_t index,
                                     const std::vector<std::uint8_t>& payload, const GivenHeader& header,
                                     int form = -1);

}  // namespace wirebond::engine
