// How a simulated UART behaves, what interrupts it raises, and what it counts. Plain data.
#pragma once

#include <cstddef>
#include <cstdint>

#include "wirebond/fake/line.hpp"

namespace wirebond::fake {

/// What an interrupt may be raised for. All have one priority: none interrupts another.
enum class Event : std::uint8_t {
  half,
  full,
  idle,
  transmitted,
  line_error,  ///< framing, noise, overrun
  dma_error,   ///< of a run that died; the vendor's handler gives reception up as well
  pended,
};
inline constexpr std::size_t events = 7;

/// What becomes of a line error.
enum class OnLineError : std::uint8_t {
  stop,  ///< its interrupt ends reception, as STM32's HAL does by itself
  tell,  ///< its interrupt tells of it, and DMA goes on
  flag,  ///< there is no interrupt: DMA goes on, and the status has it until somebody takes it (the ports)
};

/// How the UART behaves. As it stands: without a fault, and every interrupt is served at once. Chances are per million.
struct Behaviour {
  Time restart_gap = 0;      ///< from `start_transmit` to the first start bit; each run costs it
  Time interrupt_delay = 0;  ///< an interrupt is served so much later at most; each time another delay is drawn
  Time abort_time = 0;       ///< at most, from the error's interrupt to `on_error`, while DMA is being stopped
  bool circular = true;      ///< false: reception ends with a full or idle event, as the HAL's in normal mode
  OnLineError on_line_error = OnLineError::stop;
  bool keeps_damaged = true;           ///< DMA still moves the byte that has the error (F4); false: it does not (G4)
  std::uint32_t spurious = 0;          ///< for each byte: an idle event between two bytes without a pause
  std::uint32_t swallowed = 0;         ///< for each half, full or idle event: it never comes
  std::uint32_t receive_refused = 0;   ///< for each `start_receive`
  std::uint32_t transmit_refused = 0;  ///< for each `start_transmit`
  std::uint32_t transmit_dies = 0;     ///< for each byte sent: DMA stops with an error and no complete event comes
};

/// What the UART did, beside the fates that its lines keep.
struct UartCounts {
  std::uint64_t written = 0;           ///< bytes that DMA wrote into the ring
  std::uint64_t receive_starts = 0;    ///< `start_receive` that succeeded
  std::uint64_t receive_refused = 0;   ///< that did not
  std::uint64_t errors = 0;            ///< error events that were served
  std::uint64_t runs = 0;              ///< `start_transmit` that succeeded
  std::uint64_t transmit_refused = 0;  ///< that did not
  std::uint64_t taken = 0;             ///< bytes of those runs: on the line + broken off + waiting
  std::uint64_t broken_off = 0;        ///< never put on the line: the run was stopped, or died
  std::uint64_t runs_completed = 0;    ///< complete events that were served
};

}  // namespace wirebond::fake
