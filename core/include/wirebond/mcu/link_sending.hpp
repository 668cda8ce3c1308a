// Moves frames from the outbox to the port, in the UART's interrupt. A part of link.hpp.
#pragma once

#include "wirebond/mcu/link.hpp"

namespace wirebond {

template <class Protocol, class Handler, class Port, class Memory>
inline void Link<Protocol, Handler, Port, Memory>::abort_run() {
  port_.stop_transmit();
  outbox_.aborted();
  if constexpr (keeps_pause) begin_pause();
  transmit_timeouts_ += 1;
}

template <class Protocol, class Handler, class Port, class Memory>
inline void Link<Protocol, Handler, Port, Memory>::begin_pause() {
  if constexpr (detail::HasClock<Port>::value) {
    if (detail::clock_runs(port_, 0)) return pause().begin_at(time_.own(port_.now_us()));
  }
  pause().begin();
}

template <class Protocol, class Handler, class Port, class Memory>
inline Run Link<Protocol, Handler, Port, Memory>::next_run() {
  this->expire(outbox_);
  constexpr std::size_t most = keeps_pause ? 0 : Protocol::max_run_bytes;  // 0: one frame
  if constexpr (Numbers::has_numbers && remembers_own) {
    return outbox_.next(most, [this](std::uint8_t* waiting, std::size_t room, std::uint8_t message) {
      const std::size_t size = this->close(waiting, room, message);
      note_own(waiting, size, message);
      return size;
    });
  } else if constexpr (remembers_own) {
    return outbox_.next(most, [this](const std::uint8_t* frame, std::size_t size, std::uint8_t message) {
      note_own(frame, size, message);
    });
  } else if constexpr (Numbers::has_numbers) {
    return outbox_.next(most, [this](std::uint8_t* waiting, std::size_t room, std::uint8_t message) {
      return this->close(waiting, room, message);
    });
  } else {
    return outbox_.next(most);
  }
}

template <class Protocol, class Handler, class Port, class Memory>
inline void Link<Protocol, Handler, Port, Memory>::free_line() {
  if (handshake_.look().line() != Line::sending) port_.line_free();
}

template <class Protocol, class Handler, class Port, class Memory>
void Link<Protocol, Handler, Port, Memory>::send_next() {
  if constexpr (keeps_pause) {
    if (!pause().is_over()) return handshake_.refuse();  // `poll` pends again
  }
  Run run = next_run();
  while (run.size == 0) {
    if (handshake_.rest()) return;
    run = next_run();
  }
  handshake_.found();
  if constexpr (Protocol::echoes) {
    if (!echo().keep(run.data, run.size)) return handshake_.refuse();  // `poll` hears, and pends again
    if (port_.start_transmit(run.data, run.size)) return echo().sent();
    echo().refused();
  } else {
    if (port_.start_transmit(run.data, run.size)) return;
  }
  handshake_.refuse();
  transmit_retries_ += 1;
}

}  // namespace wirebond
