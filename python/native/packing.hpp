// Converts received messages to bytes for another process, and back. See docs/server.md for the layout.
#pragma once

#include <nanobind/nanobind.h>

#include <memory>

#include "decoder.hpp"

namespace wirebond::engine {

/// Return one record for each message, in their order.
nb::bytes pack_messages(nb::list messages);

/// Return the messages of such records, with `shift` seconds added to their times, and with this stamper. Throws
/// ValueError for a record that no engine with this protocol can have written.
nb::list unpack_messages(std::shared_ptr<const ProtocolTable> protocol, std::shared_ptr<const FormatTable> format,
                         nb::handle records, double shift, nb::object stamper);

}  // namespace wirebond::engine
