// Message records of an MCAP file in bulk: finds and makes them. Knows no channel's meaning; trusts no length.
#pragma once

#include <nanobind/nanobind.h>

#include <cstddef>

namespace wirebond::engine {

namespace nb = nanobind;

/// Find the message records from `at` on, up to the first record that is of another kind or incomplete before `end`; at
/// most a million. Returns where that is, and for each message, as buffers: channel (u16), log time and publish time
/// (u64, ns), place of its data (u64) and their size in bytes (u32).
nb::tuple message_records(nb::handle buffer, std::size_t at, std::size_t end);

/// Return the bytes at these places (u64 each) of these sizes (u32 each), one after the other.
nb::bytes gathered(nb::handle buffer, nb::handle places, nb::handle sizes);

/// Make message records, one after the other. `pieces`: channels (u16), log times, publish times (u64, ns), places
/// (u64) and sizes (u32) of messages whose data are in `buffer`. `decoded`: for further messages the index of the piece
/// that each follows (u32, not falling), channels, log times and publish times; their data are the `payloads`, a list
/// of bytes. Returns the records, and for each its place in them (u64), channel (u16) and log time (u64).
nb::tuple packed_records(nb::handle buffer, nb::tuple pieces, nb::tuple decoded, nb::list payloads);

}  // namespace wirebond::engine
