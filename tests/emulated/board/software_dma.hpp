// The DMA and the line's pace that the emulated machine lacks, for one USART: circular reception, runs, events.
// Its hardware side runs at priority 0, above everything that is tested; its driver side is what a port calls.
#pragma once

#include <atomic>
#include <cstddef>
#include <cstdint>

#include "stm32f405.hpp"

namespace board {

/// Events that a real DMA and UART would raise, as bits.
struct Events {
  static constexpr std::uint32_t received = 1U << 0;     ///< half, full, or the line is idle
  static constexpr std::uint32_t transmitted = 1U << 1;  ///< the run's last byte has left
  static constexpr std::uint32_t pended = 1U << 2;       ///< software asked for the interrupt
};

/// `event_interrupt` is raised by software; its handler calls `take_events`. `bytes_a_tick`: the line's rate, in bytes
/// for each call of `on_tick`.
class SoftwareDma {
 public:
  SoftwareDma(Usart& usart, Interrupt usart_interrupt, Interrupt event_interrupt, std::size_t bytes_a_tick)
      : usart_(usart),
        usart_interrupt_(usart_interrupt),
        event_interrupt_(event_interrupt),
        bytes_a_tick_(bytes_a_tick) {}
  SoftwareDma(const SoftwareDma&) = delete;
  SoftwareDma& operator=(const SoftwareDma&) = delete;

  // ---- driver side: any context

  /// Begin circular reception, from the ring's first byte.
  void start_receive(std::uint8_t* ring, std::size_t size) {
    usart_.control1 = Usart::enable | Usart::transmitter;
    ring_ = ring;
    ring_size_ = size;
    position_ = 0;
    nvic::enable(usart_interrupt_, hardware_priority);
    usart_.control1 = Usart::enable | Usart::transmitter | Usart::receiver | Usart::receive_interrupt;
  }

  std::size_t receive_position() const { return position_; }

  /// One caller at a time. False: a run is under way.
  bool start_transmit(const std::uint8_t* bytes, std::size_t size) {
    if (left_ != 0) return false;
    next_ = bytes;
    left_ = size;  // the last store: from here on the tick sends
    return true;
  }

  /// No `transmitted` event comes for the run that was under way.
  void stop_transmit() {
    left_ = 0;
    events_.fetch_and(~Events::transmitted, std::memory_order_relaxed);
  }

  void raise(std::uint32_t events) {
    events_.fetch_or(events, std::memory_order_release);
    nvic::pend(event_interrupt_);
  }

  /// What happened since the last call. For the event interrupt's handler.
  std::uint32_t take_events() { return events_.exchange(0, std::memory_order_acquire); }

  // ---- hardware side: interrupts of priority 0

  static constexpr std::uint8_t hardware_priority = 0;

  /// The USART's interrupt: a byte has come.
  void on_byte() {
    if ((usart_.status & Usart::received) == 0) return;
    if (received_in_tick_ == bytes_a_tick_) {  // the other side waits until the byte is taken
      usart_.control1 &= ~Usart::receive_interrupt;
      return;
    }
    ++received_in_tick_;
    ring_[position_] = static_cast<std::uint8_t>(usart_.data);
    const std::size_t next = position_ + 1 == ring_size_ ? 0 : position_ + 1;
    position_ = next;
    idle_is_told_ = false;
    if (next == 0 || next == ring_size_ / 2) raise(Events::received);
  }

  /// The line's pace.
  void on_tick() {
    if (left_ != 0) {
      std::size_t now = left_ < bytes_a_tick_ ? left_ : bytes_a_tick_;
      left_ -= now;
      for (; now != 0; --now) {
        while ((usart_.status & Usart::transmit_empty) == 0) {
        }
        usart_.data = *next_;
        next_ = next_ + 1;
      }
      if (left_ == 0) raise(Events::transmitted);
    }
    if (received_in_tick_ == 0 && !idle_is_told_) {
      idle_is_told_ = true;
      raise(Events::received);
    }
    received_in_tick_ = 0;
    if (ring_ != nullptr) usart_.control1 |= Usart::receive_interrupt;
  }

 private:
  Usart& usart_;
  const Interrupt usart_interrupt_;
  const Interrupt event_interrupt_;
  const std::size_t bytes_a_tick_;
  std::uint8_t* ring_ = nullptr;
  std::size_t ring_size_ = 0;
  volatile std::size_t position_ = 0;
  std::size_t received_in_tick_ = 0;
  bool idle_is_told_ = true;
  const std::uint8_t* volatile next_ = nullptr;
  volatile std::size_t left_ = 0;
  std::atomic<std::uint32_t> events_{0};
};

}  // namespace board
