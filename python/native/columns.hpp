// A whole capture to numpy columns, without a Python object per message.
#pragma once

#include <nanobind/nanobind.h>

#include <cstddef>
#include <cstdint>
#include <memory>
#include <utility>
#include <vector>

#include "capture.hpp"
#include "protocol.hpp"

namespace wirebond::engine {

/// The tables of what was found, by message: what "messages" is below. It takes the rows, and leaves what is beside
/// them. `with_empty`: also those of messages that did not occur.
nb::dict message_tables(const ProtocolTable& protocol, const FormatTable& format, Capture&& capture,
                        bool with_empty = false);

/// What happened between the reads of a capture.
struct TimingMarks {
  std::vector<std::size_t> breaks;                             ///< the port was away before the read of this index
  std::vector<std::pair<std::size_t, std::int16_t>> expected;  ///< before this read, this message was asked for
};

/// `breaks` and `expected` of `reads`.
TimingMarks read_marks(const nb::dict& reads);

/// Throws where the ends of the reads fall, or lie behind the bytes.
void check_reads(const std::uint64_t* ends, std::size_t count, std::size_t size);

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
