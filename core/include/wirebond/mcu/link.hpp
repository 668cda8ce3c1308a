// One supervised connection of an end: what came in goes to the handler, what is sent is queued, silence is noticed.
// The memory of both rings, the port that moves bytes, and the clock are the user's.
#pragma once

#include <atomic>
#include <cstddef>
#include <cstdint>
#include <string_view>
#include <type_traits>

#include "wirebond/deadline.hpp"
#include "wirebond/mcu/buffers.hpp"
#include "wirebond/mcu/outbox.hpp"
#include "wirebond/mcu/receive_ring.hpp"
#include "wirebond/mcu/schedule.hpp"
#include "wirebond/mcu/services.hpp"
#include "wirebond/mcu/subscription.hpp"
#include "wirebond/message.hpp"
#include "wirebond/receiver.hpp"
#include "wirebond/status.hpp"

namespace wirebond {

/// How a link stands.
enum class LinkState : std::uint8_t {
  down,   ///< not started, or its buffers are out of the DMA's reach: nothing is sent or received
  stale,  ///< it runs, and no valid frame came for `timeout_us`
  up,     ///< valid frames come
};

/// What happened to the line and the port, modulo 2^32.
struct LinkCounters {
  std::uint32_t line_errors = 0;        ///< framing, noise, overrun and DMA errors that the port told of
  std::uint32_t receive_restarts = 0;   ///< reception was begun again, after an error or for silence
  std::uint32_t transmit_retries = 0;   ///< the port did not take a run: busy, or an error
  std::uint32_t transmit_timeouts = 0;  ///< a run did not leave in time, and was broken off
};

namespace detail {

template <class Handler, class = void>
struct HasLinkState : std::false_type {};
template <class Handler>
struct HasLinkState<Handler, std::void_t<decltype(std::declval<Handler&>().link_state(LinkState::up))>>
    : std::true_type {};

}  // namespace detail

/// `Protocol`: an end of a generated header (`diffdrive::McuLink` fills it in). `Port`: see docs/firmware.md.
/// `Memory`: a `Buffers`.
///
/// `handler` must have a function for each `then:` of the file's deadlines at this end, such as `void stop()`. It may
/// have, each of them if it wants it:
/// - `void on(const Message&)`: a message came and passed its field rules
/// - `void unknown(const Frame&)`: a frame of no known message came
/// - `bool fill(Message&)`: a message with `every:` is due; false: not this time
/// - `void link_state(LinkState)`: the state has changed
/// - `auto& parameters()`: its `Parameters`, for the parameter service
/// - `void parameter_set(index, value)`: a parameter was set; here it is stored
///
/// All of them run inside `poll`, in its context.
///
/// Contexts: `send` and `log` from any task or interrupt. `poll` from one: a task, the main loop, or an interrupt. The
/// `on_...` functions from the UART's interrupt and its DMA's, which must not interrupt each other; it may interrupt
/// everything else, also above an RTOS's limit, for nothing here calls an RTOS.
template <class Protocol, class Handler, class Port, class Memory>
class Link {
 public:
  /// The silence of the peer after which the link is stale, and reception is begun anew: a UART or its DMA may hang.
  static constexpr std::uint32_t timeout_us = 1'000'000;

  using Sends = typename Protocol::Sends;
  using Inlet = Receiver<typename Protocol::Receives, std::uint32_t, ByteCounts<std::uint32_t>>;

  Link(Handler& handler, Port& port, Memory& memory)
      : handler_(handler),
        port_(port),
        memory_(memory),
        ring_(memory.receive.data(), memory.receive.size()),
        outbox_(memory.send.data()),
        deadlines_(Protocol::deadlines, 0) {}
  Link(const Link&) = delete;
  Link& operator=(const Link&) = delete;

  // ---- any task, any interrupt

  /// Queue one message. Never blocks; any other answer than `ok` means that nothing was queued.
  template <class Message>
  Status send(const Message& message) {
    static_assert(Message::Info::sender == Protocol::end || Message::Info::sender == End::both,
                  "this message is sent by the other end");
    if (state() == LinkState::down) {
      outbox_.refuse(Refusal::down, account_of<Message>());
      return Status::link_down;
    }
    const std::size_t payload = payload_bytes(message);
    if (payload > Message::Info::max_payload_bytes) return refuse_range<Message>();
    auto grant = outbox_.template reserve_for<Message>(wire_bytes(Sends{}.format(), payload), now_ms());
    if (!grant.ok()) return Status::queue_full;
    std::size_t size = 0;
    const Status status = encode_frame<Sends>(message, grant.data(), grant.size(), size);
    if (status != Status::ok) {
      grant.give_back(Refusal::range);
    } else {
      grant.commit(size);
    }
    // Also after a refusal: the room that was given back may be waited for. Pairs with begin_run.
    if (!transmitting_.load(std::memory_order_seq_cst)) port_.pend();
    return status;
  }

  /// Queue one line for the host, by the log service; what is longer than the message's field is cut.
  template <class Log = typename Protocol::Log::Message>
  Status log(Level level, std::string_view text) {
    static_assert(!std::is_same_v<Log, NoService>, "the protocol file maps no `log` under `services`");
    Log line{};
    line.level = static_cast<decltype(line.level)>(level);
    const std::size_t room = line.text.capacity;
    // Not `substr`: unoptimised, it asks for the C++ library's exception.
    static_cast<void>(line.text.assign({text.data(), text.size() < room ? text.size() : room}));
    return send(line);
  }

  // ---- one context: a task, the main loop, or an interrupt

  /// Everything that time and received bytes bring about. `now_us` was read before the call; it may wrap. The first
  /// call starts reception, deadlines and schedule; deadlines and schedule are as punctual as the calls, so a
  /// millisecond or two apart is good, and the receive ring must hold what comes meanwhile.
  void poll(std::uint32_t now_us) {
    now_us_.store(now_us, std::memory_order_relaxed);
    if (state() == LinkState::down) start(now_us);
    if (state() != LinkState::down) {
      receive(now_us);
      supervise(now_us);
    }
    deadlines_.poll(now_us, [&](std::uint8_t action) { Protocol::act(action, handler_); });
    schedule_.poll(now_us, handler_, [&](const auto& message) { static_cast<void>(send(message)); });
  }

  /// End a deadline with `recover: explicit` that has struck; its silence counts anew.
  template <class Action>
  void recover(Action action) {
    deadlines_.recover(static_cast<std::uint8_t>(action), now_us_.load(std::memory_order_relaxed));
  }
  template <class Action>
  bool struck(Action action) const {
    return deadlines_.struck(static_cast<std::uint8_t>(action));
  }

  LinkState state() const { return state_.load(std::memory_order_relaxed); }  ///< any context
  Peer peer() const { return peer_; }
  const LinkCounters& counters() const { return counters_; }
  ReceiveAccount receive_account() const { return ring_.account(); }
  std::size_t unread() const { return ring_.unread(); }
  const Inlet& receiver() const { return receiver_; }  ///< its bytes and violations
  SendAccount send_account() const { return outbox_.account(); }

  // ---- the UART's interrupt

  /// Half, full or idle: DMA moved on. Events may come in any order, merged, or in vain.
  void on_received() {
    if (state() == LinkState::down) return;  // not ours: where DMA stands before `start_receive` says nothing
    ring_.advance(port_.receive_position());
  }

  /// The run has left, its last bit included.
  void on_transmitted() {
    if (!transmitting_.load(std::memory_order_relaxed)) return;  // of a run that was broken off
    outbox_.sent();
    begin_run();
  }

  /// Framing, noise, overrun or DMA error. Where reception stopped by it, it is begun again at once.
  void on_error() {
    counters_.line_errors += 1;
    if (port_.receiving()) return;
    if (state() == LinkState::down) {
      wants_restart_.store(true, std::memory_order_relaxed);  // `start` may be just before the end of its work
    } else {
      restart_reception();
    }
  }

  /// What `Port::pend` asked for.
  void on_pended() {
    if (state() == LinkState::down) return;
    if (wants_restart_.load(std::memory_order_acquire)) restart_reception();
    if (wants_abort_.load(std::memory_order_acquire)) abort_run();
    if (!transmitting_.load(std::memory_order_relaxed)) begin_run();
  }

 private:
  static constexpr std::size_t longest_run_bytes =
      Protocol::max_run_bytes > Protocol::max_sent_bytes ? Protocol::max_run_bytes : Protocol::max_sent_bytes;
  /// Twice what the longest run takes, and what an interrupt may be late.
  static constexpr std::uint32_t transmit_timeout_us =
      10'000 + static_cast<std::uint32_t>(std::uint64_t{2'000'000} * longest_run_bytes / Protocol::bytes_per_second);

  /// Calls the services, then the handler.
  struct Inbox {
    Link& link;

    template <class Message>
    void on(const Message& message) {
      detail::serve<Protocol>(message, link.handler_, link.now(), link.peer_,
                              [this](const auto& answer) { static_cast<void>(link.send(answer)); });
      if constexpr (detail::HasOn<Handler, Message>::value) link.handler_.on(message);
      if constexpr (std::is_base_of_v<Subscribed, Handler>) Subscription<Message>::publish(message);
    }
    void unknown(const Frame& frame) { hand_over_unknown(frame, link.handler_); }
  };

  template <class Message>
  static constexpr std::uint8_t account_of() {
    return static_cast<std::uint8_t>(Message::Info::index);
  }

  template <class Message>
  Status refuse_range() {
    outbox_.refuse(Refusal::range, account_of<Message>());
    return Status::out_of_range;
  }

  std::uint16_t now_ms() const { return static_cast<std::uint16_t>(now() / 1000); }
  std::uint32_t now() const { return now_us_.load(std::memory_order_relaxed); }

  // ---- in poll

  void start(std::uint32_t now_us) {
    if (!is_timed_) {  // silence counts from here on, whether or not the port works
      is_timed_ = true;
      deadlines_.start(now_us);
      schedule_.start(now_us);
    }
    if (!port_.reaches(memory_.receive.data(), memory_.receive.size()) ||
        !port_.reaches(memory_.send.data(), memory_.send.size())) {
      return;
    }
    wants_restart_.store(false, std::memory_order_relaxed);  // by errors from before; one from now on counts
    if (!port_.start_receive(memory_.receive.data(), memory_.receive.size())) return;
    heard_us_ = line_moved_us_ = now_us;
    change(LinkState::stale);
    if constexpr (!std::is_same_v<typename Protocol::Hello::Message, NoService>) {
      static_cast<void>(send(detail::hello<Protocol>()));
    }
  }

  void receive(std::uint32_t now_us) {
    ring_.look([this] { return port_.receive_position(); });
    Inbox inbox{*this};
    const std::uint32_t frames = receiver_.account().frames;
    ReceiveRing::Span span = ring_.next();
    if (span.size == 0) {
      receiver_.idle(now_us, inbox, deadlines_);
    } else {
      line_moved_us_ = now_us;
    }
    for (; span.size != 0; span = ring_.next()) {
      receiver_.feed(span.data, span.size, now_us, inbox, deadlines_);
      ring_.consumed(span.size);
    }
    if (receiver_.account().frames != frames) {
      heard_us_ = now_us;
      change(LinkState::up);
    }
  }

  void supervise(std::uint32_t now_us) {
    if (state() == LinkState::up && now_us - heard_us_ >= timeout_us) change(LinkState::stale);
    bool asks = wants_run_.load(std::memory_order_relaxed) || wants_restart_.load(std::memory_order_relaxed);
    if (now_us - line_moved_us_ >= timeout_us) {
      line_moved_us_ = now_us;
      wants_restart_.store(true, std::memory_order_release);  // pairs with on_pended
      asks = true;
    }
    if (!transmitting_.load(std::memory_order_relaxed) || begun_.load(std::memory_order_relaxed)) {
      begun_.store(false, std::memory_order_relaxed);
      begun_us_ = now_us;
    } else if (now_us - begun_us_ >= transmit_timeout_us) {
      begun_us_ = now_us;
      wants_abort_.store(true, std::memory_order_release);  // pairs with on_pended
      asks = true;
    }
    if (asks) port_.pend();
  }

  void change(LinkState state) {
    if (state == this->state()) return;
    state_.store(state, std::memory_order_relaxed);
    if constexpr (detail::HasLinkState<Handler>::value) handler_.link_state(state);
  }

  // ---- in the UART's interrupt

  void restart_reception() {
    ring_.advance(port_.receive_position());
    if (port_.receiving() && !ring_.is_all_read()) {  // the line is not silent: bytes came since poll found it so
      wants_restart_.store(false, std::memory_order_relaxed);
      return;
    }
    // A byte that DMA takes from here on until the port has stopped it is lost, and nobody can count it.
    const bool done = ring_.can_restart() && port_.start_receive(memory_.receive.data(), memory_.receive.size());
    wants_restart_.store(!done, std::memory_order_relaxed);  // poll asks again
    if (!done) return;
    ring_.restart();
    counters_.receive_restarts += 1;
  }

  void abort_run() {
    wants_abort_.store(false, std::memory_order_relaxed);
    if (!transmitting_.load(std::memory_order_relaxed)) return;  // it left after all
    port_.stop_transmit();
    outbox_.aborted();
    transmitting_.store(false, std::memory_order_relaxed);
    counters_.transmit_timeouts += 1;
  }

  Run next_run() {
    if constexpr (Protocol::max_age_ms != 0) outbox_.expire_older(now_ms(), Protocol::max_age_ms);
    return outbox_.next(Protocol::max_run_bytes);
  }

  /// Hand the next run to the port. A sender that finds `transmitting_` relies on this being called again.
  void begin_run() {
    wants_run_.store(false, std::memory_order_relaxed);
    Run run = next_run();
    if (run.size == 0) {
      transmitting_.store(false, std::memory_order_seq_cst);  // pairs with `send`: who commits later, sees it and pends
      run = next_run();                                       // who committed before, is seen here
      if (run.size == 0) return;
    }
    begun_.store(true, std::memory_order_relaxed);
    transmitting_.store(true, std::memory_order_relaxed);
    if (port_.start_transmit(run.data, run.size)) return;
    transmitting_.store(false, std::memory_order_relaxed);
    counters_.transmit_retries += 1;
    wants_run_.store(true, std::memory_order_relaxed);  // poll asks again, and gets the same run
  }

  Handler& handler_;
  Port& port_;
  Memory& memory_;
  ReceiveRing ring_;
  Outbox<typename Memory::Config> outbox_;
  Inlet receiver_;
  Deadlines<Protocol::deadlines.size()> deadlines_;
  Schedule<typename Protocol::Scheduled> schedule_;
  LinkCounters counters_{};
  std::uint32_t heard_us_ = 0;              ///< the last valid frame
  std::uint32_t line_moved_us_ = 0;         ///< the last byte, or restart for want of one
  std::uint32_t begun_us_ = 0;              ///< about when the run with the port was begun
  std::atomic<std::uint32_t> now_us_{0};    ///< of the last poll
  std::atomic<bool> transmitting_{false};   ///< a run is with the port
  std::atomic<bool> wants_restart_{false};  ///< reception shall begin anew
  std::atomic<bool> wants_abort_{false};    ///< the run did not leave in time
  std::atomic<bool> wants_run_{false};      ///< the port did not take a run
  std::atomic<bool> begun_{false};          ///< since poll looked, a run was begun
  std::atomic<LinkState> state_{LinkState::down};
  Peer peer_ = Peer::unknown;
  bool is_timed_ = false;
};

}  // namespace wirebond
