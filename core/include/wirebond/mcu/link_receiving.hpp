// Moves bytes from the receive ring to the receiver, in `poll`; restarts reception, in the UART's interrupt. A part of
// link.hpp.
#pragma once

#include "wirebond/mcu/link.hpp"

namespace wirebond {

template <class Protocol, class Handler, class Port, class Memory>
inline void Link<Protocol, Handler, Port, Memory>::receive(std::uint32_t before_us, std::uint32_t now_us) {
  const bool is_late = age_.is_late(before_us, now_us, fill_us);
  if (!ring_.look([this] { return port_.receive_position(); }))
    return;  // on another core, the UART's interrupt is restarting
  if (!detail::is_unpaced(port_, 0)) time_.came(ring_.unread(), now_us - before_us, half_byte_256);
  static_assert(detail::has_ons_of_right_end<Handler, Receives>);
  Inbox inbox{*this};
  const std::uint32_t frames = heard_frames();
  const ReceiveRing::Count read = ring_.position();
  const ReceiveRing::Count lost = ring_.lost();
  if (is_late && !detail::tells_every_lap(port_, 0)) {
    ring_.drop_unread();
    receiver_.give_up(now_us, inbox, inbox);
  }
  ReceiveRing::Span span = ring_.next();
  [[maybe_unused]] std::uint32_t fed = 0;
  if constexpr (Protocol::echoes) {
    fed = receiver_.bytes();
  } else {
    if (span.size == 0) receiver_.idle(now_us, inbox, inbox);
  }
  for (; span.size != 0; span = ring_.next()) {
    Aged bytes = age_.first(ring_.position(), span.size, before_us, now_us);
    if constexpr (Age::is_stamped) {
      // An event may be newer than `now_us`, which was read before the call.
      if (bytes.came_us - before_us > now_us - before_us) bytes.came_us = now_us;
      strike(bytes.came_us, now_us);  // for the silence before these bytes
      // An idle event comes one byte time after the last byte; half and full events come at once.
      const std::size_t end = ring_.place() + bytes.size;
      const bool is_idle = bytes.ends_at_event && end % (memory_.receive.size() / 2) != 0;
      age_.note_came(bytes.until_us - (is_idle ? byte_us : 0));
    }
    if constexpr (Protocol::echoes) {
      echo().hear(span.data, bytes.size, [&](const std::uint8_t* data, std::size_t size) {
        receiver_.feed(data, size, bytes.came_us, now_us, inbox, inbox);
        if constexpr (keeps_pause) receiver_.last_came_at(bytes.until_us);
      });
    } else {
      receiver_.feed(span.data, bytes.size, bytes.came_us, now_us, inbox, inbox);
      if constexpr (keeps_pause) receiver_.last_came_at(bytes.until_us);
    }
    ring_.consumed(bytes.size);
  }
  if constexpr (Protocol::echoes) end_hearing(fed, now_us, inbox);
  if (ring_.position() != read) line_moved_us_ = now_us;
  detail::read_to(port_, ring_.place(), 0);
  if (ring_.lost() != lost) {
    is_starved_ = true;
  } else if (heard_frames() != frames) {
    is_starved_ = false;
  }
  if constexpr (remembers_own) {
    // If bytes may wait before the UART, own ones are heard later.
    const std::uint32_t keep_us = detail::tells_every_lap(port_, 0) ? echo_timeout_us : 0;
    OwnFrames::poll(now_us, handshake_.look().line() == Line::sending, keep_us);
  }
  if (heard_frames() != frames) {
    heard_us_ = now_us;
    change(LinkState::up);
  }
}

template <class Protocol, class Handler, class Port, class Memory>
inline void Link<Protocol, Handler, Port, Memory>::end_hearing(std::uint32_t fed, std::uint32_t now_us, Inbox& inbox) {
  const bool sends = handshake_.look().line() == Line::sending;
  echo().poll(now_us, sends, echo_timeout_us, [&](const std::uint8_t* data, std::size_t size) {
    const std::uint32_t came_us = echo().quiet_since_us();  // held back since then
    receiver_.feed(data, size, came_us, came_us, inbox, inbox);
  });
  if (receiver_.bytes() == fed && !echo().holds()) receiver_.idle(now_us, inbox, inbox);
}

template <class Protocol, class Handler, class Port, class Memory>
inline void Link<Protocol, Handler, Port, Memory>::look_for_errors() {
  if constexpr (detail::TellsLineErrors<Port>::value) {
    const LineErrors errors = port_.take_line_errors();
    if (!errors.any()) return;
    line_errors_ += 1;
    this->count(errors);
  }
}

template <class Protocol, class Handler, class Port, class Memory>
void Link<Protocol, Handler, Port, Memory>::restart_reception() {
  ring_.advance(port_.receive_position());
  const bool runs = port_.receiving();
  if (runs && !ring_.is_all_read()) {  // the line is not silent: bytes came after poll found it so
    handshake_.restarted();
    return;
  }
  handshake_.ask_restart();  // until it succeeds: poll reads the rest, and asks again
  if (!ring_.is_all_read()) return;
  ring_.begin_restart();
  // A byte that DMA takes from here until the port has stopped it is lost and cannot be counted.
  if (port_.start_receive(memory_.receive.data(), memory_.receive.size())) {
    ring_.restart();
    receive_restarts_ += 1;
    if (!runs && !error_ended_) {
      reception_stops_.store(reception_stops_.load(std::memory_order_relaxed) + 1, std::memory_order_relaxed);
    }
    error_ended_ = false;
    handshake_.restarted();
  }
  ring_.end_restart();
}

}  // namespace wirebond
