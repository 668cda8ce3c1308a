// A port: a UART without DMA, one interrupt for each byte. It uses no register: a small class of yours does.
#pragma once

#include <atomic>
#include <cstddef>
#include <cstdint>

namespace wirebond::bare_metal {

/// `Registers` is a class of yours with
///   void write(std::uint8_t byte)          write this byte to the data register
///   void enable_receive_interrupt()        enable the interrupt for each received byte
///   void enable_transmit_interrupt(bool)   while enabled, one whenever the data register can take a byte (TXE)
///   void pend()                            let the UART's interrupt run soon: NVIC_SetPendingIRQ; any context
/// Its functions are called by the UART's interrupt, and once by the first `poll`.
///
/// The UART's handler calls, depending on its status:
///   uart.received(byte, link)        a byte came
///   uart.transmit_ready(link)        the data register can take a byte, and the transmit interrupt is enabled
///   link.on_error()                  framing, noise or overrun; its byte may be passed or skipped
///   link.on_pended()                 always, at its end
template <class Registers>
class Uart {
 public:
  explicit Uart(Registers& registers) : registers_(registers) {}

  static constexpr bool tells_every_lap = true;  ///< there is no DMA that could lap unseen
  static constexpr bool completes_early = true;  ///< see transmit_ready

  bool start_receive(std::uint8_t* ring, std::size_t size) {
    ring_ = ring;
    size_ = size;
    place_.store(0, std::memory_order_relaxed);
    registers_.enable_receive_interrupt();
    return true;
  }

  /// True once started: no error stops it.
  bool receiving() const { return size_ != 0; }

  /// Any context.
  std::size_t receive_position() const { return place_.load(std::memory_order_acquire); }  // pairs with `received`

  bool start_transmit(const std::uint8_t* bytes, std::size_t size) {
    if (is_sending_) return false;
    next_ = bytes;
    left_ = size;
    is_sending_ = true;
    registers_.enable_transmit_interrupt(true);
    return true;
  }

  void stop_transmit() {
    is_sending_ = false;
    registers_.enable_transmit_interrupt(false);
  }

  void pend() { registers_.pend(); }

  /// Always true: the core reaches all of its memory.
  bool reaches(const void*, std::size_t) const { return true; }

  // ---- the UART's handler

  template <class Link>
  void received(std::uint8_t byte, Link& link) {
    if (size_ == 0) return;                                      // not started
    std::size_t place = place_.load(std::memory_order_relaxed);  // only this context writes it
    ring_[place] = byte;
    place = place + 1 == size_ ? 0 : place + 1;
    place_.store(place, std::memory_order_release);            // pairs with `receive_position`
    if (place == 0 || place == size_ / 2) link.on_received();  // so that every turn of the ring is noticed
  }

  /// Send the next byte. The run is complete when its last byte has left the data register: the next run follows it
  /// without a gap.
  template <class Link>
  void transmit_ready(Link& link) {
    if (!is_sending_) return registers_.enable_transmit_interrupt(false);
    if (left_ != 0) {
      --left_;
      return registers_.write(*next_++);
    }
    is_sending_ = false;
    link.on_transmitted();
    if (!is_sending_) registers_.enable_transmit_interrupt(false);
  }

 private:
  Registers& registers_;
  std::uint8_t* ring_ = nullptr;
  std::size_t size_ = 0;
  std::atomic<std::size_t> place_{0};
  const std::uint8_t* next_ = nullptr;
  std::size_t left_ = 0;
  bool is_sending_ = false;
};

}  // namespace wirebond::bare_metal
