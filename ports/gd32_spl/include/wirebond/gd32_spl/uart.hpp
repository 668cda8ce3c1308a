// A port: a USART of a GD32F30x or GD32F4xx through the vendor's standard peripheral library, with DMA in and out.
#pragma once

#if __has_include("gd32f30x.h")
#include "gd32f30x.h"
#elif __has_include("gd32f4xx.h")
#include "gd32f4xx.h"
#else
#error "neither gd32f30x.h nor gd32f4xx.h is on the include path"
#endif

#include <cstddef>
#include <cstdint>

#include "wirebond/mcu/dma_uart.h"
#include "wirebond/mcu/line_errors.hpp"
#include "wirebond/mcu/why.hpp"

namespace wirebond::gd32_spl {

/// Connections, by the names of the vendor's library.
struct Wiring {
  std::uint32_t usart;  ///< USART0
  std::uint32_t dma;    ///< DMA0
  dma_channel_enum receive_channel;
  dma_channel_enum transmit_channel;
  IRQn_Type interrupt;  ///< USART0_IRQn
};

/// Your project sets up clocks, pins, the USART (speed and format), and both channels by `dma_init` with the USART's
/// data register as their peripheral address, 8 bits wide: receive circular, transmit not. It enables the three
/// interrupts with one priority. The rest is done here; forward the three handlers:
///   USARTn_IRQHandler -> uart.usart_interrupt(link)       of the receive channel  -> uart.receive_interrupt(link)
///                                                         of the transmit channel -> uart.transmit_interrupt(link)
/// All functions except `pend` and `receive_position` are for these interrupts; Link calls them only there.
///
/// Line errors raise no interrupt: DMA continues, and the checks reject the frame. The USART's status shows the errors
/// since its last interrupt. The data register is read only at an idle event, while no byte comes: a read at any other
/// time could take a byte away from DMA.
class Uart {
 public:
  explicit Uart(const Wiring& wiring) : wiring_(wiring) {}

  static constexpr bool completes_early = true;  ///< see start_transmit

  bool start_receive(std::uint8_t* ring, std::size_t size) {
    if (!stop(wiring_.receive_channel)) return false;
    set_memory(wiring_.receive_channel, ring);
    dma_transfer_number_config(wiring_.dma, wiring_.receive_channel, static_cast<std::uint32_t>(size));
    dma_interrupt_enable(wiring_.dma, wiring_.receive_channel, DMA_CHXCTL_HTFIE | DMA_CHXCTL_FTFIE);
    size_ = size;
    forget_flags();
    USART_CTL2(wiring_.usart) = (USART_CTL2(wiring_.usart) & ~USART_CTL2_ERRIE) | USART_CTL2_DENR;
    usart_interrupt_enable(wiring_.usart, USART_INT_IDLE);
    dma_channel_enable(wiring_.dma, wiring_.receive_channel);
    return true;
  }

  /// Return the errors in the USART's status since the last call.
  LineErrors take_line_errors() {
    const std::uint32_t left = dma_transfer_number_get(wiring_.dma, wiring_.receive_channel);
    const std::uint32_t flags = wirebond_new_flags(&look_, USART_STAT0(wiring_.usart), left);
    return {(flags & USART_STAT0_FERR) != 0, (flags & USART_STAT0_NERR) != 0, (flags & USART_STAT0_ORERR) != 0,
            (flags & USART_STAT0_PERR) != 0};
  }

  /// Line errors do not stop DMA; a bus error does. A channel in normal mode that has filled the ring keeps its enable
  /// bit, but has ended. In circular mode the counter may be read at 0, before the next round starts.
  bool receiving() const {
    const std::uint32_t control = DMA_CHCTL(wiring_.dma, wiring_.receive_channel);
    if ((control & DMA_CHXCTL_CHEN) == 0) return false;
    return (control & DMA_CHXCTL_CMEN) != 0 || dma_transfer_number_get(wiring_.dma, wiring_.receive_channel) != 0;
  }

  /// Any context.
  std::size_t receive_position() const {
    return wirebond_ring_position(size_, dma_transfer_number_get(wiring_.dma, wiring_.receive_channel));
  }

  /// Called when a link is stopped.
  void stop_receive() {
    usart_interrupt_disable(wiring_.usart, USART_INT_IDLE);
    static_cast<void>(stop(wiring_.receive_channel));
  }

  /// Start a run. It is complete when DMA has read it: its last two bytes are then in the USART, and the next run
  /// follows them without a gap.
  bool start_transmit(const std::uint8_t* bytes, std::size_t size) {
    if (dma_transfer_number_get(wiring_.dma, wiring_.transmit_channel) != 0) return false;  // a run is being sent
    if (!stop(wiring_.transmit_channel)) return false;
    set_memory(wiring_.transmit_channel, bytes);
    dma_transfer_number_config(wiring_.dma, wiring_.transmit_channel, static_cast<std::uint32_t>(size));
    dma_interrupt_enable(wiring_.dma, wiring_.transmit_channel, DMA_CHXCTL_FTFIE);
    USART_CTL2(wiring_.usart) |= USART_CTL2_DENT;
    dma_channel_enable(wiring_.dma, wiring_.transmit_channel);
    return true;
  }

  void stop_transmit() {
    static_cast<void>(stop(wiring_.transmit_channel));  // if the channel hangs, the next start fails
    dma_transfer_number_config(wiring_.dma, wiring_.transmit_channel, 0);
  }

  /// Any task, any interrupt.
  void pend() { NVIC_SetPendingIRQ(wiring_.interrupt); }

  /// The tightly coupled memory of GD32F4xx is for the core alone. DMA counts bytes in 16 bits.
  bool reaches(const void* bytes, std::size_t size) const {
    const auto address = reinterpret_cast<std::uintptr_t>(bytes);
    return size <= 0xFFFF && (address + size <= 0x1000'0000 || address >= 0x1001'0000);
  }

  /// For Link::why: return the fault of the settings. A channel that does not step through memory was never set up. The
  /// baud rate is not compared: the library has no function that returns it.
  Why check(std::uint32_t) const {
    const std::uint32_t receive = DMA_CHCTL(wiring_.dma, wiring_.receive_channel);
    if ((USART_CTL0(wiring_.usart) & USART_CTL0_UEN) == 0) return Why::uart_not_set_up;
    if ((receive & DMA_CHXCTL_MNAGA) == 0) return Why::no_receive_dma;
    if ((DMA_CHCTL(wiring_.dma, wiring_.transmit_channel) & DMA_CHXCTL_MNAGA) == 0) return Why::no_transmit_dma;
    if ((receive & DMA_CHXCTL_CMEN) == 0) return Why::receive_dma_not_circular;
    const bool is_enabled = wirebond_interrupt_enabled(NVIC->ISER, static_cast<std::uint32_t>(wiring_.interrupt));
    return is_enabled ? Why::nothing : Why::interrupt_off;
  }

  // ---- the three handlers

  template <class Link>
  void usart_interrupt(Link& link) {
    link.on_pended();  // first: it reads the status, whose errors are cleared by reading the data register
    if (!is_up(USART_INT_FLAG_IDLE)) return;
    static_cast<void>(usart_data_receive(wiring_.usart));  // after the status, which `is_up` read: that ends the event
    link.on_received();
  }

  template <class Link>
  void receive_interrupt(Link& link) {
    clear(wiring_.receive_channel, DMA_INT_FLAG_HTF);
    clear(wiring_.receive_channel, DMA_INT_FLAG_FTF);
    link.on_received();
  }

  template <class Link>
  void transmit_interrupt(Link& link) {
    if (dma_interrupt_flag_get(wiring_.dma, wiring_.transmit_channel, DMA_INT_FLAG_FTF) == RESET) return;
    clear(wiring_.transmit_channel, DMA_INT_FLAG_FTF);
    link.on_transmitted();
  }

 private:
  /// Returns false if the channel does not stop: DMA must end the transfer of one byte first, within a few cycles.
  bool stop(dma_channel_enum channel) {
    dma_channel_disable(wiring_.dma, channel);
    for (int tries = 0; (DMA_CHCTL(wiring_.dma, channel) & DMA_CHXCTL_CHEN) != 0; ++tries) {
      if (tries == 100) return false;
    }
    clear(channel, DMA_INT_FLAG_HTF);  // GD32F4xx raises a flag when a channel is stopped, too
    clear(channel, DMA_INT_FLAG_FTF);
    return true;
  }

  void set_memory(dma_channel_enum channel, const std::uint8_t* bytes) {
    const auto address = static_cast<std::uint32_t>(reinterpret_cast<std::uintptr_t>(bytes));
#if defined(GD32F4XX_H)
    dma_memory_address_config(wiring_.dma, channel, DMA_MEMORY_0, address);
#else
    dma_memory_address_config(wiring_.dma, channel, address);
#endif
  }

  void clear(dma_channel_enum channel, std::uint32_t flag) { dma_interrupt_flag_clear(wiring_.dma, channel, flag); }

  bool is_up(usart_interrupt_flag_enum flag) const { return usart_interrupt_flag_get(wiring_.usart, flag) != RESET; }

  void forget_flags() {
    static_cast<void>(is_up(USART_INT_FLAG_IDLE));
    static_cast<void>(usart_data_receive(wiring_.usart));
  }

  Wiring wiring_;
  std::size_t size_ = 0;
  wirebond_status_look_t look_{};
};

}  // namespace wirebond::gd32_spl
