// The answers of functions that a caller must act on.
#pragma once

#include <cstdint>

namespace wirebond {

/// What became of an encode or a send. Only `ok` means that bytes were produced.
enum class [[nodiscard]] Status : std::uint8_t{
    ok,
    out_of_range,  ///< a field is outside its range, not finite, or does not fit its wire type
    too_small,     ///< the caller's buffer cannot hold the frame
    queue_full,    ///< no room in the send queue now
    link_down,     ///< the link has not started, or its port does not work
};

}  // namespace wirebond
