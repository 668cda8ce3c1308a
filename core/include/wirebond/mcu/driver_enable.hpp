// RS-485: a port whose transceiver's driver is switched by a pin. It knows no register and no link.
#pragma once

#include <cstddef>
#include <cstdint>
#include <type_traits>
#include <utility>

namespace wirebond {

namespace detail {

/// Does this port want to know when nothing is left to send? By `void line_free()`, in the UART's interrupt: the last
/// run has left, and none follows it.
template <class Port, class = void>
struct WantsFreeLine : std::false_type {};
template <class Port>
struct WantsFreeLine<Port, std::void_t<decltype(std::declval<Port&>().line_free())>> : std::true_type {};

/// A port says by a constant `completes_early` that it tells of a run's end while the last bytes are still in its UART.
template <class Port, class = void>
struct CompletesEarly : std::false_type {};
template <class Port>
struct CompletesEarly<Port, std::enable_if_t<Port::completes_early>> : std::true_type {};

/// A port that can only wait until its last bit has left: `void wait_until_sent()`.
template <class Port>
auto wait_until_sent(Port& port, int) -> decltype(port.wait_until_sent()) {
  port.wait_until_sent();
}
template <class Port>
void wait_until_sent(Port&, long) {}

}  // namespace detail

/// `drive(true)` is called before the first byte of a run, `drive(false)` when the last stop bit has left and no run
/// follows, both in the UART's interrupt or what stands for it:
///     void drive(bool on) { HAL_GPIO_WritePin(RS485_DE_GPIO_Port, RS485_DE_Pin, on ? GPIO_PIN_SET : GPIO_PIN_RESET); }
///     wirebond::DriverEnable<wirebond::stm32_hal::Uart, drive> uart(huart3, USART3_IRQn);
/// Before the link's first poll the pin is your project's: let it begin as low. The port's other functions stay as they
/// are.
template <class Port, void (*drive)(bool on)>
class DriverEnable : public Port {
  static_assert(
      !detail::CompletesEarly<Port>::value,
      "this port tells of a run's end before its last bit has left; use a UART that switches the driver itself");

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
