// Ports whose other end may be absent: how such a port reports that, and a port that a program stops and starts. No
// link.
#pragma once

#include <cstddef>
#include <type_traits>
#include <utility>

namespace wirebond {

namespace detail {

/// Whether this port reports if a program reads, with `bool connected() const`, for `poll`. Returns false if no program
/// has the port open or a cable is unplugged: then the link is down, and waiting frames expire.
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

/// End reception when the link goes down, if the port has `void stop_receive()`. The UART's interrupt.
template <class Port>
auto stop_receive(Port& port, int) -> decltype(port.stop_receive()) {
  port.stop_receive();
}
template <class Port>
void stop_receive(Port&, long) {}

/// Whether a run may take as long as the other end likes. A port declares it with a constant `may_wait`; otherwise a
/// run is aborted after twice its time.
template <class Port, class = void>
struct MayWait : std::false_type {};
template <class Port>
struct MayWait<Port, std::enable_if_t<Port::may_wait>> : std::true_type {};

/// Report that all bytes before this place of the ring are read, after each poll, if the port has
/// `void read_to(std::size_t place)`: it can then make its sender wait.
template <class Port>
auto read_to(Port& port, std::size_t place, int) -> decltype(port.read_to(place)) {
  port.read_to(place);
}
template <class Port>
void read_to(Port&, std::size_t, long) {}

}  // namespace detail

/// A port that your program can stop and start again, to set up its UART in another way or to sleep:
///     wirebond::Stoppable<wirebond::stm32_hal::Uart> uart(huart3, USART3_IRQn);
/// After `stop` the next `poll` takes the link down: the current run is aborted, waiting frames expire, and `send`
/// returns `link_down`. Deadlines still strike. After `start` the next `poll` brings it back. Call both in the context
/// of `poll`. The port's other functions are unchanged.
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
