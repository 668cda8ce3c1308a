// Which memory the DMA of a UART cannot reach, by STM32 family. Addresses only.
#pragma once

#include <cstddef>
#include <cstdint>

namespace wirebond::stm32_hal {

enum class Family : std::uint8_t {
  f4,  ///< F3 too
  g4,
  h7,
  other,  ///< no memory is refused
};

/// The family that the vendor's headers are for.
#if defined(STM32F4) || defined(STM32F3)
inline constexpr Family family = Family::f4;
#elif defined(STM32G4)
inline constexpr Family family = Family::g4;
#elif defined(STM32H7)
inline constexpr Family family = Family::h7;
#else
inline constexpr Family family = Family::other;
#endif

/// Can DMA1 and DMA2 of this family reach all of `address .. address + size - 1`?
constexpr bool dma_reaches(Family which, std::uintptr_t address, std::size_t size) {
  const auto apart_from = [address, size](std::uintptr_t first, std::size_t length) {
    return address + size <= first || first + length <= address;
  };
  switch (which) {
    case Family::f4:  // the core-coupled memory hangs on the core's data bus alone (RM0090, 2.1)
      return apart_from(0x1000'0000, 0x1'0000);
    case Family::g4:  // DMA finds the core-coupled memory at its second address, behind SRAM2 (RM0440, 2.4)
      return apart_from(0x1000'0000, 0x8000);
    case Family::h7:  // the tightly coupled memories are for the core and MDMA (RM0433, 2.1)
      return apart_from(0, 0x1'0000) && apart_from(0x2000'0000, 0x2'0000);
    case Family::other: break;
  }
  return true;
}

}  // namespace wirebond::stm32_hal
