// A whole capture to numpy columns, without a Python object per message.
#pragma once

#include <nanobind/nanobind.h>

#include <memory>

#include "protocol.hpp"

namespace wirebond::engine {

/// {"messages": {name: {"offset": u64 array, "fields": {field: array}}}, "stats": {…}}. Messages that did not occur
/// are left out. Scaled fields are float64 in SI units; others keep their wire type; arrays have shape (rows, count);
/// fields of structures stand under dotted names; strings, groups and arrays of varying size are lists of values.
/// Frames with an unknown id are under "unknown": offset and id.
/// `threads` share a large capture; `progress(done, size)` is called now and then meanwhile and at the end, if
/// it is not None; a capture that is small is done before anybody wants to know.
nb::dict decode_columns(const std::shared_ptr<const ProtocolTable>& protocol,
                        const std::shared_ptr<const FormatTable>& format, nb::handle capture, unsigned threads,
                        nb::handle progress);

/// The same for bytes that came read by read, each table with `t`: when the read began that completed the frame.
/// `reads`: `ends` (u64 each, in the capture) and `times` (f64, seconds, not falling) as buffers, `idle` in seconds,
/// `breaks` (the port was away before the read of this index), `expected` (before the read of this index, this message
/// was asked for). One thread works.
nb::dict decode_timed_columns(const std::shared_ptr<const ProtocolTable>& protocol,
                              const std::shared_ptr<const FormatTable>& format, nb::handle capture,
                              const nb::dict& reads, nb::handle progress);

}  // namespace wirebond::engine
