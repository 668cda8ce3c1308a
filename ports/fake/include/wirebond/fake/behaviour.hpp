// Behaviour of a simulated UART, its interrupts, and its counts. Plain data.
#pragma once

#include <cstddef>
#include <cstdint>

#include "wirebond/fake/line.hpp"

namespace wirebond::fake {

/// Reasons for an interrupt. All have one priority: none interrupts another.
enum class Event : std::uint8_t {
  half,
  full,
  idle,
  transmitted,
  line_error,  ///< framing, noise, overrun
  dma_error,   ///< of a run that died; the vendor's handler ends reception as well
  pended,
};
inline constexpr std::size_t events = 7;

/// Effect of a line error.
enum class OnLineError : std::uint8_t {
  stop,  ///< its interrupt ends reception, as STM32's HAL does by itself
  tell,  ///< its interrupt reports it, and DMA continues
  flag,  ///< there is no interrupt: DMA continues, and the status keeps it until it is taken (the ports)
};

/// How the UART behaves. By default: without a fault, and every interrupt is served at once. Chances are per million.
struct Behaviour {
  Time restart_gap = 0;      ///< from `start_transmit` to the first start bit, for each run
  Time interrupt_delay = 0;  ///< maximum delay of an interrupt; each delay is drawn
  Time abort_time = 0;       ///< maximum, from the error's interrupt to `on_error`, while DMA is being stopped
  bool circular = true;      ///< false: reception ends with a full or idle event, as the HAL's in normal mode
  OnLineError on_line_error = OnLineError::stop;
  bool keeps_damaged = true;           ///< DMA still moves the damaged byte (F4); false: it does not (G4)
  std::uint32_t spurious = 0;          ///< for each byte: an idle event between two bytes without a pause
  std::uint32_t swallowed = 0;         ///< for each half, full or idle event: it never comes
  std::uint32_t receive_refused = 0;   ///< for each `start_receive`
  std::uint32_t transmit_refused = 0;  ///< for each `start_transmit`
  std::uint32_t transmit_dies = 0;     ///< for each byte sent: DMA stops with an error and no complete event comes
};

/// Counts of the UART, besides the fates that its lines keep.
struct UartCounts {
  std::uint64_t written = 0;           ///< bytes that DMA wrote into the ring
  std::uint64_t receive_starts = 0;    ///< `start_receive` that succeeded
  std::uint64_t receive_refused = 0;   ///< `start_receive` that failed
  std::uint64_t errors = 0;            ///< error events served
  std::uint64_t runs = 0;              ///< `start_transmit` that succeeded
  std::uint64_t transmit_refused = 0;  ///< `start_transmit` that failed
  std::uint64_t taken = 0;             ///< bytes of those runs: on the line + aborted + waiting
  std::uint64_t broken_off = 0;        ///< never put on the line: the run was stopped, or died
  std::uint64_t runs_completed = 0;    ///< complete events served
};

}  // namespace wirebond::fake
