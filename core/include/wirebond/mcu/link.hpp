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
#include "wirebond/mcu/driver_enable.hpp"
#include "wirebond/mcu/handshake.hpp"
#include "wirebond/mcu/line_errors.hpp"
#include "wirebond/mcu/link_counters.hpp"
#include "wirebond/mcu/link_echo.hpp"
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

namespace detail {

/// Of what is handed to DMA at once.
template <class Protocol>
inline constexpr std::size_t longest_run_bytes =
    Protocol::max_run_bytes > Protocol::max_sent_bytes ? Protocol::max_run_bytes : Protocol::max_sent_bytes;

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
             private detail::LinkEcho<Protocol::echoes, detail::longest_run_bytes<Protocol>>,
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
            unlisted_frames(),
            echo().echoed(),
            echo().collisions()};
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
  std::uint32_t next_due_us(std::uint32_t now_us) const;

  /// What keeps the link from working, as far as it can tell: it asks the port how it is set up, and looks at what
  /// happened so far. `text_of` makes a sentence of it. The context of `poll`; it takes flash only where it is called.
  Why why() const;

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
    if constexpr (detail::WantsFreeLine<Port>::value) free_line();
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
    if constexpr (detail::WantsFreeLine<Port>::value) free_line();
  }

 private:
  /// Twice what the longest run takes, and what an interrupt may be late.
  static constexpr std::uint32_t transmit_timeout_us =
      10'000 + static_cast<std::uint32_t>(std::uint64_t{2'000'000} * detail::longest_run_bytes<Protocol> /
                                          Protocol::bytes_per_second);
  /// When own bytes are not expected to be heard any more. A UART hears each with its last bit; at a host an adapter
  /// may hold them back.
  static constexpr std::uint32_t echo_timeout_us =
      Protocol::end == End::mcu ? transmit_timeout_us / 2 : transmit_timeout_us + Receives::idle_us;

  /// `why` names a port that has refused so many runs in its polls, and taken none.
  static constexpr std::uint32_t retries_when_stuck = 100;
  /// `why` names the line where there are more errors than one in this many bytes.
  static constexpr std::uint32_t bytes_per_error = 1'000;
  /// The same for runs that collide, in frames.
  static constexpr std::uint32_t frames_per_collision = 100;

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
    /// A request that breaks a field's rule does not act; that of a parameter is refused, so that nobody waits.
    template <class Message, class... Header>
    std::enable_if_t<detail::asks_parameter<Protocol, Message>> on_rejected(const Message& message,
                                                                            const Header&... header) {
      if (link.addressee() != Addressee::own) return;
      link.answer(detail::parameter_refusal<Protocol>(message, link.handler_), header...);
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

  void start(std::uint32_t now_us);

  /// No program reads. What waits expires, and so does what a sender finishes from now on.
  void leave(std::uint32_t now_us);

  void receive(std::uint32_t before_us, std::uint32_t now_us);

  /// All that came was heard. `fed`: bytes of others before that.
  void end_hearing(std::uint32_t fed, std::uint32_t now_us, Inbox& inbox);

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

  void supervise(std::uint32_t now_us);

  void count_unserved(bool is_unserved);

  void change(LinkState state) {
    if (state == this->state()) return;
    state_.store(state, std::memory_order_relaxed);
    if constexpr (detail::HasLinkState<Handler>::value) handler_.link_state(state);
  }

  // ---- in the UART's interrupt

  void look_for_errors();

  WIREBOND_NOINLINE void restart_reception();

  /// The link is down: a run that is under way is broken off, and the rest expires.
  void clear_line();

  /// The line is looking, so no event of the old run changes it any more.
  void abort_run();

  SendPause<Protocol::pause_us>& pause() { return *this; }

  using EchoKeeper = detail::LinkEcho<Protocol::echoes, detail::longest_run_bytes<Protocol>>;
  EchoKeeper& echo() { return *this; }
  const EchoKeeper& echo() const { return *this; }

  void begin_pause();

  Run next_run();

  /// Where a pin enables a driver. Not a part of `send_next`: unoptimised, each call within another one takes stack.
  void free_line();

  /// The line is looking: hand the next run to the port, or rest.
  WIREBOND_NOINLINE void send_next();

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

// The longer functions, an idea in each file.
#include "wirebond/mcu/link_presence.hpp"
#include "wirebond/mcu/link_receiving.hpp"
#include "wirebond/mcu/link_sending.hpp"
#include "wirebond/mcu/link_timing.hpp"
#include "wirebond/mcu/link_why.hpp"
