// One supervised connection of an end: delivers received messages to the handler, queues messages to send, detects
// silence. The user provides the memory of both rings, the port that moves bytes, and the clock.
// One file: an interrupt and a loop share its state, and who may touch what shows only side by side.
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
#include "wirebond/mcu/own_frames.hpp"
#include "wirebond/mcu/receive_age.hpp"
#include "wirebond/mcu/receive_ring.hpp"
#include "wirebond/mcu/schedule.hpp"
#include "wirebond/mcu/send_age.hpp"
#include "wirebond/mcu/send_pause.hpp"
#include "wirebond/mcu/sent_numbers.hpp"
#include "wirebond/mcu/services.hpp"
#include "wirebond/mcu/spoken.hpp"
#include "wirebond/mcu/subscription.hpp"
#include "wirebond/mcu/time_base.hpp"
#include "wirebond/mcu/why.hpp"
#include "wirebond/message.hpp"
#include "wirebond/receiver.hpp"
#include "wirebond/status.hpp"
#include "wirebond/unlisted.hpp"

namespace wirebond {

namespace detail {

/// Maximum number of bytes given to DMA at once.
template <class Protocol>
inline constexpr std::size_t longest_run_bytes =
    Protocol::max_run_bytes > Protocol::max_sent_bytes ? Protocol::max_run_bytes : Protocol::max_sent_bytes;

template <class Handler, class = void>
struct HasLinkState : std::false_type {};
template <class Handler>
struct HasLinkState<Handler, std::void_t<decltype(std::declval<Handler&>().link_state(LinkState::up))>>
    : std::true_type {};

}  // namespace detail

/// `Protocol`: an end of a generated header (`diffdrive::McuLink` fills it in). `Port`: see docs/firmware.md. `Memory`:
/// a `Buffers`.
///
/// `handler` must have a function for each `then:` of the file's deadlines at this end, such as `void stop()`. These
/// are optional:
/// - `void on(const Message&)`: a message came and passed its field rules
/// - `void unknown(const Frame&)`: a frame of no known message came
/// - `bool fill(Message&)`: a message with `every:` is due; false: not this time
/// - where frames have header fields, these with the header as well: `void on(const Message&, const Header&)`,
///   `void unknown(const Frame&, const Header&)`, `bool fill(Message&, Header&)`, whose header begins as `header()`. If
///   a handler has both for a message, the one with the header is called
/// - `void link_state(LinkState)`: the state has changed
/// - `auto& parameters()`: its `Parameters`, for the parameter service
/// - `void parameter_set(index, value)`: a parameter was set; store it here
///
/// The compiler refuses an `on` for a message that only this end sends, because it would never be called. Derive from
/// `wirebond::ServesBothEnds` if the class handles links of both ends.
///
/// All of them run inside `poll`, in its context. A `poll` called from one of them does nothing, and is counted: it
/// would read the same bytes again, and nest handlers.
///
/// Contexts: `send` and `log` from any task or interrupt. `poll` from one context: a task, the main loop, or an
/// interrupt. The `on_...` functions from the UART's interrupt and its DMA's, which must not interrupt each other; they
/// may interrupt everything else, even above an RTOS's priority limit, because nothing here calls an RTOS. A `poll`
/// that interrupts the UART's interrupt returns at once, and is counted: call it again soon.
///
/// **A stall.** Bytes are as old as the poll before the one that found them or, if the port has a clock, as the receive
/// event before them. A message with a deadline at this end that is as old as the shortest of them, or older, counts as
/// `late` and does not act: no handler, no subscription, no reply, no deadline put off. With a clock this is decided
/// just before the message acts, so a slow handler makes the messages after it late. Without one it is decided by the
/// time that was passed to `poll`: a message that waits for a slow handler acts as if no time had passed. If there was
/// no poll for as long as the line takes to fill the receive ring, unread bytes are dropped
/// (`ReceiveAccount::laps_unknown`).
template <class Protocol, class Handler, class Port, class Memory>
class Link : private SendPause<Protocol::pause_us>,
             private SendAge<Protocol::max_age_ms>,
             private detail::TimeReference<detail::HasTick<Port>::value || detail::HasClock<Port>::value>,
             private detail::LineErrorCounts<detail::TellsLineErrors<Port>::value>,
             private detail::LinkEcho<Protocol::echoes, detail::longest_run_bytes<Protocol>>,
             private detail::SenderAddress<typename Protocol::Sends, names_receiver<typename Protocol::Receives>>,
             private SentNumbers<typename Protocol::Sends>,
             private detail::SpokenVersion<Protocol>,
             private detail::OwnFrames<detail::remembers_own<Protocol>>,
             private detail::OwnCount<detail::remembers_own<Protocol> || detail::sees_own_ids<Protocol>> {
 public:
  /// Silence of the peer after which the link is stale, and reception is restarted: a UART or its DMA may hang.
  static constexpr std::uint32_t timeout_us = stale_after_us;

  using Sends = typename Protocol::Sends;
  using Receives = typename Protocol::Receives;
  using Address = detail::AddressOf<Sends>;  ///< an unsigned integer, if frames have an `address`
  using Counts = std::conditional_t<counts_unlisted(Receives{}.format()), detail::UnlistedByteCountsBut<Sends>,
                                    ByteCounts<std::uint32_t>>;
  /// Whether this end, a host, can ask one of several MCUs and knows which one replies: the file says `address: mcu`.
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

  /// Queue one message. Never blocks; any result other than `ok` means that nothing was queued. `given`: nothing, or
  /// the frame's `Header`, best made by `header()`; a value there that breaks its field's rule is `out_of_range`. The
  /// link sets the sequence number, whatever the header holds: the frame gets it as it is given to DMA, so numbers rise
  /// in the order of the wire, and refused, replaced or expired frames leave no gap.
  ///
  /// At a host, where frames carry the MCU's address: after a message with `reply` was sent, its reply is accepted only
  /// from addresses that were asked for it; see AskedAddresses. Others count in `counters().foreign`.
  template <class Message, class... Given>
  Status send(const Message& message, const Given&... given) {
    static_assert(Message::Info::sender == Protocol::end || Message::Info::sender == End::both,
                  "this message is sent by the other end");
    static_assert(sizeof...(Given) == 0 || has_header<Sends>,
                  "frames of this protocol have no header field; send the message alone");
    static_assert(sizeof...(Given) == 0 || detail::is_header<Sends, Given...> || detail::is_numbers<Sends, Given...>,
                  "beside the message, `send` takes the `Header` of its protocol and nothing else");
    if constexpr (sizeof...(Given) == 0 && (names_sender<Sends> || follows_host)) {
      return send(message, numbers());
    } else if constexpr (detail::is_header<Sends, Given...>) {
      detail::HeaderNumbers<Sends> given_numbers;
      if (!write_header(given..., given_numbers.data())) return refuse_range<Message>();
      return send(message, given_numbers);
    } else if constexpr (follows_host) {
      return queue(message, this->template spoken<Message>(given..., payload_bytes(message)));
    } else {
      return queue(message, given...);
    }
  }

  /// Return the header that `send` uses by default: the file's defaults for this end, and the own address if frames
  /// name their sender. Change it as needed, and pass it to `send`.
  template <class Source = Sends>
  HeaderOf<Source> header() const {
    static_assert(has_header<Source>, "frames of this protocol have no header field");
    HeaderOf<Source> header = Source::header();
    read_header(numbers().data(), header);
    return header;
  }

  /// Queue one line for the host, by the log service; text longer than the message's field is cut. Log lines, including
  /// those whose text is in the file, take at most half of the send queue: a flood of them does not make `send` refuse
  /// other messages. Returns `queue_full` if that half is full.
  template <class Log = typename Protocol::Log::Message>
  Status log(Level level, std::string_view text) {
    static_assert(!std::is_same_v<Log, NoService>, "the protocol file maps no `log` under `services`");
    Log line{};
    line.level = static_cast<decltype(line.level)>(level);
    const std::size_t room = line.text.capacity;
    // Not `substr`: without optimisation it needs an exception of the C++ library.
    static_cast<void>(line.text.assign({text.data(), text.size() < room ? text.size() : room}));
    return send(line);
  }

  // ---- one context: a task, the main loop, or an interrupt

  /// Process received bytes and passing time. `now_us` was read before the call; it may wrap. A step back of a second
  /// or less is counted (`counters().clock_steps`), and no time passes by it. The first call starts reception,
  /// deadlines and schedule. Deadlines and schedule are as punctual as the calls: call it every millisecond or two; the
  /// receive ring must hold the bytes that come in between.
  void poll(std::uint32_t given_us) {
    if (in_event_.load(std::memory_order_relaxed) || in_poll_.load(std::memory_order_relaxed)) {
      nested_polls_ += 1;
      return;
    }
    const Inside polling(in_poll_);
    const std::uint32_t before_us = is_timed_ ? now() : given_us;
    const std::uint32_t now_us = time_.follow(given_us, before_us);
    Reference::compare(port_, now_us);
    now_us_.store(now_us, std::memory_order_relaxed);
    if (state() != LinkState::down && this->age_to(now_us)) port_.pend();
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

  /// Poll with a clock of milliseconds, such as HAL_GetTick(); it may wrap.
  void poll_ms(std::uint32_t now_ms) { poll(now_ms * 1000); }

  /// Whether the link itself fills this message: that of the counters service, at the MCU.
  template <class Message>
  static constexpr bool fills =
      std::is_same_v<Message, typename Protocol::Counters::Message>&& Protocol::end == End::mcu;
  /// Fill it with the counts so far. The context of `poll`, which calls it when the message is due.
  template <class Message>
  void fill(Message& message) const {
    static_assert(fills<Message>, "this is not the message of the `counters` service");
    Protocol::count(message, *this);
  }

  /// Where frames have an `address`: act on frames for this address and on broadcasts from now on, and send it as the
  /// own one. The default is the file's. Returns false if the field cannot hold it; nothing has changed then. Senders
  /// in other contexts may still use the old one for frames that they are writing. Set an address of more than 32 bits
  /// before anything is sent.
  bool set_address(Address address) { return own_address().set_address(address); }
  Address address() const { return own_address().address(); }  ///< any context
  /// Act on frames for every address, for a gateway or a monitor. Sent frames keep the own address, and services answer
  /// only requests for it.
  void listen_to_all() {
    if constexpr (asks_one) {
      receiver_.replies().listen_to_all();
    } else {
      receiver_.listen_to_all();
    }
  }

  /// The receiver of the message or frame that the handler has now: a broadcast is acted on and not answered. If frames
  /// name no receiver it is always `own`.
  Addressee addressee() const { return receiver_.addressee(); }

  /// End a deadline with `recover: explicit` that has struck: its message acts again, and all deadlines of the message
  /// begin again. Does nothing if it has not struck. May be called inside a handler.
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
            reception_stops_.load(std::memory_order_relaxed),
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
            echo().collisions(),
            time_.steps(),
            OwnCount::frames()};
  }
  ReceiveAccount receive_account() const { return ring_.account(); }
  std::size_t unread() const { return ring_.unread(); }
  const Inlet& receiver() const { return receiver_; }  ///< its bytes and violations
  /// Counts from the other end's sequence numbers: how many of its frames are missing. Zeros if it sends none.
  SequenceCounts<std::uint32_t> sequence() const { return receiver_.sequence(); }
  SendAccount send_account() const { return outbox_.account(); }
  /// Bytes of the send queue that are not free: frames that wait, and those that left after one that its sender has not
  /// finished. Any context. Without urgent frames and `latest` messages, which have their own memory.
  std::size_t send_bytes_in_use() const { return outbox_.used_bytes(); }

  /// Return when `poll` has work that no interrupt announces, for firmware that sleeps until then: 0 to 100 ms after
  /// `now_us`, which was read before the call. Also poll after each of the UART's interrupts; a `send` needs no poll.
  /// Deadlines, schedule and time-outs are then as punctual as with a poll every millisecond. If the port has no clock
  /// it is at most half of the time in which the line fills the receive ring, because a later poll would drop bytes.
  /// The context of `poll`; takes flash only if it is called.
  std::uint32_t next_due_us(std::uint32_t now_us) const;

  /// Return the first reason found why the link does not work: checks the port's setup and the events so far. `text_of`
  /// makes a sentence of it. The context of `poll`; takes flash only if it is called.
  Why why() const;

  // ---- the UART's interrupt

  /// Note a half, full or idle event: DMA moved on. Events may come in any order, merged, or without news.
  void on_received() {
    const Inside event(in_event_);
    if (state() == LinkState::down) return;  // not ours: DMA's place means nothing before `start_receive`
    look_for_errors();
    [[maybe_unused]] const std::uint32_t position = ring_.advance(port_.receive_position());
    if constexpr (Age::is_stamped) {
      if (detail::clock_runs(port_, 0)) age_.stamp(position, time_.own(port_.now_us()), fill_us);
    }
  }

  /// Note that the run has left, including its last bit.
  void on_transmitted() {
    const Inside event(in_event_);
    if (!handshake_.complete()) return;  // of a run that was stopped
    outbox_.sent();
    if constexpr (keeps_pause) begin_pause();
    send_next();
    if constexpr (detail::WantsFreeLine<Port>::value) free_line();
  }

  /// Note a framing, noise, overrun or DMA error. If it stopped reception, that is restarted as soon as `poll` has read
  /// the bytes before it: at once, or in the interrupt that the next `poll` pends.
  void on_error() {
    const Inside event(in_event_);
    line_errors_ += 1;
    if (port_.receiving()) return;
    error_ended_ = true;
    if (state() == LinkState::down) {
      handshake_.ask_restart();  // `start` may be just about to finish
    } else {
      restart_reception();
    }
  }

  /// Do the work that `Port::pend` requested.
  void on_pended() {
    const Inside event(in_event_);
    if (state() == LinkState::down) {
      if constexpr (may_leave) clear_line();
      return;
    }
    look_for_errors();
    if (handshake_.look().restart()) restart_reception();
    switch (handshake_.take()) {
      case LineWord::Work::none: return this->expire(outbox_);  // a run is being sent, perhaps for long
      case LineWord::Work::abort: abort_run(); break;
      case LineWord::Work::look: break;
    }
    send_next();
    if constexpr (detail::WantsFreeLine<Port>::value) free_line();
  }

 private:
  /// Twice the time of the longest run, plus the time that an interrupt may be late.
  static constexpr std::uint32_t transmit_timeout_us =
      10'000 + static_cast<std::uint32_t>(std::uint64_t{2'000'000} * detail::longest_run_bytes<Protocol> /
                                          Protocol::bytes_per_second);
  /// Time after which own bytes are no longer expected to be heard. A UART hears each with its last bit; at a host an
  /// adapter may hold them back.
  static constexpr std::uint32_t echo_timeout_us =
      Protocol::end == End::mcu ? transmit_timeout_us / 2 : transmit_timeout_us + Receives::idle_us;

  /// `why` names a port that has refused this many runs in its polls, and taken none.
  static constexpr std::uint32_t retries_when_stuck = 100;
  /// `why` names the line if there is more than one error in this many bytes.
  static constexpr std::uint32_t bytes_per_error = 1'000;
  /// `why` names collisions if there is more than one in this many frames.
  static constexpr std::uint32_t frames_per_collision = 100;

  /// Minimum time that the line takes to fill the receive ring.
  static constexpr std::uint32_t fill_us = static_cast<std::uint32_t>(
      std::uint64_t{1'000'000} * std::tuple_size<decltype(Memory::receive)>::value / Protocol::bytes_per_second);
  /// Time of a byte on the line, rounded up.
  static constexpr std::uint32_t byte_us = (1'000'000 + Protocol::bytes_per_second - 1) / Protocol::bytes_per_second;
  /// Half of that in 1/256 us, for TimeBase::came.
  static constexpr std::uint32_t half_byte_256 = (std::uint32_t{500'000} << 8) / Protocol::bytes_per_second;
  /// Shortest deadline at this end; 0: there is none.
  static constexpr std::uint32_t shortest_deadline_us = shortest(Protocol::deadlines);

  /// Whether the port can report that no program reads.
  static constexpr bool may_leave = detail::TellsConnection<Port>::value;

  /// Whether silence ends a frame: then a run is one frame, and the next one waits for the pause.
  static constexpr bool keeps_pause = Protocol::pause_us != 0;

  using Numbers = SentNumbers<Sends>;
  using Ending = std::conditional_t<Numbers::has_numbers, Waiting, Sealed>;
  using Mistakable = detail::Mistakable<typename Protocol::Mistakable>;
  static constexpr bool remembers_own = detail::remembers_own<Protocol>;
  using detail::SpokenVersion<Protocol>::follows_host;
  static constexpr bool recognises_own = remembers_own || detail::sees_own_ids<Protocol>;
  using OwnFrames = detail::OwnFrames<remembers_own>;
  using OwnCount = detail::OwnCount<recognises_own>;
  using Reference = detail::TimeReference<detail::HasTick<Port>::value || detail::HasClock<Port>::value>;
  using LineWord = wirebond::Handshake<typename Memory::Config::Atomics>;
  using Age = ReceiveAge<detail::HasClock<Port>::value>;

  /// Marks that the UART's interrupt or `poll` is running, and its data is between two states. Only that context writes
  /// the flag; a `poll` that finds it set has interrupted it, or is called by a handler.
  class Inside {
   public:
    explicit Inside(LoadStore<bool>& flag) : flag_(flag), before_(flag.load(std::memory_order_relaxed)) {
      flag_.store(true, std::memory_order_relaxed);
      std::atomic_signal_fence(std::memory_order_seq_cst);
    }
    ~Inside() {
      std::atomic_signal_fence(std::memory_order_seq_cst);
      flag_.store(before_, std::memory_order_relaxed);  // a port may report an event within its `start_transmit`
    }
    Inside(const Inside&) = delete;
    Inside& operator=(const Inside&) = delete;

   private:
    LoadStore<bool>& flag_;
    bool before_;
  };

  /// Asks the deadlines, then calls the services and the handler.
  struct Inbox {
    Link& link;

    template <bool recognises = recognises_own>
    std::enable_if_t<recognises, bool> is_own(const Frame& frame) {
      return link.is_own(frame);
    }
    template <bool follows = follows_host>
    std::enable_if_t<follows> hear(const Frame& frame) {
      link.hear(frame);
    }
    template <class IsStop>
    MayAct may_act(std::int16_t message, std::uint32_t came_us, std::uint32_t now_us, IsStop&& is_stop) {
      if constexpr (Protocol::holds_back_strangers) {
        if (link.peer_ == Peer::different && !detail::acts_for_strangers<Protocol>(message)) {
          if (is_stop()) return MayAct::stops;
          link.deadlines_.hold_back();
          return MayAct::held_back;
        }
      }
      return link.deadlines_.may_act(message, came_us, link.acts_at(now_us), is_stop);
    }
    void seen(std::int16_t message, std::uint32_t came_us) {
      if (!link.is_likely_own()) link.deadlines_.seen(message, came_us);
    }

    template <class Message, class... Header>
    void on(const Message& message, const Header&... header) {
      static_assert(detail::RightOn<Handler, Message, HeaderOf<Receives>>::value);
      if constexpr (names_receiver<Receives>) {
        const Addressee to = link.receiver_.addressee();
        if (to != Addressee::another && !link.is_likely_own()) {
          detail::serve<Protocol>(message, link.handler_, link.template times_for<Message>(), link.peer_,
                                  [&](const auto& answer) {
                                    if (to == Addressee::own) link.answer(answer, header...);
                                  });
        }
      } else if (!link.is_likely_own()) {
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
    /// A request that breaks a field's rule does not act; one of the parameter service is refused, so that nobody
    /// waits.
    template <class Message, class... Header>
    std::enable_if_t<detail::asks_parameter<Protocol, Message>> on_rejected(const Message& message,
                                                                            const Header&... header) {
      if (link.addressee() != Addressee::own) return;
      link.answer(detail::parameter_refusal<Protocol>(message, link.handler_), header...);
    }
    void unknown(const Frame& frame) { hand_over_unknown<Receives>(frame, link.handler_); }
  };

  /// The rest of `send`: the frame goes into the queue.
  template <class Message, class... Given>
  WIREBOND_INLINE Status queue(const Message& message, const Given&... given) {
    if (state() == LinkState::down) {
      outbox_.refuse(Refusal::down, account_of<Message>());
      return Status::link_down;
    }
    const std::size_t payload = payload_bytes(message);
    if (payload > Message::Info::max_payload_bytes) return refuse_range<Message>();
    const std::size_t room = frame_room<Sends, Message>(payload, given...);
    if (room == 0) return refuse_range<Message>();
    if constexpr (is_log_line<Message>) {
      if (!outbox_.leaves_half(room)) {
        outbox_.refuse(Refusal::full, account_of<Message>());
        return Status::queue_full;
      }
    }
    auto grant = outbox_.template reserve_for<Message>(room, this->stamp());
    if (!grant.ok()) return Status::queue_full;
    std::size_t size = 0;
    const Status status = encode_frame<Sends, Ending>(message, grant.data(), grant.size(), size, given...);
    if (status != Status::ok) {
      grant.give_back(Refusal::range);
    } else {
      if constexpr (asks_one && Message::Info::reply >= 0) note_request(Message::Info::reply, given...);
      grant.commit(size);
    }
    if (handshake_.offer()) port_.pend();  // also after a refusal: the returned memory may be waited for
    return status;
  }

  /// Send a service's answer to the sender of its request.
  template <class Message, class... Header>
  void answer(const Message& message, [[maybe_unused]] const Header&... header) {
    if constexpr (names_receiver<Sends> && names_sender<Receives>) {
      detail::HeaderNumbers<Receives> came = detail::default_numbers<Receives>;
      static_cast<void>(write_header(header..., came.data()));  // it has passed its field rules
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

  // If frames name their receiver, the receiver keeps the own address; otherwise the link does, if it sends one.
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
  static constexpr bool is_log_line =
      Message::Info::queue ==
      Queue::normal&& Protocol::LogLines::template index_of<Message>() < Protocol::LogLines::size;

  template <class Message>
  Status refuse_range() {
    outbox_.refuse(Refusal::range, account_of<Message>());
    return Status::out_of_range;
  }

  static std::uint32_t time_left(std::uint32_t since_us, std::uint32_t limit_us, std::uint32_t now_us) {
    return now_us - since_us < limit_us ? since_us + limit_us - now_us : 0;
  }

  std::uint32_t now() const { return now_us_.load(std::memory_order_relaxed); }
  /// Return the time now: a handler may have taken long since `now_us` was passed to `poll`. Only a port's clock knows.
  std::uint32_t acts_at(std::uint32_t now_us) const {
    if constexpr (Age::is_stamped && shortest_deadline_us != 0) {
      if (detail::clock_runs(port_, 0)) {
        const std::uint32_t clock_us = time_.own(port_.now_us());
        if (static_cast<std::int32_t>(clock_us - now_us) > 0) return clock_us;
      }
    }
    return now_us;
  }
  /// Return the times of a request, for the clock service.
  template <class Message>
  detail::ServiceTimes times_for() const {
    if constexpr (Age::is_stamped && std::is_same_v<Message, typename Protocol::Clock::Request>) {
      if (detail::clock_runs(port_, 0)) return {time_.given(age_.came_us(now())), port_.now_us()};
    }
    return {time_.given(now()), time_.given(now())};
  }

  bool reaches_buffers() const {
    return port_.reaches(memory_.receive.data(), memory_.receive.size()) &&
           port_.reaches(memory_.send.data(), memory_.send.size());
  }

  // ---- inside poll

  void start(std::uint32_t now_us);

  /// Take the link down, because no program reads. Waiting frames expire, and so do frames that a sender finishes from
  /// now on.
  void leave(std::uint32_t now_us);

  void receive(std::uint32_t before_us, std::uint32_t now_us);

  /// Note that all received bytes were heard. `fed`: bytes of others before that.
  void end_hearing(std::uint32_t fed, std::uint32_t now_us, Inbox& inbox);

  /// Count the frames that show that the peer sends: including those of messages that the file does not list, excluding
  /// own ones.
  std::uint32_t heard_frames() const { return receiver_.account().frames + unlisted_frames() - OwnCount::frames(); }

  /// Check whether this end sent the frame itself, so that it must not act.
  ///
  /// If only this end has messages of its id there is no doubt; such a frame goes to `unknown`. If both ends send the
  /// message, it equals one that left just now. The other end may send the same by chance, as its hello does. So until
  /// it is certain every such frame reaches its handler: an intact frame of the other end is never lost. From the third
  /// in a row on it puts off no deadline and gets no answer. None of them shows that the other end is there.
  bool is_own(const Frame& frame) {
    bool has_own_id = false;
    if constexpr (detail::sees_own_ids<Protocol>) {
      has_own_id = frame.message < 0 && detail::knows_id<Sends>(frame.id) && !detail::knows_id<Receives>(frame.id);
    }
    bool is_equal = has_own_id;
    if constexpr (remembers_own) {
      constexpr detail::Around around = detail::around(Receives{}.format());
      if (!is_equal) is_equal = OwnFrames::has(detail::mark_of(around, frame.wire, frame.wire_size));
    }
    if (!is_equal) {
      OwnCount::heard_other();
      return false;
    }
    OwnCount::heard_own(has_own_id);
    if (OwnCount::is_likely() && state() != LinkState::up) peer_ = Peer::unknown;  // an own hello may have set more
    return OwnCount::is_sure() && frame.message >= 0;
  }

  /// Check whether the frame being delivered may be an own one: then it is not a sign of the other end.
  bool is_likely_own() const { return OwnCount::is_likely(); }

  std::uint32_t unlisted_frames() const {
    if constexpr (detail::TellsUnlisted<Counts>::value) {
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

  // ---- inside the UART's interrupt

  void look_for_errors();

  WIREBOND_NOINLINE void restart_reception();

  /// Abort the current run and expire all other frames, because the link is down.
  void clear_line();

  /// Abort the run. The line is looking, so no event of the old run changes it any more.
  void abort_run();

  SendPause<Protocol::pause_us>& pause() { return *this; }

  using EchoKeeper = detail::LinkEcho<Protocol::echoes, detail::longest_run_bytes<Protocol>>;
  EchoKeeper& echo() { return *this; }
  const EchoKeeper& echo() const { return *this; }

  void begin_pause();

  Run next_run();

  /// Remember a frame of the new run that may be mistaken for the other end's if it comes back.
  void note_own(const std::uint8_t* frame, std::size_t size, std::uint8_t message) {
    constexpr detail::Around around = detail::around(Sends{}.format());
    if (Mistakable::has(message)) OwnFrames::leaves(detail::mark_of(around, frame, size));
  }

  /// Switch off the driver, if a pin enables one. Not a part of `send_next`: without optimisation each nested call
  /// takes stack.
  void free_line();

  /// Give the next run to the port, or rest. The line is looking.
  WIREBOND_NOINLINE void send_next();

  Handler& handler_;
  Port& port_;
  Memory& memory_;
  ReceiveRing ring_;
  Age age_;
  TimeBase time_;
  LineWord handshake_;
  Outbox<typename Memory::Config> outbox_;
  Inlet receiver_;
  Deadlines<Protocol::deadlines.size()> deadlines_;
  Schedule<typename Protocol::Scheduled> schedule_;
  std::uint32_t line_errors_ = 0;  ///< these four are written by the UART's interrupt
  std::uint32_t receive_restarts_ = 0;
  std::uint32_t transmit_retries_ = 0;
  std::uint32_t transmit_timeouts_ = 0;
  std::uint32_t slow_polls_ = 0;
  std::uint32_t nested_polls_ = 0;
  std::uint32_t unserved_pends_ = 0;
  std::uint32_t heard_us_ = 0;          ///< time of the last valid frame
  std::uint32_t line_moved_us_ = 0;     ///< time of the last byte, or of a restart because none came
  std::uint32_t begun_us_ = 0;          ///< about when the current run began
  std::uint32_t stops_in_silence_ = 0;  ///< `reception_stops_` when the line was silent and reception was running
  LoadStore<std::uint32_t> reception_stops_{0};  ///< written by the UART's interrupt
  LoadStore<std::uint32_t> now_us_{0};           ///< of the last poll, in the link's own time
  LoadStore<bool> in_event_{false};              ///< the UART's interrupt is running
  LoadStore<bool> in_poll_{false};  ///< `poll` is running: this one may be called by a handler, or interrupt it
  LoadStore<bool> waits_{false};    ///< waiting frames must expire, because the link went down; written by both
  LoadStore<LinkState> state_{LinkState::down};
  Peer peer_ = Peer::unknown;
  bool is_timed_ = false;
  bool is_starved_ = false;           ///< of the last bytes, some were lost between two polls
  bool error_ended_ = false;          ///< the interrupt's own: reception ended with an error event
  std::uint8_t unserved_in_row_ = 0;  ///< polls in a row that found their last pend unserved, at most 255
};

}  // namespace wirebond

// The longer functions, one idea in each file.
#include "wirebond/mcu/link_presence.hpp"
#include "wirebond/mcu/link_receiving.hpp"
#include "wirebond/mcu/link_sending.hpp"
#include "wirebond/mcu/link_timing.hpp"
#include "wirebond/mcu/link_why.hpp"
