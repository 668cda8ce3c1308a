// Bytes in, handler calls out: a stream deframer with its memory, followed by the field rules.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <type_traits>
#include <utility>

#include "wirebond/address.hpp"
#include "wirebond/deadline.hpp"
#include "wirebond/handler.hpp"
#include "wirebond/message.hpp"
#include "wirebond/sequence.hpp"
#include "wirebond/stream_deframer.hpp"
#include "wirebond/violation.hpp"

namespace wirebond {

namespace detail {

/// Whether the object that decides about messages also recognises this end's own frames that came back.
template <class Watch, class = void>
struct KnowsOwn : std::false_type {};
template <class Watch>
struct KnowsOwn<Watch, std::void_t<decltype(std::declval<Watch&>().is_own(std::declval<const Frame&>()))>>
    : std::true_type {};

/// Does it also see each frame for this end, before it acts?
template <class Watch, class = void>
struct HearsFrames : std::false_type {};
template <class Watch>
struct HearsFrames<Watch, std::void_t<decltype(std::declval<Watch&>().hear(std::declval<const Frame&>()))>>
    : std::true_type {};

}  // namespace detail

/// Receives at one end of one link. `Source` is a generated constant source: the sender that this end listens to. Time
/// is in microseconds and may wrap. One thread or interrupt at a time; a handler runs inside the call that feeds.
/// `Account`: ByteAccount, or ByteCounts where memory is scarce.
///
/// Where frames have a receiver's address, frames for this end and broadcasts are delivered, as `Listening` decides: at
/// first for the file's default address. Frames for others count in `account()` like any frame, and in `foreign()`, but
/// reach no handler and no deadline. Where frames have a sequence number, `sequence()` counts missing ones. `Replies`
/// knows which replies are expected: those of the last `expect` or, in a host's link, of each request that was sent.
template <class Source, class Counter = std::uint32_t, class Account = ByteAccount<Counter>,
          class Replies = Asked<Source>>
class Receiver : public Listening<Source>, public SequenceWatch<Source>, private Replies {
 public:
  /// `idle_us`: silence after which an incomplete frame is given up.
  explicit Receiver(Counter idle_us = Source::idle_us) : deframer_(Source{}, workspace_.data(), idle_us) {}
  Receiver(const Receiver&) = delete;  // the deframer points into the workspace
  Receiver& operator=(const Receiver&) = delete;

  /// Take bytes that were read at `now_us`. Calls `handler.on(const Message&)` for each message that passes its field
  /// rules, if the handler has that overload; `handler.unknown(const Frame&)` for other frames, if it has it. The
  /// compiler refuses an `on` for a message that never comes, because only this end sends it: see ServesBothEnds.
  template <class Handler>
  void feed(const std::uint8_t* bytes, std::size_t size, Counter now_us, Handler& handler) {
    static_assert(detail::has_ons_of_right_end<Handler, Source>);
    deframer_.feed(bytes, size, now_us, Unwatched<Handler>{*this, handler});
  }

  /// Take bytes, and let `deadlines` decide: `deadlines.may_act(message, came_us, now_us, is_stop)` is called before
  /// each known message, which reaches its handler if the answer is `MayAct::yes` or `stops`;
  /// `deadlines.seen(message, came_us)` is called after the handler if the answer was `yes` and the message passed its
  /// field rules. If it has `deadlines.is_own(frame)`, that is asked first: an own frame that came back reaches no
  /// handler. If it has `deadlines.hear(frame)`, that is called with each frame for this end, before it acts.
  template <class Handler, class Watch>
  void feed(const std::uint8_t* bytes, std::size_t size, Counter now_us, Handler& handler, Watch& deadlines) {
    feed(bytes, size, now_us, now_us, handler, deadlines);
  }

  /// Take bytes that were found at `now_us` and came at `came_us` or later: messages are judged by that. A message
  /// found only now, after a false start, is as old as the oldest byte kept with it.
  template <class Handler, class Watch>
  void feed(const std::uint8_t* bytes, std::size_t size, Counter came_us, Counter now_us, Handler& handler,
            Watch& deadlines) {
    static_assert(detail::has_ons_of_right_end<Handler, Source>);
    const Counter kept_until = this->bytes();
    deframer_.feed(bytes, size, came_us, now_us,
                   Sink<Handler, Watch>{*this, handler, deadlines, came_us, now_us, kept_until});
    if (pending() <= size) kept_since_us_ = came_us;
  }

  /// Note that the bytes fed last came at `when_us` at the latest, according to an event of the port.
  void last_came_at(Counter when_us) { deframer_.last_came_at(when_us); }

  /// Note that a read that began at `now_us` found nothing. Gives up an incomplete frame once the silence has lasted
  /// `idle_us`.
  template <class Handler>
  void idle(Counter now_us, Handler& handler) {
    deframer_.idle(now_us, Unwatched<Handler>{*this, handler});
  }

  template <class Handler, class Watch>
  void idle(Counter now_us, Handler& handler, Watch& deadlines) {
    if (deframer_.is_silent(now_us)) give_up(now_us, handler, deadlines);
  }

  /// Settle all kept bytes: bytes were lost here, so nothing that follows belongs to them.
  template <class Handler, class Watch>
  WIREBOND_NOINLINE void give_up(Counter now_us, Handler& handler, Watch& deadlines) {
    deframer_.give_up(Sink<Handler, Watch>{*this, handler, deadlines, kept_since_us_, now_us, bytes()});
  }

  /// Expect the reply of a `Request` from now on, where several messages share an id. Call it before the request's
  /// bytes leave. Needed only where the protocol has replies identified only by their request.
  template <class Request>
  void expect() {
    static_assert(Request::Info::reply >= 0, "this message has no `reply` in the protocol file");
    deframer_.expect(Request::Info::reply);
    this->ask(Request::Info::reply);
  }

  /// Expect the reply of the MCU with this address, where the MCU's frames carry its address: until the next call, the
  /// same reply from another address reaches no handler and no deadline, and counts in `foreign()`. A broadcast asks
  /// all: each reply is delivered.
  template <class Request>
  void expect(detail::AddressOf<Source> address) {
    static_assert(names_asked<Source>, "the MCU's frames do not say whose they are: no header field has `address`");
    static_assert(Request::Info::reply >= 0, "this message has no `reply` in the protocol file");
    deframer_.expect(Request::Info::reply);
    this->ask(Request::Info::reply, address);
  }

  /// For a link, which notes requests as they are sent.
  Replies& replies() { return *this; }

  /// Intact frames for others, and replies from an address that was not asked, modulo 2^32.
  std::uint32_t foreign() const { return Listening<Source>::foreign() + this->from_others(); }

  const Account& account() const { return deframer_.account(); }
  const Violations& violations() const { return violations_; }
  Counter bytes() const { return deframer_.bytes(); }          ///< all that were fed
  std::size_t pending() const { return deframer_.pending(); }  ///< of these, not settled yet

 private:
  // One named type for each of `feed`, `idle` and `give_up`, so that the deframer is compiled once per handler.
  template <class Handler>
  struct Unwatched {
    Receiver& receiver;
    Handler& handler;

    WIREBOND_INLINE void operator()(const Frame& frame) const {
      receiver.note(frame);
      if (!receiver.concerns(frame)) return;
      static_cast<void>(Source::dispatch(frame, handler, receiver.violations_));
    }
  };

  template <class Handler, class Watch>
  struct Sink {
    Receiver& receiver;
    Handler& handler;
    Watch& deadlines;
    Counter came_us;
    Counter now_us;
    Counter kept_until;  ///< bytes that were kept before those that came at `came_us`

    WIREBOND_INLINE void operator()(const Frame& frame) const {
      if constexpr (detail::KnowsOwn<Watch>::value) {
        if (deadlines.is_own(frame)) return;
      }
      receiver.note(frame);  // those for others, too: their sender numbers all its frames
      if (!receiver.concerns(frame)) return;
      if constexpr (detail::HearsFrames<Watch>::value) deadlines.hear(frame);
      Counter since_us = came_us;
      MayAct answer = MayAct::yes;
      if (frame.message >= 0) {
        const auto end = static_cast<Counter>(frame.offset) + static_cast<Counter>(frame.wire_size);
        if (static_cast<Counter>(kept_until - end) <= static_cast<Counter>(workspace_size)) {
          since_us = receiver.kept_since_us_;
        }
        answer = deadlines.may_act(frame.message, since_us, now_us, [&] { return detail::is_stop<Source>(frame, 0); });
        if (answer == MayAct::late || answer == MayAct::held_back) return;
      }
      const bool has_acted = Source::dispatch(frame, handler, receiver.violations_);
      if (has_acted && answer == MayAct::yes) deadlines.seen(frame.message, since_us);
    }
  };

  /// Check whether the frame is for this end, and from an address that it asked.
  WIREBOND_INLINE bool concerns(const Frame& frame) { return this->hears(frame) && this->is_from_asked(frame); }

  static constexpr std::size_t workspace_size = workspace_bytes(Source{});

  std::array<std::uint8_t, workspace_size> workspace_{};
  StreamDeframer<Source, Counter, Account> deframer_;
  Violations violations_{};
  Counter kept_since_us_ = 0;  ///< when the oldest kept byte came
};

}  // namespace wirebond
