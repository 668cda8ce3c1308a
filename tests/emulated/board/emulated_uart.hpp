// The emulated USART as a port of Wirebond. No protocol, no task.
#pragma once

#include <cstddef>
#include <cstdint>

#include "software_dma.hpp"

namespace board {

/// The functions are those that `wirebond::Link` asks of a port; what their words mean is written there.
class EmulatedUart {
 public:
  static constexpr bool tells_every_lap = true;  ///< an interrupt moves each byte: none is lapped unseen

  explicit EmulatedUart(SoftwareDma& dma) : dma_(dma) {}

  bool start_receive(std::uint8_t* ring, std::size_t size) {
    if (!dma_.settings.has_receive) return false;
    dma_.start_receive(ring, size);
    return true;
  }
  bool receiving() const { return dma_.receiving(); }
  std::size_t receive_position() const { return dma_.receive_position(); }
  bool start_transmit(const std::uint8_t* bytes, std::size_t size) {
    return dma_.settings.has_transmit && dma_.start_transmit(bytes, size);
  }
  void stop_transmit() { dma_.stop_transmit(); }
  void pend() { dma_.raise(Events::pended); }

  /// The first 112 KiB of RAM; an STM32F405's DMA does not reach its core-coupled memory.
  bool reaches(const void* bytes, std::size_t size) const {
    constexpr std::uintptr_t begin = 0x20000000;
    constexpr std::uintptr_t end = begin + 112 * 1024;
    const auto first = reinterpret_cast<std::uintptr_t>(bytes);
    return first >= begin && first <= end && size <= end - first;
  }

 private:
  SoftwareDma& dma_;
};

}  // namespace board
