// Where on the line the frame ends that an MCU's handler has.
#pragma once

#include <cstdint>
#include <functional>

namespace soak {

/// Bytes that are settled, and those that never reached the deframer, modulo 2^32. In a handler: up to its frame's end.
template <class McuLink>
std::uint32_t place_of(const McuLink& link) {
  const auto ring = link.receive_account();
  return link.receiver().account().settled() + ring.lapped + ring.dropped;
}

/// The same since the start, as long as it is asked within 2^32 bytes.
class ReceivedPlace {
 public:
  std::function<std::uint32_t()> look;

  std::uint64_t operator()() {
    place_ += static_cast<std::uint32_t>(look() - static_cast<std::uint32_t>(place_));
    return place_;
  }

 private:
  std::uint64_t place_ = 0;
};

}  // namespace soak
