// When the next run starts, and what `poll` requests from the UART's interrupt: one atomic word and its transitions. No
// queue, no port, no clock.
#pragma once

#include <atomic>
#include <cstdint>

#include "wirebond/bytes.hpp"
#include "wirebond/mcu/atomics.hpp"

namespace wirebond {

/// Every atomic operation of the handshake that is more than relaxed, and the one it pairs with. If any of them is
/// weakened, a frame can stay in the queue for ever; tests/concurrency/relacy_handshake.cpp shows how.
struct HandshakeOrders {
  /// A sender has committed a frame, or given one back. Pairs with `takes` and `rests`: an interrupt that sees the mark
  /// also sees the frame. No fence is needed, on any number of cores: both sides change the same word, so one change
  /// comes first and the other side sees it.
  static constexpr std::memory_order offers = std::memory_order_release;
  /// The interrupt is about to look for frames. Pairs with `offers`.
  static constexpr std::memory_order takes = std::memory_order_acquire;
  /// The interrupt found no frame, and rests or looks again. Pairs with `offers`.
  static constexpr std::memory_order rests = std::memory_order_acquire;
};

/// The state of the line. While `looking` or `sending`, the interrupt looks for frames again without being pended.
enum class Line : std::uint8_t {
  idle = 0,     ///< there was nothing to send when the interrupt last looked
  refused = 1,  ///< the port did not take the run; it is offered again
  looking = 2,  ///< the interrupt looks for a run
  sending = 3,  ///< the port has a run
};

/// The problem, the lost wake-up: a sender commits a frame just after the interrupt has looked at the queue and found
/// it empty. If the sender believes that the interrupt will look again, and the interrupt believes that the sender will
/// pend it, nobody sends the frame. Pending it for every frame would be safe, but slow. In the same way, an abort that
/// `poll` requests could hit the next run.
///
/// The answer: one atomic word holds a `Line` and five marks: *offered*, *restart*, *abort*, *begun*, *reminded*. Every
/// party decides by changing this word: senders (any task or interrupt, on any core), `poll` (one context) and the
/// UART's interrupt (one context). An interrupt rests only if no frame was offered since it looked; a sender pends it
/// only if it is not active. So an abort never hits a run other than the one that `poll` saw, and after each offered
/// frame an interrupt looks for it. Each function is one change of the word, retried for each context that changes it
/// at the same time.
///
/// An event that is not in the table changes nothing. `+` sets a mark, `-` clears it.
///
/// | function: event | from | to | then the caller |
/// | --- | --- | --- | --- |
/// | `offer`: a frame was committed or given back | idle, refused | + offered | pends the interrupt |
/// | | looking, sending | + offered | does nothing: the interrupt looks again before it rests |
/// | `take`: the interrupt was pended | idle, refused | looking - offered | looks for a run |
/// | | sending + abort | looking - offered - abort | stops the port, counts an aborted run, looks for a run |
/// | `complete`: the port has sent the run | sending | looking - offered - abort | counts the run, looks for the next |
/// | `found`: there is a run | looking | sending + begun - abort | gives it to the port |
/// | `refuse`: the port did not take the run | sending | refused | counts it; `poll` pends again |
/// | `refuse`: the line must be silent before the next run | looking | refused | waits; `poll` pends again |
/// | `rest`: there is no run | looking | idle | is done |
/// | | looking + offered | looking - offered | looks again |
/// | `ask_restart`: reception must begin again | any | + restart | pends the interrupt |
/// | `restarted`: reception has begun again | any | - restart | goes on |
/// | `ask_abort`: the run takes too long | sending, not begun | + abort | pends the interrupt |
/// | `note`: `poll` has seen that a run began | + begun | - begun | measures its time from now on |
/// | `note`: and the line is silent | any | + restart | pends the interrupt |
/// | `halt`: the link is down, waiting frames have expired | any | idle, no mark | goes on |
/// | `remind`: `poll` pends the interrupt | any | + reminded | counts it if set before: no interrupt ran |
///
/// A row without a function belongs to the one above. `take`, `complete`, `rest`, `ask_restart` and `restarted` also
/// clear *reminded*: the interrupt runs. Keep each row within a line: the formatter joins longer ones.
template <class Atomics = DefaultAtomics, class Orders = HandshakeOrders>
class Handshake {
 public:
  /// A copy of the word.
  class State {
   public:
    explicit State(std::uint32_t word) : word_(word) {}
    Line line() const { return static_cast<Line>(word_ & line_bits); }
    bool offered() const { return (word_ & offered_bit) != 0; }
    bool restart() const { return (word_ & restart_bit) != 0; }
    bool begun() const { return (word_ & begun_bit) != 0; }
    bool reminded() const { return (word_ & reminded_bit) != 0; }
    /// Check whether work waits although the interrupt may not have been pended. A port that refused the run must be
    /// asked again; a lost request is repeated.
    bool asks() const { return restart() || line() == Line::refused || (line() == Line::idle && offered()); }

   private:
    std::uint32_t word_;
  };

  Handshake() = default;
  Handshake(const Handshake&) = delete;
  Handshake& operator=(const Handshake&) = delete;

  State look() const { return State(word_.load(std::memory_order_relaxed)); }  ///< any context

  // ---- senders: any context

  /// Returns true if the caller must pend the interrupt.
  WIREBOND_QUICK bool offer() {
    std::uint32_t seen = 0;
    Atomics::update(word_, Orders::offers, [&](std::uint32_t& word) {
      seen = word;
      word |= offered_bit;
      return true;
    });
    return (seen & active_bit) == 0;
  }

  // ---- the UART's interrupt

  enum class Work : std::uint8_t {
    none,
    look,
    abort,  ///< stop the run, then look for one
  };

  Work take() {
    Work work = Work::none;
    Atomics::update(word_, Orders::takes, [&](std::uint32_t& word) {
      work = Work::look;
      if ((word & active_bit) != 0) {
        work = (word & (line_bits | abort_bit)) == (sending | abort_bit) ? Work::abort : Work::none;
      }
      word = looking | (word & kept_bits);
      return work != Work::none;
    });
    return work;
  }

  /// Returns false if no run was under way: the event belongs to a stopped run.
  bool complete() {
    return Atomics::update(word_, Orders::takes, [](std::uint32_t& word) {
      const bool was_sending = (word & line_bits) == sending;
      word = looking | (word & kept_bits);
      return was_sending;
    });
  }

  void found() { change(line_bits | abort_bit, sending | begun_bit); }
  void refuse() { change(line_bits, refused); }

  /// Returns true if the line is idle now, false if the interrupt must look again.
  bool rest() {
    bool rests = false;
    Atomics::update(word_, Orders::rests, [&](std::uint32_t& word) {
      rests = (word & offered_bit) == 0;
      word = (rests ? idle : looking) | (word & kept_bits);
      return true;
    });
    return rests;
  }

  void restarted() { change(restart_bit | reminded_bit, 0); }

  /// Reset: the link is down, and nothing waits any more.
  void halt() { change(~std::uint32_t{0}, idle); }

  // ---- poll; `ask_restart` also the UART's interrupt

  void ask_restart() { change(reminded_bit, restart_bit); }

  /// Returns false if this run has ended.
  bool ask_abort() {
    return Atomics::update(word_, std::memory_order_relaxed, [](std::uint32_t& word) {
      const bool is_it = (word & (line_bits | begun_bit)) == sending;
      word |= abort_bit;
      return is_it;
    });
  }

  /// Clear *begun*; `restart`: also request that reception begins again.
  void note(bool restart) { change(begun_bit, restart ? restart_bit : 0); }

  /// Note that `poll` pends the interrupt, which clears the mark when it runs.
  void remind() { change(0, reminded_bit); }

 private:
  static constexpr std::uint32_t idle = static_cast<std::uint32_t>(Line::idle);
  static constexpr std::uint32_t refused = static_cast<std::uint32_t>(Line::refused);
  static constexpr std::uint32_t looking = static_cast<std::uint32_t>(Line::looking);
  static constexpr std::uint32_t sending = static_cast<std::uint32_t>(Line::sending);
  static constexpr std::uint32_t line_bits = 3;
  static constexpr std::uint32_t active_bit = 2;  // in `Line`: looking or sending
  static constexpr std::uint32_t offered_bit = 4;
  static constexpr std::uint32_t restart_bit = 8;
  static constexpr std::uint32_t abort_bit = 16;
  static constexpr std::uint32_t begun_bit = 32;
  static constexpr std::uint32_t reminded_bit = 64;
  static constexpr std::uint32_t kept_bits = restart_bit | begun_bit;  // by `take`, `complete` and `rest`

  WIREBOND_NOINLINE void change(std::uint32_t clears, std::uint32_t sets) {
    Atomics::update(word_, std::memory_order_relaxed, [&](std::uint32_t& word) {
      word = (word & ~clears) | sets;
      return true;
    });
  }

  typename Atomics::template Atomic<std::uint32_t> word_{};
};

}  // namespace wirebond
