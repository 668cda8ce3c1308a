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

/// `event_interrupt` is raised by software; its handler calls `take_events`. `pace` is this line's timer: it runs while
/// bytes come or go, so that an emulated board with nothing to do costs this machine nothing.
class SoftwareDma {
 public:
  /// The line's pace, both ways: that of 2 Mbaud with two stop bits.
  static constexpr std::uint32_t tick_us = 22;
  static constexpr std::size_t bytes_a_tick = 4;

  SoftwareDma(Usart& usart, Interrupt usart_interrupt, Interrupt event_interrupt, Timer& pace, Interrupt pace_interrupt)
      : usart_(usart),
        usart_interrupt_(usart_interrupt),
        event_interrupt_(event_interrupt),
        pace_(pace),
        pace_interrupt_(pace_interrupt) {
    // The machine throws away what comes before this; afterwards it keeps the other side waiting.
    usart_.control1 = Usart::enable | Usart::transmitter | Usart::receiver | Usart::receive_interrupt;
  }
  SoftwareDma(const SoftwareDma&) = delete;
  SoftwareDma& operator=(const SoftwareDma&) = delete;

  /// How the project has set it up. Before anything runs.
  struct Settings {
    bool has_receive = true;
    bool has_transmit = true;
    bool is_circular = true;  ///< false: reception ends with its first round
  } settings;

  // ---- driver side: any context

  /// Begin circular reception, from the ring's first byte.
  void start_receive(std::uint8_t* ring, std::size_t size) {
    nvic::disable(usart_interrupt_);  // not the receiver: bytes that come meanwhile wait
    ring_ = ring;
    ring_size_ = size;
    position_ = 0;
    nvic::set_priority(usart_interrupt_, hardware_priority);
    nvic::set_priority(pace_interrupt_, hardware_priority);
    nvic::enable(pace_interrupt_);
    nvic::enable(usart_interrupt_);
  }

  /// False before the start, and where the first round has ended reception.
  bool receiving() const { return ring_ != nullptr; }

  std::size_t receive_position() const { return position_; }

  /// One caller at a time. False: a run is under way.
  bool start_transmit(const std::uint8_t* bytes, std::size_t size) {
    if (left_ != 0) return false;
    next_ = bytes;
    left_ = size;  // before the look at the pace, which stops when nothing is left
    if (!is_ticking_) start_pace();
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
    if (received_in_tick_ == bytes_a_tick) {  // the other side waits until the byte is taken
      nvic::disable(usart_interrupt_);        // to clear `receive_interrupt` does not end the machine's request
      return;
    }
    hear(static_cast<std::uint8_t>(usart_.data));
  }

  /// A byte is in the UART's data register.
  void hear(std::uint8_t byte) {
    if (ring_ == nullptr) return;
    ++received_in_tick_;
    if (!is_ticking_) start_pace();
    ring_[position_] = byte;
    const std::size_t next = position_ + 1 == ring_size_ ? 0 : position_ + 1;
    position_ = next;
    idle_is_told_ = false;
    if (next == 0 && !settings.is_circular) ring_ = nullptr;
    if (next == 0 || next == ring_size_ / 2) raise(Events::received);
  }

  /// The interrupt of the pace, every `tick_us`.
  void on_tick() {
    pace_.status = 0;
    if (left_ != 0) {
      std::size_t now = left_ < bytes_a_tick ? left_ : bytes_a_tick;
      left_ -= now;
      for (; now != 0; --now) {  // the machine takes a byte at once, whatever its status register says
        usart_.data = *next_;
        next_ = next_ + 1;
      }
      if (left_ == 0) raise(Events::transmitted);
    }
    if (received_in_tick_ == 0 && !idle_is_told_) {
      idle_is_told_ = true;
      raise(Events::received);
    }
    if (received_in_tick_ == 0 && left_ == 0) {
      is_ticking_ = false;
      pace_.control1 = 0;
    }
    received_in_tick_ = 0;
    if (ring_ != nullptr) nvic::enable(usart_interrupt_);
  }

 private:
  void start_pace() {
    start_ticks(pace_, tick_us);
    is_ticking_ = true;  // afterwards: whoever comes between starts it too, which does no harm
  }

  Usart& usart_;
  const Interrupt usart_interrupt_;
  const Interrupt event_interrupt_;
  Timer& pace_;
  const Interrupt pace_interrupt_;
  std::uint8_t* volatile ring_ = nullptr;
  volatile std::size_t ring_size_ = 0;
  volatile std::size_t position_ = 0;
  std::size_t received_in_tick_ = 0;
  bool idle_is_told_ = true;
  const std::uint8_t* volatile next_ = nullptr;
  volatile std::size_t left_ = 0;
  volatile bool is_ticking_ = false;
  std::atomic<std::uint32_t> events_{0};
};

}  // namespace board
