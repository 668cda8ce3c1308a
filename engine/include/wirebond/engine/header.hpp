// Converts the numbers of a frame outside its payload to values and back, and makes the frame around a payload.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <string>
#include <utility>
#include <vector>

#include "wirebond/engine/errors.hpp"
#include "wirebond/engine/fields.hpp"
#include "wirebond/engine/protocol.hpp"

namespace wirebond::engine {

/// A value for each header field of the format, as bits on the wire; `given`: those from the caller.
struct GivenHeader {
  std::array<std::uint64_t, max_header_fields> values{};
  std::uint32_t given = 0;

  HeaderValues view() const { return {values.data(), given}; }
};

/// Return the values that the sender's frames have by default.
GivenHeader default_header(const FormatTable& format);

/// Return the header fields of a received frame by name, with values like those of message fields. `bits` holds one
/// value for each field of the form.
template <class V>
typename V::Value decode_header(const FormatTable& format, std::size_t form, const std::uint64_t* bits) {
  const Form& shape = format.format().forms[form];
  auto out = V::make_map(shape.header_count);
  for (std::size_t i = 0; i < shape.header_count; ++i) {
    const FieldTable& field = format.header()[shape.header[i].place];
    V::set(out, field, decode_element<V>(field, bits[i]));
  }
  return V::made(std::move(out));
}

/// Add a sentence to `out` for each of these values that breaks a rule of its field.
void add_header_violations(const FormatTable& format, std::size_t form, const std::uint64_t* bits,
                           std::vector<std::string>& out);

/// Convert values by name to bits; others get the sender's defaults. Throws MessageError for an unknown name, and for a
/// value that its field does not allow.
template <class V>
GivenHeader encode_header(const FormatTable& format, typename V::Ref header) {
  GivenHeader out = default_header(format);
  static const std::string owner = "header";
  const Path whole{nullptr, owner};
  const std::vector<FieldTable>& fields = format.header();
  V::each_item(header, [&](typename V::Ref key, typename V::Ref value) {
    std::size_t place = 0;
    while (place < fields.size() && !V::is_name(fields[place], key)) ++place;
    if (place == fields.size()) {
      throw MessageError("the header has no field " + V::shown(key) + "; it has " +
                         (fields.empty() ? "none" : names_of(fields)));
    }
    out.values[place] = encode_element<V>(fields[place], value, Path{&whole, fields[place].name});
    out.given |= std::uint32_t{1} << place;
  });
  return out;
}

/// Return the wire bytes of the frame around a payload of message `index`, in the first form that the header values
/// allow and that can carry the message. `form`: in this one; -1: the first. Throws MessageError if there is none.
std::vector<std::uint8_t> seal_frame(const FormatTable& format, const ProtocolTable& protocol, std::size_t index,
                                     const std::vector<std::uint8_t>& payload, const GivenHeader& header,
                                     int form = -1);

}  // namespace wirebond::engine
