// States of a link, and its counters besides frames and bytes. Plain data.
#pragma once

#include <cstdint>

namespace wirebond {

/// State of a link.
enum class LinkState : std::uint8_t {
  down,   ///< not started, its buffers are unreachable, or its port reports that no program reads: nothing moves
  stale,  ///< running, but no valid frame came for `timeout_us`
  up,     ///< valid frames come
};

/// Events of the line, the port and the polls, modulo 2^32.
struct LinkCounters {
  std::uint32_t line_errors = 0;        ///< error events, and queries of the UART's status that found an error
  std::uint32_t framing_errors = 0;     ///< queries that found this kind; 0 if the port does not query
  std::uint32_t noise_errors = 0;       ///< see framing_errors
  std::uint32_t overruns = 0;           ///< see framing_errors
  std::uint32_t parity_errors = 0;      ///< see framing_errors
  std::uint32_t receive_restarts = 0;   ///< of reception: after an error, after silence or because it had stopped
  std::uint32_t reception_stops = 0;    ///< of these, reception that had ended without an error event
  std::uint32_t transmit_retries = 0;   ///< the port did not take a run: busy, or an error
  std::uint32_t transmit_timeouts = 0;  ///< a run did not leave in time, and was aborted
  std::uint32_t slow_polls = 0;         ///< polls more than half the shortest deadline at this end after the one before
  std::uint32_t nested_polls = 0;       ///< polls that found the UART's interrupt or another poll running, and returned
  std::uint32_t unserved_pends = 0;     ///< polls that found their last pend unserved, and pended again
  std::uint32_t late = 0;               ///< messages as old as their shortest deadline at this end when they were found
  std::uint32_t held_back = 0;          ///< messages held back by a deadline with `recover: explicit`
  std::uint32_t foreign = 0;            ///< frames for another address or, at a host, from one that was not asked
  std::uint32_t unlisted = 0;           ///< frames of messages not in the file, where checks count a seed; otherwise 0
  std::uint32_t echoed = 0;       ///< own bytes that were heard back and dropped, if the file says `echo`; otherwise 0
  std::uint32_t collisions = 0;   ///< runs that were not heard back as they were sent, if the file says `echo`
  std::uint32_t clock_steps = 0;  ///< polls whose time was before that of the poll before
  std::uint32_t own_frames = 0;   ///< own frames that came back, or frames equal to them, if the file has no `echo`
};

}  // namespace wirebond
