// How a link stands, and what it counts beside frames and bytes. Plain data.
#pragma once

#include <cstdint>

namespace wirebond {

/// How a link stands.
enum class LinkState : std::uint8_t {
  down,   ///< not started, its buffers are out of reach, or its port says that no program reads: nothing moves
  stale,  ///< it runs, and no valid frame came for `timeout_us`
  up,     ///< valid frames come
};

/// What happened to the line, the port and the polls, modulo 2^32.
struct LinkCounters {
  std::uint32_t line_errors = 0;        ///< error events, and looks at the UART's status that found an error
  std::uint32_t framing_errors = 0;     ///< of these looks, those that found this kind: 0 where the port does not look
  std::uint32_t noise_errors = 0;       ///< the same
  std::uint32_t overruns = 0;           ///< the same
  std::uint32_t parity_errors = 0;      ///< the same
  std::uint32_t receive_restarts = 0;   ///< reception was begun again, after an error or for silence
  std::uint32_t transmit_retries = 0;   ///< the port did not take a run: busy, or an error
  std::uint32_t transmit_timeouts = 0;  ///< a run did not leave in time, and was stopped
  std::uint32_t slow_polls = 0;         ///< more than half the shortest deadline at this end after the poll before
  std::uint32_t nested_polls = 0;       ///< polls that found the UART's interrupt at work, and returned at once
  std::uint32_t unserved_pends = 0;     ///< polls that found their last pend unserved, and pended again
  std::uint32_t late = 0;               ///< messages as old as their shortest deadline at this end when they were found
  std::uint32_t held_back = 0;          ///< messages held back by a deadline with `recover: explicit`
  std::uint32_t foreign = 0;            ///< frames for another address or, at a host, from one that was not asked
  std::uint32_t unlisted = 0;    ///< frames of messages that the file does not list, where checks count a seed: else 0
  std::uint32_t echoed = 0;      ///< own bytes that were heard back and dropped, where the file says `echo`: else 0
  std::uint32_t collisions = 0;  ///< runs that were not heard back as they were sent, where the file says `echo`
};

}  // namespace wirebond
