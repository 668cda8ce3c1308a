// Received messages as bytes for another process, and back. docs/server.md has the layout.
#pragma once

#include <nanobind/nanobind.h>

#include <memory>

#include "decoder.hpp"

namespace wirebond::engine {

/// One record for each message, in their order.
nb::bytes pack_messages(nb::list messages);

/// The messages of such records, with `shift` seconds added to their times, and with this stamper. A record that no
/// engine with this protocol can have written is a ValueError.
nb::list unpack_messages(std::shared_ptr<const ProtocolTable> protocol, std::shared_ptr<const FormatTable> format,
                         nb::handle records, double shift, nb::object stamper);

}  // namespace wirebond::engine
