// Why a link does not work: the reasons of `Link::why`, in their order. A part of link.hpp.
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
  if (reception_stops_.load(std::memory_order_relaxed) != stops_in_silence_) return Why::reception_stops;
  if (!port_.receiving() && !handshake_.look().restart()) return Why::reception_stops;
  const bool is_stuck = transmit_timeouts_ != 0 || transmit_retries_ >= retries_when_stuck;
  if (is_stuck && send_account().sent == 0) return Why::runs_not_completed;
  if (echo().collisions() != 0 && echo().echoed() == 0) return Why::no_echo;
  if (time_.is_too_slow() || Reference::differs()) return Why::wrong_time_base;
  if (OwnCount::hears_itself(send_account().sent)) return Why::hears_itself;
  const bool heard = heard_frames() != 0;
  if (is_starved_ && (!heard || state() == LinkState::stale)) return Why::polled_too_seldom;
  if (!heard && (receiver_.bytes() != 0 || line_errors_ != 0)) return Why::nothing_understood;
  if (!heard || state() == LinkState::stale) return Why::nothing_heard;
  if (Protocol::holds_back_strangers && peer_ == Peer::different) return Why::protocol_differs;
  const ReceiveAccount received = receive_account();
  if (line_errors_ > received.received / bytes_per_error) return Why::many_line_errors;
  if constexpr (Protocol::echoes) {
    if (echo().collisions() > send_account().sent / frames_per_collision) return Why::many_collisions;
  }
  const bool knows_age = Age::is_stamped && detail::clock_runs(port_, 0);
  if (slow_polls_ != 0 && !knows_age) return Why::slow_without_clock;
  if (received.laps != 0 || received.laps_unknown != 0) return Why::polled_too_seldom;
  if (time_.steps() != 0) return Why::clock_steps_back;
  return setup;
}

}  // namespace wirebond
