// RS-485: a port with a pin that switches the transceiver's driver. It knows no register and no link.
#pragma once

#include <cstddef>
#include <cstdint>
#include <type_traits>
#include <utility>

namespace wirebond {

namespace detail {

/// Whether this port is notified when nothing is left to send, with `void line_free()`, in the UART's interrupt: the
/// last run has left, and none follows it.
template <class Port, class = void>
struct WantsFreeLine : std::false_type {};
template <class Port>
struct WantsFreeLine<Port, std::void_t<decltype(std::declval<Port&>().line_free())>> : std::true_type {};

/// Whether the port reports a run's end while the last bytes are still in its UART: a constant `completes_early`.
template <class Port, class = void>
struct CompletesEarly : std::false_type {};
template <class Port>
struct CompletesEarly<Port, std::enable_if_t<Port::completes_early>> : std::true_type {};

/// Wait until the last bit has left, if the port has `void wait_until_sent()` because it has no event for that.
template <class Port>
auto wait_until_sent(Port& port, int) -> decltype(port.wait_until_sent()) {
  port.wait_until_sent();
}
template <class Port>
void wait_until_sent(Port&, long) {}

}  // namespace detail

/// Calls `drive(true)` before the first byte of a run, and `drive(false)` when the last stop bit has left and no run
/// follows, both in the UART's interrupt or its replacement:
///     void drive(bool on) { HAL_GPIO_WritePin(RS485_DE_GPIO_Port, RS485_DE_Pin, on ? GPIO_PIN_SET : GPIO_PIN_RESET); }
///     wirebond::DriverEnable<wirebond::stm32_hal::Uart, drive> uart(huart3, USART3_IRQn);
/// Before the link's first poll your project owns the pin: set it low. The port's other functions are unchanged.
template <class Port, void (*drive)(bool on)>
class DriverEnable : public Port {
  static_assert(
      !detail::CompletesEarly<Port>::value,
      "this port reports the end of a run before its last bit has left; use a UART that switches the driver itself");

 public:
  using Port::Port;

  bool start_transmit(const std::uint8_t* bytes, std::size_t size) {
    drive(true);
    if (Port::start_transmit(bytes, size)) return true;
    drive(false);
    return false;
  }

  void line_free() {
    detail::wait_until_sent(static_cast<Port&>(*this), 0);
    drive(false);
  }
};

}  // namespace wirebond
