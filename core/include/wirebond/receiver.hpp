// Bytes in, handler calls out: a stream deframer with its memory, and the field rules behind it.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>

#include "wirebond/address.hpp"
#include "wirebond/deadline.hpp"
#include "wirebond/handler.hpp"
#include "wirebond/sequence.hpp"
#include "wirebond/stream_deframer.hpp"
#include "wirebond/violation.hpp"

namespace wirebond {

/// For one end of one link. `Source` is a generated constant source: the sender that this end listens to.
/// Time is in microseconds and may wrap. One thread or interrupt at a time; a handler runs inside the call that feeds.
/// `Account`: ByteAccount, or ByteCounts where memory is dear.
///
/// Where frames say whom they are for, it hands out those for this end and broadcasts, as `Listening` says: at first
/// for the file's default address. What is for others counts in `account()` like any frame, and in `foreign()`; it
/// reaches no handler and no deadline. Where frames have a sequence number, `sequence()` says how many are missing.
/// `Replies` knows whose replies are meant: what `expect` said last or, in a host's link, each request that was sent.
template <class Source, class Counter = std::uint32_t, class Account = ByteAccount<Counter>,
          class Replies = Asked<Source>>
class Receiver : public Listening<Source>, public SequenceWatch<Source>, private Replies {
 public:
  /// `idle_us`: the silence after which an incomplete frame is given up.
  explicit Receiver(Counter idle_us = Source::idle_us) : deframer_(Source{}, workspace_.data(), idle_us) {}
  Receiver(const Receiver&) = delete;  // the deframer points into the workspace
  Receiver& operator=(const Receiver&) = delete;

  /// Bytes that were read at `now_us`. `handler.on(const Message&)` is called for each message that passes its field
  /// rules, where the handler has that overload; `handler.unknown(const Frame&)` for other frames, where it has it.
  /// The compiler refuses an `on` for a message that never comes, because only this end sends it: see ServesBothEnds.
  template <class Handler>
  void feed(const std::uint8_t* bytes, std::size_t size, Counter now_us, Handler& handler) {
    static_assert(detail::has_ons_of_right_end<Handler, Source>);
    deframer_.feed(bytes, size, now_us, Unwatched<Handler>{*this, handler});
  }

  /// The same, and `deadlines` decide: `deadlines.may_act(message, came_us, now_us)` is asked before each known
  /// message, which reaches no handler where the answer is not `MayAct::yes`; `deadlines.seen(message, came_us)` is
  /// called for each that passes its field rules, after its handler.
  template <class Handler, class Watch>
  void feed(const std::uint8_t* bytes, std::size_t size, Counter now_us, Handler& handler, Watch& deadlines) {
    feed(bytes, size, now_us, now_us, handler, deadlines);
  }

  /// The same for bytes that were found at `now_us` and came at `came_us` or later: a message is judged by that. One
  /// that lay behind a false start, and is found now, came when the oldest byte did that was kept with it.
  template <class Handler, class Watch>
  void feed(const std::uint8_t* bytes, std::size_t size, Counter came_us, Counter now_us, Handler& handler,
            Watch& deadlines) {
    static_assert(detail::has_ons_of_right_end<Handler, Source>);
    const Counter kept_until = this->bytes();
    deframer_.feed(bytes, size, came_us, now_us,
                   Sink<Handler, Watch>{*this, handler, deadlines, came_us, now_us, kept_until});
    if (pending() <= size) kept_since_us_ = came_us;
  }

  /// The bytes that were fed last came at `when_us` at the latest: an event of the port says so.
  void last_came_at(Counter when_us) { deframer_.last_came_at(when_us); }

  /// A read that began at `now_us` found nothing: gives up an incomplete frame once the silence lasted `idle_us`.
  template <class Handler>
  void idle(Counter now_us, Handler& handler) {
    deframer_.idle(now_us, Unwatched<Handler>{*this, handler});
  }

  template <class Handler, class Watch>
  void idle(Counter now_us, Handler& handler, Watch& deadlines) {
    if (deframer_.is_silent(now_us)) give_up(now_us, handler, deadlines);
  }

  /// Bytes were lost here, and nothing that follows belongs to what is kept: settles all of it.
  template <class Handler, class Watch>
  WIREBOND_NOINLINE void give_up(Counter now_us, Handler& handler, Watch& deadlines) {
    deframer_.give_up(Sink<Handler, Watch>{*this, handler, deadlines, kept_since_us_, now_us, bytes()});
  }

  /// A `Request` goes out: of messages that share an id, its reply is meant from here on. Call it before the request's
  /// bytes leave. Needed only where the protocol has replies that nothing but their request tells apart.
  template <class Request>
  void expect() {
    static_assert(Request::Info::reply >= 0, "this message has no `reply` in the protocol file");
    deframer_.expect(Request::Info::reply);
    this->ask(Request::Info::reply);
  }

  /// The same for a request to the MCU of this address, where the MCU's frames say whose they are: until the next call,
  /// the same reply from another address reaches no handler and no deadline, and is counted in `foreign()`. A broadcast
  /// asks all: each reply is handed out.
  template <class Request>
  void expect(detail::AddressOf<Source> address) {
    static_assert(names_asked<Source>, "the MCU's frames do not say whose they are: no header field has `address`");
    static_assert(Request::Info::reply >= 0, "this message has no `reply` in the protocol file");
    deframer_.expect(Request::Info::reply);
    this->ask(Request::Info::reply, address);
  }

  /// For a link, which hears of requests as they are sent.
  Replies& replies() { return *this; }

  /// Intact frames for others, and replies of others than the one that was asked, modulo 2^32.
  std::uint32_t foreign() const { return Listening<Source>::foreign() + this->from_others(); }

  const Account& account() const { return deframer_.account(); }
  const Violations& violations() const { return violations_; }
  Counter bytes() const { return deframer_.bytes(); }          ///< all that were fed
  std::size_t pending() const { return deframer_.pending(); }  ///< of these, not settled yet

 private:
  // One named type each for `feed`, `idle` and `give_up`, so that the deframer is compiled once for a handler.
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
    Counter kept_until;  ///< bytes that were there before those that came at `came_us`

    WIREBOND_INLINE void operator()(const Frame& frame) const {
      receiver.note(frame);  // those for others, too: their sender counts all that it sends
      if (!receiver.concerns(frame)) return;
      Counter since_us = came_us;
      if (frame.message >= 0) {
        const auto end = static_cast<Counter>(frame.offset) + static_cast<Counter>(frame.wire_size);
        if (static_cast<Counter>(kept_until - end) <= static_cast<Counter>(workspace_size)) {
          since_us = receiver.kept_since_us_;
        }
        if (deadlines.may_act(frame.message, since_us, now_us) != MayAct::yes) return;
      }
      if (Source::dispatch(frame, handler, receiver.violations_)) deadlines.seen(frame.message, since_us);
    }
  };

  /// Is it for this end, and from one that it asked?
  WIREBOND_INLINE bool concerns(const Frame& frame) { return this->hears(frame) && this->is_from_asked(frame); }

  static constexpr std::size_t workspace_size = workspace_bytes(Source{});

  std::array<std::uint8_t, workspace_size> workspace_{};
  StreamDeframer<Source, Counter, Account> deframer_;
  Violations violations_{};
  Counter kept_since_us_ = 0;  ///< when the oldest byte came that is kept
};

}  // namespace wirebond
