// When a link has work, and its reactions to time: silence, retries, runs that do not end. A part of link.hpp.
#pragma once

#include "wirebond/mcu/link.hpp"

namespace wirebond {

template <class Protocol, class Handler, class Port, class Memory>
inline std::uint32_t Link<Protocol, Handler, Port, Memory>::next_due_us(std::uint32_t given_us) const {
  const std::uint32_t now_us = time_.own(given_us);
  constexpr std::uint32_t longest_sleep_us = 100'000;
  constexpr std::uint32_t retry_us = 1'000;
  std::uint32_t left_us = schedule_.template time_left<Handler, Link>(now_us, longest_sleep_us);
  const auto within = [&](std::uint32_t limit_us) { left_us = limit_us < left_us ? limit_us : left_us; };
  within(deadlines_.time_left(now_us));
  const bool sees_stalls = (Age::is_stamped && detail::clock_runs(port_, 0)) || detail::tells_every_lap(port_, 0);
  if (!sees_stalls) within(fill_us / 2);  // a later poll would drop bytes
  if (state() == LinkState::down || keeps_pause) within(retry_us);
  const auto line = handshake_.look();
  if (line.asks() || line.begun()) within(retry_us);  // asked again, or measured from then on
  if (!detail::MayWait<Port>::value && line.line() == Line::sending)
    within(time_left(begun_us_, transmit_timeout_us, now_us));
  if (receiver_.pending() != 0) within(Receives::idle_us / 2);
  if constexpr (Protocol::echoes) {
    if (echo().waits()) within(time_left(echo().quiet_since_us(), echo_timeout_us, now_us));
  }
  within(time_left(line_moved_us_, timeout_us, now_us));
  if (state() == LinkState::up) within(time_left(heard_us_, timeout_us, now_us));
  return given_us + left_us;
}

template <class Protocol, class Handler, class Port, class Memory>
inline void Link<Protocol, Handler, Port, Memory>::supervise(std::uint32_t now_us) {
  if (state() == LinkState::up && now_us - heard_us_ >= timeout_us) change(LinkState::stale);
  const auto line = handshake_.look();
  const bool is_silent = now_us - line_moved_us_ >= timeout_us;
  const bool runs = port_.receiving();
  const bool restarts = is_silent || !runs;  // a UART or its DMA may hang; or reception ended, with or without an error
  bool asks = line.asks() || restarts;
  if (is_silent) {
    line_moved_us_ = now_us;
    is_starved_ = false;
    if (runs) stops_in_silence_ = reception_stops_.load(std::memory_order_relaxed);
  }
  count_unserved(line.asks() && line.reminded());
  if (restarts || line.begun()) handshake_.note(restarts);
  if (detail::MayWait<Port>::value || line.begun() || line.line() != Line::sending) {
    begun_us_ = now_us;
  } else if (now_us - begun_us_ >= transmit_timeout_us) {
    begun_us_ = now_us;
    if (handshake_.ask_abort()) asks = true;
  }
  if (!asks) return;
  handshake_.remind();
  port_.pend();
}

template <class Protocol, class Handler, class Port, class Memory>
inline void Link<Protocol, Handler, Port, Memory>::count_unserved(bool is_unserved) {
  unserved_pends_ += is_unserved ? 1 : 0;
  if (!is_unserved) {
    unserved_in_row_ = 0;
  } else if (unserved_in_row_ != 0xFF) {
    ++unserved_in_row_;
  }
}

}  // namespace wirebond
