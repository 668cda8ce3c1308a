// From the receive ring to the receiver, by `poll`; and reception that begins again, by the UART's interrupt. A part of
// link.hpp.
#pragma once

#include "wirebond/mcu/link.hpp"

namespace wirebond {

template <class Protocol, class Handler, class Port, class Memory>
inline void Link<Protocol, Handler, Port, Memory>::receive(std::uint32_t before_us, std::uint32_t now_us) {
  const bool is_late = age_.is_late(before_us, now_us, fill_us);
  if (!ring_.look([this] { return port_.receive_position(); }))
    return;  // on another core, the UART's interrupt restarts
  static_assert(detail::has_ons_of_right_end<Handler, Receives>);
  Inbox inbox{*this};
  const std::uint32_t frames = heard_frames();
  const ReceiveRing::Count read = ring_.position();
  if (is_late && !detail::tells_every_lap(port_, 0)) {
    ring_.drop_unread();
    receiver_.give_up(now_us, inbox, deadlines_);
  }
  ReceiveRing::Span span = ring_.next();
  [[maybe_unused]] std::uint32_t fed = 0;
  if constexpr (Protocol::echoes) {
    fed = receiver_.bytes();
  } else {
    if (span.size == 0) receiver_.idle(now_us, inbox, deadlines_);
  }
  for (; span.size != 0; span = ring_.next()) {
    Aged bytes = age_.first(ring_.position(), span.size, before_us, now_us);
    if constexpr (Age::is_stamped) {
      // An event may be newer than `now_us`, which was read before the call.
      if (bytes.came_us - before_us > now_us - before_us) bytes.came_us = now_us;
      strike(bytes.came_us, now_us);  // by the silence before these bytes
      // An idle event comes a byte's time after the last byte; half and full come at once.
      const std::size_t end = ring_.place() + bytes.size;
      const bool is_idle = bytes.ends_at_event && end % (memory_.receive.size() / 2) != 0;
      age_.note_came(bytes.until_us - (is_idle ? byte_us : 0));
    }
    if constexpr (Protocol::echoes) {
      echo().hear(span.data, bytes.size, [&](const std::uint8_t* data, std::size_t size) {
        receiver_.feed(data, size, bytes.came_us, now_us, inbox, deadlines_);
        if constexpr (keeps_pause) receiver_.last_came_at(bytes.until_us);
      });
    } else {
      receiver_.feed(span.data, bytes.size, bytes.came_us, now_us, inbox, deadlines_);
      if constexpr (keeps_pause) receiver_.last_came_at(bytes.until_us);
    }
    ring_.consumed(bytes.size);
  }
  if constexpr (Protocol::echoes) end_hearing(fed, now_us, inbox);
  if (ring_.position() != read) line_moved_us_ = now_us;
  detail::read_to(port_, ring_.place(), 0);
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
    receiver_.feed(data, size, came_us, came_us, inbox, deadlines_);
  });
  if (receiver_.bytes() == fed && !echo().holds()) receiver_.idle(now_us, inbox, deadlines_);
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
  if (port_.receiving() && !ring_.is_all_read()) {  // the line is not silent: bytes came since poll found it so
    handshake_.restarted();
    return;
  }
  handshake_.ask_restart();  // until it is done: poll reads what is left, and asks again
  if (!ring_.is_all_read()) return;
  ring_.begin_restart();
  // A byte that DMA takes from here on until the port has stopped it is lost and cannot be counted.
  if (port_.start_receive(memory_.receive.data(), memory_.receive.size())) {
    ring_.restart();
    receive_restarts_ += 1;
    handshake_.restarted();
  }
  ring_.end_restart();
}

}  // namespace wirebond
