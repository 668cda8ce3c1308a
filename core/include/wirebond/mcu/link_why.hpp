// What keeps a link from working: the reasons of `Link::why`, in their order. A part of link.hpp.
#pragma once

#include "wirebond/mcu/link.hpp"

namespace wirebond {

template <class Protocol, class Handler, class Port, class Memory>
inline Why Link<Protocol, Handler, Port, Memory>::why() const {
  if (!is_timed_) return Why::not_polled;
  if (!reaches_buffers()) return Why::buffers_unreachable;
  const Why setup = detail::check_port(port_, Protocol::baud, 0);
  if (setup != Why::nothing && setup != Why::tick_below_uart) return setup;
  if (!detail::connected(port_)) return Why::not_connected;
  if (state() == LinkState::down) return Why::port_refuses;
  if (unserved_in_row_ >= 2) return Why::pends_unserved;
  if (reception_stops_ || (!port_.receiving() && !handshake_.look().restart())) return Why::reception_stops;
  const bool is_stuck = transmit_timeouts_ != 0 || transmit_retries_ >= retries_when_stuck;
  if (is_stuck && send_account().sent == 0) return Why::runs_not_completed;
  if (echo().collisions() != 0 && echo().echoed() == 0) return Why::no_echo;
  const bool heard = heard_frames() != 0;
  if (!heard && (receiver_.bytes() != 0 || line_errors_ != 0)) return Why::nothing_understood;
  if (!heard || state() == LinkState::stale) return Why::nothing_heard;
  const ReceiveAccount received = receive_account();
  if (line_errors_ > received.received / bytes_per_error) return Why::many_line_errors;
  if constexpr (Protocol::echoes) {
    if (echo().collisions() > send_account().sent / frames_per_collision) return Why::many_collisions;
  }
  if (received.laps != 0 || received.laps_unknown != 0) return Why::polled_too_seldom;
  return setup;
}

}  // namespace wirebond
