// How a link starts, and what it does while no program reads. A part of link.hpp.
#pragma once

#include "wirebond/mcu/link.hpp"

namespace wirebond {

template <class Protocol, class Handler, class Port, class Memory>
inline void Link<Protocol, Handler, Port, Memory>::start(std::uint32_t now_us) {
  if (!is_timed_) {  // silence counts from now on, even if the port does not work
    is_timed_ = true;
    deadlines_.start(now_us);
    schedule_.start(now_us);
  }
  if (!reaches_buffers()) return;
  if constexpr (may_leave) {
    if (waits_.load(std::memory_order_acquire)) return port_.pend();  // pairs with `clear_line`
    ring_.begin_again();
  }
  if constexpr (Protocol::echoes) echo().forget();
  handshake_.restarted();  // for old errors; one from now on counts
  if (!port_.start_receive(memory_.receive.data(), memory_.receive.size())) return;
  heard_us_ = line_moved_us_ = now_us;
  age_.start(now_us);
  this->start_age(now_us);
  change(LinkState::stale);
  if constexpr (!std::is_same_v<typename Protocol::Hello::Message, NoService>) {
    static_cast<void>(send(detail::hello<Protocol>()));
  }
}

template <class Protocol, class Handler, class Port, class Memory>
inline void Link<Protocol, Handler, Port, Memory>::leave(std::uint32_t now_us) {
  if (!is_timed_) {
    is_timed_ = true;
    deadlines_.start(now_us);
    schedule_.start(now_us);
  }
  if (state() != LinkState::down) {
    Inbox inbox{*this};
    if constexpr (Protocol::echoes) echo().forget();
    receiver_.give_up(now_us, inbox, inbox);
    peer_ = Peer::unknown;
    change(LinkState::down);
  }
  waits_.store(true, std::memory_order_release);  // pairs with `clear_line`
  port_.pend();
}

template <class Protocol, class Handler, class Port, class Memory>
inline void Link<Protocol, Handler, Port, Memory>::clear_line() {
  if (!waits_.load(std::memory_order_acquire)) return;  // pairs with `leave`
  if (handshake_.look().line() == Line::sending) port_.stop_transmit();
  if constexpr (detail::WantsFreeLine<Port>::value) port_.line_free();
  outbox_.aborted();
  outbox_.expire_all();
  handshake_.halt();
  detail::stop_receive(port_, 0);
  waits_.store(false, std::memory_order_release);  // pairs with `start`
}

}  // namespace wirebond
