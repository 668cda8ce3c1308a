// Which bytes of a frame are which value: for a person who reads it.
#pragma once

#include <cstddef>
#include <optional>
#include <string>
#include <vector>

#include "wirebond/engine/batch.hpp"

namespace wirebond::engine {

/// Bytes of a payload that are one value.
struct Span {
  std::string name;    ///< dotted: `joints[2].position`
  unsigned level = 0;  ///< 1: a field of the message; more: inside another one
  std::size_t at = 0;  ///< from the payload's first byte
  std::size_t size = 0;
};

/// Return the values of a frame's message, each before those inside it. Empty if the frame is of no known message.
std::vector<Span> spans_of(const Batch& batch, const Event& event);

/// Bytes on the wire, from the frame's first one.
struct Place {
  std::size_t at = 0;
  std::size_t size = 0;
};

/// Return where the payload is on the wire; nothing if the frame is stuffed.
std::optional<Place> payload_on_wire(const Batch& batch, const Event& event);

}  // namespace wirebond::engine
