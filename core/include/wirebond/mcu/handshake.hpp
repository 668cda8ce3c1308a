// Who starts the next run, and what poll asks of the UART's interrupt: one atomic word and its transitions. No queue,
// no port, no clock.
#pragma once

#include <atomic>
#include <cstdint>

#include "wirebond/bytes.hpp"
#include "wirebond/mcu/atomics.hpp"

namespace wirebond {

/// Every atomic operation of the handshake that is more than relaxed, and the one that it pairs with. Any of them
/// weakened leaves a frame in the queue for ever; tests/concurrency/relacy_handshake.cpp shows how.
struct HandshakeOrders {
  /// A sender says that it has committed a frame, or given one back. With `takes` and `rests`: the interrupt that sees
  /// the mark sees the frame. No fence is needed beside it, on any number of cores: both sides change the same word, so
  /// one of them comes first, and the other one sees that.
  static constexpr std::memory_order offers = std::memory_order_release;
  /// The interrupt is about to look for frames. With `offers`.
  static constexpr std::memory_order takes = std::memory_order_acquire;
  /// The interrupt found none, and rests or looks again. With `offers`.
  static constexpr std::memory_order rests = std::memory_order_acquire;
};

/// What the line does. Where it is looking or sending, the interrupt looks again by itself.
enum class Line : std::uint8_t {
  idle = 0,     ///< nothing was there to send when the interrupt last looked
  refused = 1,  ///< the port did not take the run, and gets it again
  looking = 2,  ///< the interrupt looks for a run
  sending = 3,  ///< a run is with the port
};

/// The agreement of senders (any task or interrupt, on any core), `poll` (one context) and the UART's interrupt (one
/// context). The word holds a `Line` and five marks: *offered*, *restart*, *abort*, *begun*,
/// *reminded*.
///
/// Whatever is not in the table changes nothing. A `+` sets a mark, a `-` clears it.
///
/// | event, by its function | from | to | what its caller does then |
/// | --- | --- | --- | --- |
/// | `offer`: a frame was committed or given back | idle, refused | + offered | pends the interrupt |
/// | | looking, sending | + offered | nothing: the interrupt looks again before it rests |
/// | `take`: the interrupt was pended | idle, refused | looking - offered | looks for a run |
/// | | sending + abort | looking - offered - abort | stops the port, books the run as aborted, looks for a run |
/// | `complete`: the port has sent the run | sending | looking - offered - abort | books the run, looks for a run |
/// | `found`: there is a run | looking | sending + begun - abort | hands it to the port |
/// | `refuse`: the port did not take it | sending | refused | counts; `poll` pends again |
/// | `refuse`: the line must be silent before the next run | looking | refused | `poll` pends again |
/// | `rest`: there is no run | looking | idle | is done |
/// | | looking + offered | looking - offered | looks again |
/// | `ask_restart`: reception shall begin again | any | + restart | pends the interrupt |
/// | `restarted` | any | - restart | |
/// | `ask_abort`: the run takes too long | sending, not begun | + abort | pends the interrupt |
/// | `note`: `poll` has seen that a run began | + begun | - begun | measures its time from now on |
/// | `note`: and that the line is silent | any | + restart | pends the interrupt |
/// | `halt`: the link is down, and what waited has expired | any | idle, no mark | |
/// | `remind`: `poll` pends the interrupt | any | + reminded | counts if it is there already: nobody served the last
/// one | | `take`, `complete`, `rest`, `ask_restart`, `restarted`: the interrupt runs | | - reminded | |
///
/// So an abort never meets another run than the one that `poll` saw, and a frame that was offered is always looked for
/// by an interrupt that comes later. Each function is one change of the word, done again for each context that came in
/// between.
template <class Atomics = DefaultAtomics, class Orders = HandshakeOrders>
class Handshake {
 public:
  /// A look at the word.
  class State {
   public:
    explicit State(std::uint32_t word) : word_(word) {}
    Line line() const { return static_cast<Line>(word_ & line_bits); }
    bool offered() const { return (word_ & offered_bit) != 0; }
    bool restart() const { return (word_ & restart_bit) != 0; }
    bool begun() const { return (word_ & begun_bit) != 0; }
    bool reminded() const { return (word_ & reminded_bit) != 0; }
    /// Does something wait for an interrupt that perhaps was not pended? Where the port took no run it must be asked
    /// again; a request that was lost is repeated.
    bool asks() const { return restart() || line() == Line::refused || (line() == Line::idle && offered()); }

   private:
    std::uint32_t word_;
  };

  Handshake() = default;
  Handshake(const Handshake&) = delete;
  Handshake& operator=(const Handshake&) = delete;

  State look() const { return State(word_.load(std::memory_order_relaxed)); }  ///< any context

  // ---- senders: any context

  /// True: pend the interrupt.
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
    look,   ///< look for a run
    abort,  ///< break the run off, then look for one
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

  /// False: no run was under way; the event is that of one that was stopped.
  bool complete() {
    return Atomics::update(word_, Orders::takes, [](std::uint32_t& word) {
      const bool was_sending = (word & line_bits) == sending;
      word = looking | (word & kept_bits);
      return was_sending;
    });
  }

  void found() { change(line_bits | abort_bit, sending | begun_bit); }
  void refuse() { change(line_bits, refused); }

  /// True: the line is idle. False: look again.
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

  /// The link is down, and nothing waits any more.
  void halt() { change(~std::uint32_t{0}, idle); }

  // ---- poll; the first also the UART's interrupt

  void ask_restart() { change(reminded_bit, restart_bit); }

  /// False: there is no such run any more.
  bool ask_abort() {
    return Atomics::update(word_, std::memory_order_relaxed, [](std::uint32_t& word) {
      const bool is_it = (word & (line_bits | begun_bit)) == sending;
      word |= abort_bit;
      return is_it;
    });
  }

  /// Whatever has begun is noted; `restart`: and reception shall begin again.
  void note(bool restart) { change(begun_bit, restart ? restart_bit : 0); }

  /// The interrupt is pended by `poll`, and takes the mark away when it runs.
  void remind() { change(0, reminded_bit); }

 private:
  static constexpr std::uint32_t idle = static_cast<std::uint32_t>(Line::idle);
  static constexpr std::uint32_t refused = static_cast<std::uint32_t>(Line::refused);
  static constexpr std::uint32_t looking = static_cast<std::uint32_t>(Line::looking);
  static constexpr std::uint32_t sending = static_cast<std::uint32_t>(Line::sending);
  static constexpr std::uint32_t line_bits = 3;
  static constexpr std::uint32_t active_bit = 2;  // of `Line`: looking or sending
  static constexpr std::uint32_t offered_bit = 4;
  static constexpr std::uint32_t restart_bit = 8;
  static constexpr std::uint32_t abort_bit = 16;
  static constexpr std::uint32_t begun_bit = 32;
  static constexpr std::uint32_t reminded_bit = 64;
  static constexpr std::uint32_t kept_bits = restart_bit | begun_bit;  // when the interrupt begins to look, or rests

  WIREBOND_NOINLINE void change(std::uint32_t clears, std::uint32_t sets) {
    Atomics::update(word_, std::memory_order_relaxed, [&](std::uint32_t& word) {
      word = (word & ~clears) | sets;
      return true;
    });
  }

  typename Atomics::template Atomic<std::uint32_t> word_{};
};

}  // namespace wirebond
