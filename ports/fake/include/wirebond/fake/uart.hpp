// A UART with DMA that exists in memory only: a port for tests, with the habits and faults of a real one.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>

#include "wirebond/fake/behaviour.hpp"
#include "wirebond/fake/draw.hpp"
#include "wirebond/fake/line.hpp"
#include "wirebond/mcu/line_errors.hpp"

namespace wirebond::fake {

/// Provides the functions that Link needs from a port; in addition, `run` lets time pass. The handler of `run` is a
/// Link, or any object with its `on_received`, `on_transmitted`, `on_error` and `on_pended`, which may call the port.
/// One thread.
class Uart {
 public:
  /// Receives from `in` and sends on `out`; both must outlive it.
  Uart(Line& in, Line& out, const Behaviour& habits = {}, std::uint64_t seed = 1)
      : behaviour(habits), in_(in), out_(out), draw_(seed) {}

  Behaviour behaviour;

  // ---- the port

  bool start_receive(std::uint8_t* ring, std::size_t size) {
    if (aborting_ || refuse_receives_ != 0 || draw_.chance(behaviour.receive_refused)) {
      if (!aborting_ && refuse_receives_ != 0) --refuse_receives_;
      ++counts_.receive_refused;
      return false;
    }
    ring_ = ring;
    size_ = size;
    place_ = 0;
    receiving_ = true;
    clear(Event::half);
    clear(Event::full);
    clear(Event::idle);
    clear(Event::line_error);  // its flag is cleared by reading the data register
    line_errors_ = {};
    idle_at_ = never;
    ++counts_.receive_starts;
    return true;
  }

  bool receiving() const { return receiving_; }

  std::size_t receive_position() const { return place_; }

  /// Stop DMA where it is. A port need not have this; for vendors' drivers on top of this one.
  void stop_receive() {
    receiving_ = false;
    idle_at_ = never;
  }

  bool start_transmit(const std::uint8_t* bytes, std::size_t size) {
    if (transmitting() || refuse_transmits_ != 0 || draw_.chance(behaviour.transmit_refused)) {
      if (!transmitting() && refuse_transmits_ != 0) --refuse_transmits_;
      ++counts_.transmit_refused;
      return false;
    }
    run_ = bytes;
    run_left_ = size;
    next_byte_at_ = now_ + behaviour.restart_gap;
    ++counts_.runs;
    counts_.taken += size;
    return true;
  }

  void stop_transmit() {
    counts_.broken_off += run_left_;
    run_left_ = 0;
    next_byte_at_ = never;
    completes_at_ = never;
    clear(Event::transmitted);
  }

  void pend() { raise(Event::pended); }

  /// Return the errors since the last call, with OnLineError::flag.
  LineErrors take_line_errors() {
    const LineErrors errors = line_errors_;
    line_errors_ = {};
    return errors;
  }

  bool reaches(const void* bytes, std::size_t size) const {
    const auto first = reinterpret_cast<std::uintptr_t>(bytes);
    const auto wall = reinterpret_cast<std::uintptr_t>(unreachable_);
    return first + size <= wall || wall + unreachable_size_ <= first;
  }

  // ---- scripts

  /// Reset as the MCU's reset does. The lines and the counts continue.
  void reset() {
    stop_receive();
    stop_transmit();
    place_ = 0;
    aborting_ = false;
    aborted_at_ = never;
    flags_ = {};
    masked_until_ = 0;
  }
  void refuse_receives(std::uint32_t count) { refuse_receives_ = count; }
  void refuse_transmits(std::uint32_t count) { refuse_transmits_ = count; }
  /// Mark memory that DMA cannot reach.
  void set_unreachable(const void* bytes, std::size_t size) {
    unreachable_ = bytes;
    unreachable_size_ = size;
  }
  /// Hold events of this kind until they are released: a test can so create any order.
  void hold(Event event) { flag(event).held = true; }
  void release(Event event) {
    flag(event).held = false;
    if (flag(event).due < now_) flag(event).due = now_;
  }
  /// Mask interrupts: none is served before `until`.
  void mask(Time until) { masked_until_ = until; }
  /// Raise an event without a reason and without delay. Not `transmitted`: hardware does not do that.
  void raise_now(Event event) { flag(event).due = flag(event).due < now_ ? flag(event).due : now_; }
  /// Let the current run die here: an error event, and no complete event.
  void kill_transmit() {
    stop_transmit();
    raise(Event::dma_error);
  }

  // ---- time

  Time now() const { return now_; }
  /// Return when the next thing happens by itself, or never.
  Time next() const {
    Time next = in_.next_arrival();
    for (const Time at : {next_byte_at_, completes_at_, idle_at_, aborted_at_}) next = at < next ? at : next;
    for (const Flag& flag : flags_) next = served_at(flag) < next ? served_at(flag) : next;
    return next;
  }

  /// Let time pass until `until`, and serve the interrupts that come until then.
  template <class Handler>
  void run(Time until, Handler& handler) {
    for (Time at = next(); at <= until; at = next()) {
      if (now_ < at) now_ = at;
      step(handler);
    }
    if (now_ < until) now_ = until;
  }

  // ---- the truth

  const UartCounts& counts() const { return counts_; }
  bool transmitting() const {
    return run_left_ != 0 || completes_at_ != never || flag(Event::transmitted).due != never;
  }
  /// Bytes of the current run that are not on the line yet.
  std::size_t waiting() const { return run_left_; }

 private:
  struct Flag {
    Time due = never;  ///< never: not raised
    bool held = false;
  };

  Flag& flag(Event event) { return flags_[static_cast<std::size_t>(event)]; }
  const Flag& flag(Event event) const { return flags_[static_cast<std::size_t>(event)]; }
  void clear(Event event) { flag(event).due = never; }
  Time served_at(const Flag& flag) const {
    if (flag.held || flag.due == never) return never;
    return flag.due < masked_until_ ? masked_until_ : flag.due;
  }
  /// As in hardware, a set flag stays set: events merge.
  void raise(Event event) {
    if (flag(event).due != never) return;
    flag(event).due = now_ + draw_.below(behaviour.interrupt_delay + 1);
  }
  void raise_unless_swallowed(Event event) {
    if (!draw_.chance(behaviour.swallowed)) raise(event);
  }

  /// Do one thing that is due now: hardware first, then one of the waiting interrupts, drawn.
  template <class Handler>
  void step(Handler& handler) {
    if (in_.next_arrival() <= now_) return receive();
    if (next_byte_at_ <= now_) return send();
    if (completes_at_ <= now_) {
      completes_at_ = never;
      return raise(Event::transmitted);
    }
    if (idle_at_ <= now_) {
      idle_at_ = never;
      const bool begun = in_.next_arrival() - now_ < in_.byte_time();  // the next byte's start bit came before
      if (!begun) raise_unless_swallowed(Event::idle);
      return;
    }
    if (aborted_at_ <= now_) {
      aborted_at_ = never;
      aborting_ = false;
      ++counts_.errors;
      return handler.on_error();
    }
    std::array<std::size_t, events> waiting{};
    std::size_t count = 0;
    for (std::size_t i = 0; i < events; ++i) {
      if (served_at(flags_[i]) <= now_) waiting[count++] = i;
    }
    if (count != 0) serve(static_cast<Event>(waiting[draw_.below(count)]), handler);
  }

  template <class Handler>
  void serve(Event event, Handler& handler) {
    clear(event);
    switch (event) {
      case Event::full:
      case Event::idle:
        if (!behaviour.circular) stop_receive();
        [[fallthrough]];
      case Event::half: return handler.on_received();
      case Event::transmitted: ++counts_.runs_completed; return handler.on_transmitted();
      case Event::pended: return handler.on_pended();
      case Event::line_error:
        if (behaviour.on_line_error != OnLineError::stop) return ++counts_.errors, handler.on_error();
        [[fallthrough]];
      case Event::dma_error:
        stop_receive();
        aborting_ = true;
        aborted_at_ = now_ + draw_.below(behaviour.abort_time + 1);
        return;
    }
  }

  void receive() {
    const LineByte byte = *in_.arriving();
    if (!receiving_) return in_.take(Fate::unheard);
    idle_at_ = now_ + in_.byte_time();
    if (byte.fault == Fault::overrun) {
      in_.take(Fate::overrun);
      return note_error(byte.fault);
    }
    const bool damaged = byte.fault != Fault::none;
    if (damaged) note_error(byte.fault);
    if (damaged && !behaviour.keeps_damaged) return in_.take(Fate::dropped);
    in_.take(damaged ? Fate::damaged : Fate::received);
    ring_[place_] = byte.seen;
    place_ = place_ + 1 == size_ ? 0 : place_ + 1;
    ++counts_.written;
    if (place_ == size_ / 2) raise_unless_swallowed(Event::half);
    if (place_ == 0) raise_unless_swallowed(Event::full);
    if (draw_.chance(behaviour.spurious)) raise(Event::idle);
  }

  void note_error(Fault fault) {
    if (behaviour.on_line_error != OnLineError::flag) return raise(Event::line_error);
    line_errors_.framing |= fault == Fault::framing;
    line_errors_.noise |= fault == Fault::noise;
    line_errors_.overrun |= fault == Fault::overrun;
  }

  /// DMA reads each byte when its turn comes, as in hardware: overwriting a run that is being sent is detected.
  void send() {
    if (draw_.chance(behaviour.transmit_dies)) return kill_transmit();
    const Time end = out_.put(*run_, now_);
    ++run_;
    if (--run_left_ != 0) {
      next_byte_at_ = end;
    } else {
      next_byte_at_ = never;
      completes_at_ = end;
    }
  }

  Line& in_;
  Line& out_;
  Draw draw_;
  Time now_ = 0;
  UartCounts counts_;

  std::uint8_t* ring_ = nullptr;
  std::size_t size_ = 0;
  std::size_t place_ = 0;
  bool receiving_ = false;
  bool aborting_ = false;
  Time aborted_at_ = never;
  Time idle_at_ = never;
  std::uint32_t refuse_receives_ = 0;
  LineErrors line_errors_;

  const std::uint8_t* run_ = nullptr;
  std::size_t run_left_ = 0;
  Time next_byte_at_ = never;
  Time completes_at_ = never;
  std::uint32_t refuse_transmits_ = 0;

  std::array<Flag, events> flags_{};
  Time masked_until_ = 0;
  const void* unreachable_ = nullptr;
  std::size_t unreachable_size_ = 0;
};

/// A UART with a clock, which a link reads when an event comes.
class ClockedUart : public Uart {
 public:
  using Uart::Uart;

  std::uint32_t now_us() const { return clock_start_us + static_cast<std::uint32_t>(now() / 1000); }

  std::uint32_t clock_start_us = 0;  ///< the clock's initial time; it may wrap
};

/// Let time pass for two UARTs on one time line, each with its handler.
template <class HandlerA, class HandlerB>
void run_both(Time until, Uart& a, HandlerA& handler_a, Uart& b, HandlerB& handler_b) {
  for (;;) {
    const Time next = a.next() < b.next() ? a.next() : b.next();
    const Time at = next < until ? next : until;
    a.run(at, handler_a);
    b.run(at, handler_b);
    if (next > until) return;
  }
}

}  // namespace wirebond::fake
