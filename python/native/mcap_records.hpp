// Message records of an MCAP file in bulk: where they lie, and making them. Knows no channel's meaning; trusts no
// length.
#pragma once

#include <nanobind/nanobind.h>

#include <cstddef>

namespace wirebond::engine {

namespace nb = nanobind;

/// The message records from `at` on, up to the first record that is another one or that is not whole before `end`; at
/// most a million. Returns where that is, and for each message, as buffers: channel (u16), log time and publish time
/// (u64, ns), where its data lie (u64) and how many bytes they are (u32).
nb::tuple message_records(nb::handle buffer, std::size_t at, std::size_t end);

/// The bytes at these places (u64 each) of these sizes (u32 each), one behind the other.
nb::bytes gathered(nb::handle buffer, nb::handle places, nb::handle sizes);

/// Message records, one behind the other. `pieces`: channels (u16), log times, publish times (u64, ns), places (u64)
/// and sizes (u32) of messages whose data lie in `buffer`. `decoded`: of further messages behind which of these each
/// comes (u32, not falling), channels, log times and publish times; their data are the `payloads`, a list of bytes.
/// Returns the records, and for each its place in them (u64), channel (u16) and log time (u64).
nb::tuple packed_records(nb::handle buffer, nb::tuple pieces, nb::tuple decoded, nb::list payloads);

}  // namespace wirebond::engine
