// One supervised connection of an end: what came in goes to the handler, what is sent is queued, silence is noticed.
// The memory of both rings, the port that moves bytes, and the clock are the user's.
#pragma once

#include <atomic>
#include <cstddef>
#include <cstdint>
#include <string_view>
#include <type_traits>

#include "wirebond/deadline.hpp"
#include "wirebond/mcu/asked_addresses.hpp"
#include "wirebond/mcu/atomics.hpp"
#include "wirebond/mcu/buffers.hpp"
#include "wirebond/mcu/connection.hpp"
#include "wirebond/mcu/handshake.hpp"
#include "wirebond/mcu/line_errors.hpp"
#include "wirebond/mcu/outbox.hpp"
#include "wirebond/mcu/receive_age.hpp"
#include "wirebond/mcu/receive_ring.hpp"
#include "wirebond/mcu/schedule.hpp"
#include "wirebond/mcu/send_pause.hpp"
#include "wirebond/mcu/sent_numbers.hpp"
#include "wirebond/mcu/services.hpp"
#include "wirebond/mcu/subscription.hpp"
#include "wirebond/mcu/why.hpp"
#include "wirebond/message.hpp"
#include "wirebond/receiver.hpp"
#include "wirebond/status.hpp"
#include "wirebond/unlisted.hpp"

namespace wirebond {

/// How a link stands.
enum class LinkState : std::uint8_t {
  down,   ///< not started, its buffers are out of reach, or its port says that no program reads: nothing moves
  stale,  ///< it runs, and no valid frame came for `timeout_us`
  up,     ///< valid frames come
};

/// What happened to the line, the port and the polls, modulo 2^32.
struct LinkCounters {
  std::uint32_t line_errors = 0;        ///< error events, and looks at the UART's status that found an error
  std::uint32_t framing_errors = 0;     ///< of these looks, those that found this kind: 0 where the port does not look
  std::uint32_t noise_errors = 0;       ///< the same
  std::uint32_t overruns = 0;           ///< the same
  std::uint32_t parity_errors = 0;      ///< the same
  std::uint32_t receive_restarts = 0;   ///< reception was begun again, after an error or for silence
  std::uint32_t transmit_retries = 0;   ///< the port did not take a run: busy, or an error
  std::uint32_t transmit_timeouts = 0;  ///< a run did not leave in time, and was stopped
  std::uint32_t slow_polls = 0;         ///< more than half the shortest deadline at this end after the poll before
  std::uint32_t nested_polls = 0;       ///< polls that found the UART's interrupt at work, and returned at once
  std::uint32_t unserved_pends = 0;     ///< polls that found their last pend unserved, and pended again
  std::uint32_t late = 0;               ///< messages as old as their shortest deadline at this end when they were found
  std::uint32_t held_back = 0;          ///< messages held back by a deadline with `recover: explicit`
  std::uint32_t foreign = 0;            ///< frames for another address or, at a host, from one that was not asked
  std::uint32_t unlisted = 0;  ///< frames of messages that the file does not list, where checks count a seed: else 0
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
/// - where frames have header fields, these with the header as well: `void on(const Message&, const Header&)`,
///   `void unknown(const Frame&, const Header&)`, `bool fill(Message&, Header&)`. It finds there what `header()` gives.
///   A handler that has both for a message gets the call with the header
/// - `void link_state(LinkState)`: the state has changed
/// - `auto& parameters()`: its `Parameters`, for the parameter service
/// - `void parameter_set(index, value)`: a parameter was set; here it is stored
///
/// The compiler refuses an `on` for a message that only this end sends, because it would never be called. A class that
/// is the handler of links of both ends derives from `wirebond::ServesBothEnds`.
///
/// All of them run inside `poll`, in its context.
///
/// Contexts: `send` and `log` from any task or interrupt. `poll` from one: a task, the main loop, or an interrupt. The
/// `on_...` functions from the UART's interrupt and its DMA's, which must not interrupt each other; it may interrupt
/// everything else, also above an RTOS's limit, for nothing here calls an RTOS. A `poll` that interrupts the UART's
/// interrupt returns at once, and is counted: call it again soon.
///
/// **A stall.** Bytes are as old as the poll before the one that found them, or, where the port has a clock, as the
/// receive event before them. A message with a deadline at this end that is as old as the shortest of them, or older,
/// is counted as `late` and does not act: no handler, no subscription, no reply, no deadline put off. If there
/// was no poll for as long as the line takes to fill the receive ring, whatever is unread is dropped
/// (`ReceiveAccount::laps_unknown`).
template <class Protocol, class Handler, class Port, class Memory>
class Link : private SendPause<Protocol::pause_us>,
             private detail::LineErrorCounts<detail::TellsLineErrors<Port>::value>,
             private detail::SenderAddress<typename Protocol::Sends, names_receiver<typename Protocol::Receives>>,
             private SentNumbers<typename Protocol::Sends> {
 public:
  /// The silence of the peer after which the link is stale, and reception is begun again: a UART or its DMA may hang.
  static constexpr std::uint32_t timeout_us = 1'000'000;

  using Sends = typename Protocol::Sends;
  using Receives = typename Protocol::Receives;
  using Address = detail::AddressOf<Sends>;  ///< an unsigned integer, where frames have an `address`
  using Counts =
      std::conditional_t<counts_unlisted(Receives{}.format()), UnlistedByteCounts, ByteCounts<std::uint32_t>>;
  /// Can this end, a host, ask one of several MCUs, and see who answers? Where the file says `address: mcu`.
  static constexpr bool asks_one = names_receiver<Sends> && names_asked<Receives> && !names_receiver<Receives>;
  using Replies =
      std::conditional_t<asks_one, AskedAddresses<Receives, typename Memory::Config::Atomics>, Asked<Receives>>;
  using Inlet = Receiver<Receives, std::uint32_t, Counts, Replies>;

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

  /// Queue one message. Never blocks; any other answer than `ok` means that nothing was queued. `given`: nothing, or
  /// the frame's `Header`, best made by `header()`; a value there that breaks its field's rule is `out_of_range`. The
  /// link raises a sequence number, whatever the header says: the frame gets it as it is handed to DMA, so that numbers
  /// rise in the order of the wire, and what was refused, replaced or has expired leaves no gap.
  ///
  /// At a host, where frames carry the MCU's address: once a message with `reply` was sent, its reply is taken from the
  /// addresses that were asked for it, and from no other; see AskedAddresses. Others count in `counters().foreign`.
  template <class Message, class... Given>
  Status send(const Message& message, const Given&... given) {
    static_assert(Message::Info::sender == Protocol::end || Message::Info::sender == End::both,
                  "this message is sent by the other end");
    static_assert(sizeof...(Given) == 0 || has_header<Sends>,
                  "frames of this protocol have no header field; send the message alone");
    static_assert(sizeof...(Given) == 0 || detail::is_header<Sends, Given...> || detail::is_numbers<Sends, Given...>,
                  "beside the message, `send` takes the `Header` of its protocol and nothing else");
    if constexpr (sizeof...(Given) == 0 && names_sender<Sends>) {
      return send(message, numbers());
    } else if constexpr (detail::is_header<Sends, Given...>) {
      detail::HeaderNumbers<Sends> given_numbers;
      if (!write_header(given..., given_numbers.data())) return refuse_range<Message>();
      return send(message, given_numbers);
    } else {
      if (state() == LinkState::down) {
        outbox_.refuse(Refusal::down, account_of<Message>());
        return Status::link_down;
      }
      const std::size_t payload = payload_bytes(message);
      if (payload > Message::Info::max_payload_bytes) return refuse_range<Message>();
      const std::size_t room = frame_room<Sends, Message>(payload, given...);
      if (room == 0) return refuse_range<Message>();
      auto grant = outbox_.template reserve_for<Message>(room, stamp());
      if (!grant.ok()) return Status::queue_full;
      std::size_t size = 0;
      const Status status = encode_frame<Sends, Ending>(message, grant.data(), grant.size(), size, given...);
      if (status != Status::ok) {
        grant.give_back(Refusal::range);
      } else {
        if constexpr (asks_one && Message::Info::reply >= 0) note_request(Message::Info::reply, given...);
        grant.commit(size);
      }
      if (handshake_.offer()) port_.pend();  // also after a refusal: the room that was given back may be waited for
      return status;
    }
  }

  /// What `send` sends where it is given no header: the file's defaults for this end, and the own address where frames
  /// say whose they are. Change what you like, and send it.
  template <class Source = Sends>
  HeaderOf<Source> header() const {
    static_assert(has_header<Source>, "frames of this protocol have no header field");
    HeaderOf<Source> header = Source::header();
    read_header(numbers().data(), header);
    return header;
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
    if (in_event_.load(std::memory_order_relaxed)) {
      nested_polls_ += 1;
      return;
    }
    const std::uint32_t before_us = is_timed_ ? now() : now_us;
    now_us_.store(now_us, std::memory_order_relaxed);
    if (shortest_deadline_us != 0 && now_us - before_us > shortest_deadline_us / 2) slow_polls_ += 1;
    if (!detail::connected(port_)) {
      if constexpr (may_leave) leave(now_us);
    } else if (state() == LinkState::down) {
      start(now_us);
    } else {
      receive(before_us, now_us);
    }
    if (state() != LinkState::down) supervise(now_us);
    if constexpr (keeps_pause) pause().poll(now_us);
    strike(now_us, now_us);
    schedule_.poll(now_us, handler_, *this);
  }

  /// Does the link itself fill this message: that of the counters service, at the MCU?
  template <class Message>
  static constexpr bool fills =
      std::is_same_v<Message, typename Protocol::Counters::Message>&& Protocol::end == End::mcu;
  /// What was counted up to now. The context of `poll`; `poll` does it when the message is due.
  template <class Message>
  void fill(Message& message) const {
    static_assert(fills<Message>, "this is not the message of the `counters` service");
    Protocol::count(message, *this);
  }

  /// Where frames have an `address`: from here on act on those for this address and on broadcasts, and send it as the
  /// own one. Until then it is the file's default. False: the field cannot hold it, nothing has changed. Senders in
  /// other contexts may still use the old one for what they send now. An address of more than 32 bits: before anybody
  /// sends.
  bool set_address(Address address) { return own_address().set_address(address); }
  Address address() const { return own_address().address(); }  ///< any context
  /// Act on frames for every address, for a gateway or a monitor. What this end sends keeps its own address, and its
  /// services answer what is for that one.
  void listen_to_all() {
    if constexpr (asks_one) {
      receiver_.replies().listen_to_all();
    } else {
      receiver_.listen_to_all();
    }
  }

  /// Of the message or frame that the handler has now: a broadcast is acted on and not answered. Where frames name no
  /// receiver it is always `own`.
  Addressee addressee() const { return receiver_.addressee(); }

  /// End a deadline with `recover: explicit` that has struck: its message acts again, and all deadlines of the message
  /// begin again. Nothing happens where it has not struck. Also from within a handler.
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
  /// The context of `poll`.
  LinkCounters counters() const {
    return {line_errors_,
            this->framing(),
            this->noise(),
            this->overruns(),
            this->parity(),
            receive_restarts_,
            transmit_retries_,
            transmit_timeouts_,
            slow_polls_,
            nested_polls_,
            unserved_pends_,
            deadlines_.not_acted().late,
            deadlines_.not_acted().held_back,
            receiver_.foreign(),
            unlisted_frames()};
  }
  ReceiveAccount receive_account() const { return ring_.account(); }
  std::size_t unread() const { return ring_.unread(); }
  const Inlet& receiver() const { return receiver_; }  ///< its bytes and violations
  /// What the other end's sequence numbers told: how many of its frames are missing. Zeros where it sends none.
  SequenceCounts<std::uint32_t> sequence() const { return receiver_.sequence(); }
  SendAccount send_account() const { return outbox_.account(); }

  /// When `poll` has work that no interrupt tells of, for firmware that sleeps until then: 0 to 100 ms after `now_us`,
  /// which was read before the call. Poll also after each of the UART's interrupts; a `send` needs none. Deadlines,
  /// schedule and time-outs are then as punctual as with a poll every millisecond. Where the port has no clock it is at
  /// most half of the time in which the line fills the receive ring, because a later poll would drop what came.
  /// The context of `poll`; it takes flash only where it is called.
  std::uint32_t next_due_us(std::uint32_t now_us) const {
    constexpr std::uint32_t longest_sleep_us = 100'000;
    constexpr std::uint32_t retry_us = 1'000;
    std::uint32_t left_us = schedule_.template time_left<Handler, Link>(now_us, longest_sleep_us);
    const auto within = [&](std::uint32_t limit_us) { left_us = limit_us < left_us ? limit_us : left_us; };
    within(deadlines_.time_left(now_us));
    const bool sees_stalls = (Age::is_stamped && detail::clock_runs(port_, 0)) || detail::tells_every_lap(port_, 0);
    if (!sees_stalls) within(fill_us / 2);  // a later poll would drop what came
    if (state() == LinkState::down || keeps_pause) within(retry_us);
    const auto line = handshake_.look();
    if (line.asks() || line.begun()) within(retry_us);  // asked again, or measured from then on
    if (!detail::MayWait<Port>::value && line.line() == Line::sending)
      within(time_left(begun_us_, transmit_timeout_us, now_us));
    if (receiver_.pending() != 0) within(Receives::idle_us / 2);
    within(time_left(line_moved_us_, timeout_us, now_us));
    if (state() == LinkState::up) within(time_left(heard_us_, timeout_us, now_us));
    return now_us + left_us;
  }

  /// What keeps the link from working, as far as it can tell: it asks the port how it is set up, and looks at what
  /// happened so far. `text_of` makes a sentence of it. The context of `poll`; it takes flash only where it is called.
  Why why() const {
    if (!is_timed_) return Why::not_polled;
    if (!reaches_buffers()) return Why::buffers_unreachable;
    const Why setup = detail::check_port(port_, Protocol::baud, 0);
    if (setup != Why::nothing && setup != Why::tick_below_uart) return setup;
    if (!detail::connected(port_)) return Why::not_connected;
    if (state() == LinkState::down) return Why::port_refuses;
    if (unserved_in_row_ >= 2) return Why::pends_unserved;
    if (reception_stops_ || (!port_.receiving() && !handshake_.look().restart())) return Why::reception_stops;
    if (transmit_timeouts_ != 0 && send_account().sent == 0) return Why::runs_not_completed;
    const bool heard = heard_frames() != 0;
    if (!heard && (receiver_.bytes() != 0 || line_errors_ != 0)) return Why::nothing_understood;
    if (!heard || state() == LinkState::stale) return Why::nothing_heard;
    const ReceiveAccount received = receive_account();
    if (line_errors_ > received.received / bytes_per_error) return Why::many_line_errors;
    if (received.laps != 0 || received.laps_unknown != 0) return Why::polled_too_seldom;
    return setup;
  }

  // ---- the UART's interrupt

  /// Half, full or idle: DMA moved on. Events may come in any order, merged, or without news.
  void on_received() {
    const Event event(in_event_);
    if (state() == LinkState::down) return;  // not ours: where DMA stands before `start_receive` says nothing
    look_for_errors();
    [[maybe_unused]] const std::uint32_t position = ring_.advance(port_.receive_position());
    if constexpr (Age::is_stamped) {
      if (detail::clock_runs(port_, 0)) age_.stamp(position, port_.now_us(), fill_us);
    }
  }

  /// The run has left, its last bit included.
  void on_transmitted() {
    const Event event(in_event_);
    if (!handshake_.complete()) return;  // of a run that was stopped
    outbox_.sent();
    if constexpr (keeps_pause) begin_pause();
    send_next();
  }

  /// Framing, noise, overrun or DMA error. Where reception stopped by it, it is begun again as soon as `poll` has read
  /// what came before: at once, or in the interrupt that the next `poll` pends.
  void on_error() {
    const Event event(in_event_);
    line_errors_ += 1;
    if (port_.receiving()) return;
    if (state() == LinkState::down) {
      handshake_.ask_restart();  // `start` may be just before the end of its work
    } else {
      restart_reception();
    }
  }

  /// What `Port::pend` asked for.
  void on_pended() {
    const Event event(in_event_);
    if (state() == LinkState::down) {
      if constexpr (may_leave) clear_line();
      return;
    }
    look_for_errors();
    if (handshake_.look().restart()) restart_reception();
    switch (handshake_.take()) {
      case LineWord::Work::none: return;
      case LineWord::Work::abort: abort_run(); break;
      case LineWord::Work::look: break;
    }
    send_next();
  }

 private:
  static constexpr std::size_t longest_run_bytes =
      Protocol::max_run_bytes > Protocol::max_sent_bytes ? Protocol::max_run_bytes : Protocol::max_sent_bytes;
  /// Twice what the longest run takes, and what an interrupt may be late.
  static constexpr std::uint32_t transmit_timeout_us =
      10'000 + static_cast<std::uint32_t>(std::uint64_t{2'000'000} * longest_run_bytes / Protocol::bytes_per_second);

  /// `why` names the line where there are more errors than one in this many bytes.
  static constexpr std::uint32_t bytes_per_error = 1'000;

  /// What the line takes at least to fill the receive ring.
  static constexpr std::uint32_t fill_us = static_cast<std::uint32_t>(
      std::uint64_t{1'000'000} * std::tuple_size<decltype(Memory::receive)>::value / Protocol::bytes_per_second);
  /// What a byte takes on the line, rounded up.
  static constexpr std::uint32_t byte_us = (1'000'000 + Protocol::bytes_per_second - 1) / Protocol::bytes_per_second;
  /// Of all at this end; 0: there is none.
  static constexpr std::uint32_t shortest_deadline_us = shortest(Protocol::deadlines);
  /// Ages of frames are counted in units of 1024 us, which wrap where the clock does; rounded so that none expires
  /// early.
  static constexpr std::uint16_t max_age_units =
      static_cast<std::uint16_t>((Protocol::max_age_ms * std::uint32_t{1000} + 1023) / 1024);

  /// Can the port say that no program reads?
  static constexpr bool may_leave = detail::TellsConnection<Port>::value;

  /// Does silence end a frame? Then a run is one frame, and the next one waits for the pause.
  static constexpr bool keeps_pause = Protocol::pause_us != 0;

  using Numbers = SentNumbers<Sends>;
  using Ending = std::conditional_t<Numbers::has_numbers, Waiting, Sealed>;
  using LineWord = wirebond::Handshake<typename Memory::Config::Atomics>;
  using Age = ReceiveAge<detail::HasClock<Port>::value>;

  /// The UART's interrupt is at work, and what `poll` would read is in between two states. Only that interrupt writes
  /// the flag; a `poll` that finds it has interrupted it.
  class Event {
   public:
    explicit Event(LoadStore<bool>& flag) : flag_(flag), before_(flag.load(std::memory_order_relaxed)) {
      flag_.store(true, std::memory_order_relaxed);
      std::atomic_signal_fence(std::memory_order_seq_cst);
    }
    ~Event() {
      std::atomic_signal_fence(std::memory_order_seq_cst);
      flag_.store(before_, std::memory_order_relaxed);  // a port may tell of an event within its `start_transmit`
    }
    Event(const Event&) = delete;
    Event& operator=(const Event&) = delete;

   private:
    LoadStore<bool>& flag_;
    bool before_;
  };

  /// Calls the services, then the handler.
  struct Inbox {
    Link& link;

    template <class Message, class... Header>
    void on(const Message& message, const Header&... header) {
      static_assert(detail::RightOn<Handler, Message, HeaderOf<Receives>>::value);
      if constexpr (names_receiver<Receives>) {
        const Addressee to = link.receiver_.addressee();
        if (to != Addressee::another) {
          detail::serve<Protocol>(message, link.handler_, link.template times_for<Message>(), link.peer_,
                                  [&](const auto& answer) {
                                    if (to == Addressee::own) link.answer(answer, header...);
                                  });
        }
      } else {
        detail::serve<Protocol>(message, link.handler_, link.template times_for<Message>(), link.peer_,
                                [&](const auto& answer) { link.answer(answer, header...); });
      }
      if constexpr (detail::HasOnWithHeader<Handler, Message, HeaderOf<Receives>>::value) {
        link.handler_.on(message, header...);
      } else if constexpr (detail::HasOn<Handler, Message>::value) {
        link.handler_.on(message);
      }
      if constexpr (std::is_base_of_v<Subscribed, Handler>) Subscription<Message>::publish(message, header...);
    }
    void unknown(const Frame& frame) { hand_over_unknown<Receives>(frame, link.handler_); }
  };

  /// What a service answers goes to whoever asked.
  template <class Message, class... Header>
  void answer(const Message& message, [[maybe_unused]] const Header&... header) {
    if constexpr (names_receiver<Sends> && names_sender<Receives>) {
      detail::HeaderNumbers<Receives> came = detail::default_numbers<Receives>;
      static_cast<void>(write_header(header..., came.data()));  // it has kept its fields' rules
      auto given = numbers();
      given[Sends::receiver_place] = came[Receives::sender_place];
      static_cast<void>(send(message, given));
    } else {
      static_cast<void>(send(message));
    }
  }

  template <class Source = Sends>
  detail::HeaderNumbers<Source> numbers() const {
    detail::HeaderNumbers<Source> numbers = detail::default_numbers<Source>;
    if constexpr (names_sender<Source>) numbers[Source::sender_place] = address();
    return numbers;
  }

  void note_request(std::int16_t reply) { note_request(reply, detail::default_numbers<Sends>); }
  void note_request(std::int16_t reply, const detail::HeaderNumbers<Sends>& numbers) {
    receiver_.replies().asks(reply, static_cast<Address>(numbers[Sends::receiver_place]));
  }

  // Where frames name their receiver, the receiver keeps the own address; else the link does, if it sends one.
  using SenderAddress = detail::SenderAddress<Sends, names_receiver<Receives>>;
  auto& own_address() {
    if constexpr (names_receiver<Receives>) {
      return receiver_;
    } else {
      return static_cast<SenderAddress&>(*this);
    }
  }
  const auto& own_address() const { return const_cast<Link&>(*this).own_address(); }

  template <class Message>
  static constexpr std::uint8_t account_of() {
    return static_cast<std::uint8_t>(Message::Info::index);
  }

  template <class Message>
  Status refuse_range() {
    outbox_.refuse(Refusal::range, account_of<Message>());
    return Status::out_of_range;
  }

  static std::uint32_t time_left(std::uint32_t since_us, std::uint32_t limit_us, std::uint32_t now_us) {
    return now_us - since_us < limit_us ? since_us + limit_us - now_us : 0;
  }

  std::uint16_t stamp() const { return static_cast<std::uint16_t>(now() >> 10); }  ///< see max_age_units
  std::uint32_t now() const { return now_us_.load(std::memory_order_relaxed); }
  /// A port's clock is asked for the clock service alone.
  template <class Message>
  detail::ServiceTimes times_for() const {
    if constexpr (Age::is_stamped && std::is_same_v<Message, typename Protocol::Clock::Request>) {
      if (detail::clock_runs(port_, 0)) return {age_.came_us(now()), port_.now_us()};
    }
    return {now(), now()};
  }

  bool reaches_buffers() const {
    return port_.reaches(memory_.receive.data(), memory_.receive.size()) &&
           port_.reaches(memory_.send.data(), memory_.send.size());
  }

  // ---- in poll

  void start(std::uint32_t now_us) {
    if (!is_timed_) {  // silence counts from here on, whether or not the port works
      is_timed_ = true;
      deadlines_.start(now_us);
      schedule_.start(now_us);
    }
    if (!reaches_buffers()) return;
    if constexpr (may_leave) {
      if (waits_.load(std::memory_order_acquire)) return port_.pend();  // pairs with `clear_line`
      ring_.begin_again();
    }
    handshake_.restarted();  // by errors from before; one from now on counts
    if (!port_.start_receive(memory_.receive.data(), memory_.receive.size())) return;
    heard_us_ = line_moved_us_ = now_us;
    age_.start(now_us);
    change(LinkState::stale);
    if constexpr (!std::is_same_v<typename Protocol::Hello::Message, NoService>) {
      static_cast<void>(send(detail::hello<Protocol>()));
    }
  }

  /// No program reads. What waits expires, and so does what a sender finishes from now on.
  void leave(std::uint32_t now_us) {
    if (!is_timed_) {
      is_timed_ = true;
      deadlines_.start(now_us);
      schedule_.start(now_us);
    }
    if (state() != LinkState::down) {
      Inbox inbox{*this};
      receiver_.give_up(now_us, inbox, deadlines_);
      peer_ = Peer::unknown;
      change(LinkState::down);
    }
    waits_.store(true, std::memory_order_release);  // pairs with `clear_line`
    port_.pend();
  }

  void receive(std::uint32_t before_us, std::uint32_t now_us) {
    const bool is_late = age_.is_late(before_us, now_us, fill_us);
    if (!ring_.look([this] { return port_.receive_position(); }))
      return;  // on another core, the UART's interrupt restarts
    static_assert(detail::has_ons_of_right_end<Handler, Receives>);
    Inbox inbox{*this};
    const std::uint32_t frames = heard_frames();
    const ReceiveRing::Count read = ring_.position();
    if (is_late && !detail::tells_every_lap(port_, 0)) {
      ring_.drop_unread();
      receiver_.give_up(now_us, inbox, deadlines_);
    }
    ReceiveRing::Span span = ring_.next();
    if (span.size == 0) receiver_.idle(now_us, inbox, deadlines_);
    for (; span.size != 0; span = ring_.next()) {
      Aged bytes = age_.first(ring_.position(), span.size, before_us, now_us);
      if constexpr (Age::is_stamped) {
        // An event may be newer than `now_us`, which was read before the call.
        if (bytes.came_us - before_us > now_us - before_us) bytes.came_us = now_us;
        strike(bytes.came_us, now_us);  // by the silence before these bytes
        // An idle event comes a byte's time after the last byte; half and full come at once.
        const std::size_t end = ring_.place() + bytes.size;
        const bool is_idle = bytes.ends_at_event && end % (memory_.receive.size() / 2) != 0;
        age_.note_came(bytes.until_us - (is_idle ? byte_us : 0));
      }
      receiver_.feed(span.data, bytes.size, bytes.came_us, now_us, inbox, deadlines_);
      if constexpr (keeps_pause) receiver_.last_came_at(bytes.until_us);
      ring_.consumed(bytes.size);
    }
    if (ring_.position() != read) line_moved_us_ = now_us;
    detail::read_to(port_, ring_.place(), 0);
    if (heard_frames() != frames) {
      heard_us_ = now_us;
      change(LinkState::up);
    }
  }

  /// Frames that say that the peer speaks: also those of messages that the file does not list.
  std::uint32_t heard_frames() const { return receiver_.account().frames + unlisted_frames(); }

  std::uint32_t unlisted_frames() const {
    if constexpr (std::is_same_v<Counts, UnlistedByteCounts>) {
      return receiver_.account().unlisted.frames();
    } else {
      return 0;
    }
  }

  void strike(std::uint32_t at_us, std::uint32_t now_us) {
    deadlines_.poll(at_us, now_us, [&](std::uint8_t action) { Protocol::act(action, handler_); });
  }

  void supervise(std::uint32_t now_us) {
    if (state() == LinkState::up && now_us - heard_us_ >= timeout_us) change(LinkState::stale);
    const auto line = handshake_.look();
    const bool is_silent = now_us - line_moved_us_ >= timeout_us;
    bool asks = line.asks() || is_silent;
    if (is_silent) {
      line_moved_us_ = now_us;
      reception_stops_ = !port_.receiving();
    }
    count_unserved(line.asks() && line.reminded());
    if (is_silent || line.begun()) handshake_.note(is_silent);
    if (detail::MayWait<Port>::value || line.begun() || line.line() != Line::sending) {
      begun_us_ = now_us;
    } else if (now_us - begun_us_ >= transmit_timeout_us) {
      begun_us_ = now_us;
      if (handshake_.ask_abort()) asks = true;
    }
    if (!asks) return;
    handshake_.remind();
    port_.pend();
  }

  void count_unserved(bool is_unserved) {
    unserved_pends_ += is_unserved ? 1 : 0;
    if (!is_unserved) {
      unserved_in_row_ = 0;
    } else if (unserved_in_row_ != 0xFF) {
      ++unserved_in_row_;
    }
  }

  void change(LinkState state) {
    if (state == this->state()) return;
    state_.store(state, std::memory_order_relaxed);
    if constexpr (detail::HasLinkState<Handler>::value) handler_.link_state(state);
  }

  // ---- in the UART's interrupt

  void look_for_errors() {
    if constexpr (detail::TellsLineErrors<Port>::value) {
      const LineErrors errors = port_.take_line_errors();
      if (!errors.any()) return;
      line_errors_ += 1;
      this->count(errors);
    }
  }

  WIREBOND_NOINLINE void restart_reception() {
    ring_.advance(port_.receive_position());
    if (port_.receiving() && !ring_.is_all_read()) {  // the line is not silent: bytes came since poll found it so
      handshake_.restarted();
      return;
    }
    handshake_.ask_restart();  // until it is done: poll reads what is left, and asks again
    if (!ring_.is_all_read()) return;
    ring_.begin_restart();
    // A byte that DMA takes from here on until the port has stopped it is lost and cannot be counted.
    if (port_.start_receive(memory_.receive.data(), memory_.receive.size())) {
      ring_.restart();
      receive_restarts_ += 1;
      handshake_.restarted();
    }
    ring_.end_restart();
  }

  /// The link is down: a run that is under way is broken off, and the rest expires.
  void clear_line() {
    if (!waits_.load(std::memory_order_acquire)) return;  // pairs with `leave`
    if (handshake_.look().line() == Line::sending) port_.stop_transmit();
    outbox_.aborted();
    outbox_.expire_all();
    handshake_.halt();
    detail::stop_receive(port_, 0);
    waits_.store(false, std::memory_order_release);  // pairs with `start`
  }

  /// The line is looking, so no event of the old run changes it any more.
  void abort_run() {
    port_.stop_transmit();
    outbox_.aborted();
    if constexpr (keeps_pause) begin_pause();
    transmit_timeouts_ += 1;
  }

  SendPause<Protocol::pause_us>& pause() { return *this; }

  void begin_pause() {
    if constexpr (detail::HasClock<Port>::value) {
      if (detail::clock_runs(port_, 0)) return pause().begin_at(port_.now_us());
    }
    pause().begin();
  }

  Run next_run() {
    if constexpr (Protocol::max_age_ms != 0) outbox_.expire_older(stamp(), max_age_units);
    constexpr std::size_t most = keeps_pause ? 0 : Protocol::max_run_bytes;  // 0: one frame
    if constexpr (Numbers::has_numbers) {
      return outbox_.next(most, [this](std::uint8_t* waiting, std::size_t room, std::uint8_t message) {
        return this->close(waiting, room, message);
      });
    } else {
      return outbox_.next(most);
    }
  }

  /// The line is looking: hand the next run to the port, or rest.
  WIREBOND_NOINLINE void send_next() {
    if constexpr (keeps_pause) {
      if (!pause().is_over()) return handshake_.refuse();  // `poll` pends again
    }
    Run run = next_run();
    while (run.size == 0) {
      if (handshake_.rest()) return;
      run = next_run();
    }
    handshake_.found();
    if (port_.start_transmit(run.data, run.size)) return;
    handshake_.refuse();
    transmit_retries_ += 1;
  }

  Handler& handler_;
  Port& port_;
  Memory& memory_;
  ReceiveRing ring_;
  Age age_;
  LineWord handshake_;
  Outbox<typename Memory::Config> outbox_;
  Inlet receiver_;
  Deadlines<Protocol::deadlines.size()> deadlines_;
  Schedule<typename Protocol::Scheduled> schedule_;
  std::uint32_t line_errors_ = 0;  ///< these four by the UART's interrupt
  std::uint32_t receive_restarts_ = 0;
  std::uint32_t transmit_retries_ = 0;
  std::uint32_t transmit_timeouts_ = 0;
  std::uint32_t slow_polls_ = 0;
  std::uint32_t nested_polls_ = 0;
  std::uint32_t unserved_pends_ = 0;
  std::uint32_t heard_us_ = 0;          ///< the last valid frame
  std::uint32_t line_moved_us_ = 0;     ///< the last byte, or restart for want of one
  std::uint32_t begun_us_ = 0;          ///< about when the run with the port was begun
  LoadStore<std::uint32_t> now_us_{0};  ///< of the last poll
  LoadStore<bool> in_event_{false};     ///< the UART's interrupt is at work
  LoadStore<bool> waits_{false};        ///< frames wait that shall expire, for the link went down; by both
  LoadStore<LinkState> state_{LinkState::down};
  Peer peer_ = Peer::unknown;
  bool is_timed_ = false;
  bool reception_stops_ = false;      ///< when the line was silent last, no reception was under way
  std::uint8_t unserved_in_row_ = 0;  ///< polls that found their last pend unserved, 255 at most
};

}  // namespace wirebond
