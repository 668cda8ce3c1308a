// Results of functions on which a caller must act.
#pragma once

#include <cstdint>

namespace wirebond {

/// Result of an encode or a send. Only `ok` means that bytes were produced.
enum class [[nodiscard]] Status : std::uint8_t{
    ok,
    out_of_range,  ///< a field is outside its range, not finite, or does not fit its wire type
    too_small,     ///< the caller's buffer cannot hold the frame
    queue_full,    ///< the send queue is full now
    link_down,     ///< the link has not started, or its port does not work
};

}  // namespace wirebond
