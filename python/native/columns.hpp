// Converts a whole capture to numpy columns, without a Python object per message.
#pragma once

#include <nanobind/nanobind.h>

#include <cstddef>
#include <cstdint>
#include <memory>
#include <utility>
#include <vector>

#include "wirebond/engine/capture.hpp"
#include "wirebond/engine/protocol.hpp"

namespace wirebond::engine {

namespace nb = nanobind;

/// Return the tables of the found messages, by name: "messages" as below. Takes the rows, and leaves the rest of the
/// capture. `with_empty`: also tables of messages that did not occur.
nb::dict message_tables(const ProtocolTable& protocol, const FormatTable& format, Capture&& capture,
                        bool with_empty = false);

/// Events between the reads of a capture.
struct TimingMarks {
  std::vector<std::size_t> breaks;                             ///< the port was closed before the read of this index
  std::vector<std::pair<std::size_t, std::int16_t>> expected;  ///< before this read, this message was requested
};

/// Read `breaks` and `expected` of `reads`.
TimingMarks read_marks(const nb::dict& reads);

/// Throw if the ends of the reads fall, or are after the bytes.
void check_reads(const std::uint64_t* ends, std::size_t count, std::size_t size);

/// Return {"messages": {name: {"offset": u64 array, "fields": {field: array}}}, "stats": {…}}. Messages that did not
/// occur are skipped. Scaled fields are float64 in SI units; others keep their wire type; arrays have shape (rows,
/// count); fields of structures have dotted names; strings, groups and arrays of varying size are lists of values.
/// Frames with an unknown id are under "unknown": offset and id. `threads` share a large capture;
/// `progress(done, size)` is called from time to time and at the end, unless it is None or the capture is small.
nb::dict decode_columns(const std::shared_ptr<const ProtocolTable>& protocol,
                        const std::shared_ptr<const FormatTable>& format, nb::handle capture, unsigned threads,
                        nb::handle progress);

/// Do the same for bytes that came read by read; each table has `t`: start of the read that completed the frame.
/// `reads`: `ends` (u64 each, in the capture) and `times` (f64, seconds, not falling) as buffers, `idle` in seconds,
/// `breaks` (the port was closed before the read of this index), `expected` (before the read of this index, this
/// message was requested). One thread works.
nb::dict decode_timed_columns(const std::shared_ptr<const ProtocolTable>& protocol,
                              const std::shared_ptr<const FormatTable>& format, nb::handle capture,
                              const nb::dict& reads, nb::handle progress);

}  // namespace wirebond::engine
