// Ports whose other end may be away: what such a port answers, and a port that a program stops and starts. No link.
#pragma once

#include <cstddef>
#include <type_traits>
#include <utility>

namespace wirebond {

namespace detail {

/// Does this port say whether anybody reads? By `bool connected() const`, for `poll`. False: no program has the port
/// open, a cable is off. Then the link is down, and what waits expires.
template <class Port, class = void>
struct TellsConnection : std::false_type {};
template <class Port>
struct TellsConnection<Port, std::void_t<decltype(std::declval<const Port&>().connected())>> : std::true_type {};

template <class Port>
bool connected(const Port& port) {
  if constexpr (TellsConnection<Port>::value) {
    return port.connected();
  } else {
    return true;
  }
}

/// A port may end reception when its link goes down: `void stop_receive()`, by the UART's interrupt.
template <class Port>
auto stop_receive(Port& port, int) -> decltype(port.stop_receive()) {
  port.stop_receive();
}
template <class Port>
void stop_receive(Port&, long) {}

/// May a run take as long as the other end likes? A port says so by a constant `may_wait`; else it is broken off after
/// twice its time.
template <class Port, class = void>
struct MayWait : std::false_type {};
template <class Port>
struct MayWait<Port, std::enable_if_t<Port::may_wait>> : std::true_type {};

/// A port that can make its sender wait wants to know how much room there is: `void read_to(std::size_t place)` says
/// after each poll that all before this place of the ring is read.
template <class Port>
auto read_to(Port& port, std::size_t place, int) -> decltype(port.read_to(place)) {
  port.read_to(place);
}
template <class Port>
void read_to(Port&, std::size_t, long) {}

}  // namespace detail

/// A port that your program can stop and start again, to set up its UART in another way or to sleep:
///     wirebond::Stoppable<wirebond::stm32_hal::Uart> uart(huart3, USART3_IRQn);
/// After `stop` the next `poll` takes the link down: a run that is under way is broken off, what waits expires, and
/// `send` answers `link_down`. Deadlines strike as ever. After `start` the next `poll` brings it back. The context of
/// `poll`. The port's other functions stay as they are.
template <class Port>
class Stoppable : public Port {
 public:
  using Port::Port;

  void stop() { runs_ = false; }
  void start() { runs_ = true; }

  bool connected() const { return runs_ && detail::connected(static_cast<const Port&>(*this)); }

 private:
  bool runs_ = true;
};

}  // namespace wirebond
