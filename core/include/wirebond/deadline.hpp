// Silence and rhythm: which message is overdue, which is due to be sent. Time comes in as an argument and may wrap.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>

namespace wirebond {

/// Silence of the other end after which a link is `stale`. The texts say "a second": tests/test_one_truth.py.
inline constexpr std::uint32_t stale_after_us = 1'000'000;

/// How a deadline ends after it has struck.
enum class Recover : std::uint8_t {
  next_message,   ///< by the next message
  explicit_call,  ///< only by `Deadlines::recover`; until then its message is held back
  held_at_start,  ///< as explicit_call, and struck from the start (`start: held`): nothing moves after a reset
};

/// One line of the protocol file's `deadlines`.
struct DeadlineRule {
  std::int16_t message;    ///< index of the message whose silence is watched
  std::uint32_t after_us;  ///< silence that is too long; less than 2^31
  std::uint8_t action;     ///< index of the action, for the handler
  Recover recover;
};

/// Return the shortest silence of these rules; 0 if there are none.
template <std::size_t Size>
constexpr std::uint32_t shortest(const std::array<DeadlineRule, Size>& rules) {
  std::uint32_t least = 0;
  for (std::size_t i = 0; i < Size; ++i) {
    if (least == 0 || rules[i].after_us < least) least = rules[i].after_us;
  }
  return least;
}

/// Whether a message that passed every check may act. Any answer except `yes` and `stops` means: no handler, no
/// subscription, no reply of a service. Any answer except `yes` means: no deadline is put off. Its frame was delivered
/// all the same: the account counts it, and the line is not silent.
enum class MayAct : std::uint8_t {
  yes,
  late,       ///< it is as old as the shortest deadline of its message at this end, or older
  held_back,  ///< a deadline of its message with `recover: explicit` has struck, and `recover` was not called yet
  stops,      ///< it would be late or held back, but is the emergency stop: it acts, and puts off no deadline
};

/// Messages that did not act, by reason.
template <class Counter>
struct NotActed {
  Counter late = 0;
  Counter held_back = 0;
};

/// Rules and state of a set of deadlines, where their number is a constant.
template <std::size_t Size, class Time>
struct DeadlineArrays {
  constexpr std::size_t size() const { return Size; }
  constexpr const DeadlineRule& rule(std::size_t i) const { return (*rules)[i]; }

  const std::array<DeadlineRule, Size>* rules;
  std::array<Time, Size> since_us{};
  std::array<std::uint8_t, Size> marks{};
};

/// Rules and state of a set of deadlines, where their number is known only at run time. The caller keeps the memory
/// alive.
template <class Time>
struct DeadlineSpans {
  std::size_t size() const { return count; }
  const DeadlineRule& rule(std::size_t i) const { return rules[i]; }

  const DeadlineRule* rules;
  std::size_t count;
  Time* since_us;       ///< `count` elements
  std::uint8_t* marks;  ///< `count` elements
};

/// Watches every deadline of one end, from start-up on, without help from the other end. One thread or interrupt at a
/// time. `Time` is an unsigned count of microseconds; it may wrap, if `poll` is called more often than that. A clock
/// that steps back by a second or less triggers no deadline.
///
/// Transitions of a deadline:
///
/// | state | a message that acts | silence for `after` | `recover` |
/// | --- | --- | --- | --- |
/// | waiting, no message ever came | waiting | struck early | - |
/// | waiting | silence begins again | struck | - |
/// | struck early | waiting | - | waiting |
/// | struck, `recover: next_message` | waiting | - | waiting |
/// | struck, `recover: explicit` | none acts: all are held back | - | waiting |
/// | `start: held`, from the start on | none acts: all are held back | - | waiting |
///
/// The emergency stop is never late and never held back: a message with its values acts in every state, and changes
/// none of them where another message would not act.
///
/// So a deadline that strikes before its message first came, because the other end starts slowly, holds nothing back,
/// whatever its `recover` says.
template <class Memory, class Time>
class BasicDeadlines {
 public:
  constexpr BasicDeadlines(const Memory& memory, Time now_us) : memory_(memory) { start(now_us); }

  /// Count every silence from now on. Nothing has struck except deadlines with `start: held`: the first `poll` calls
  /// their actions.
  constexpr void start(Time now_us) {
    for (std::size_t i = 0; i < memory_.size(); ++i) {
      memory_.since_us[i] = now_us;
      memory_.marks[i] = memory_.rule(i).recover == Recover::held_at_start ? (at_start | came) : 0;
    }
  }

  /// Decide whether a message that passed its checks may act; call this before it acts. `received_us`: when its bytes
  /// came, or an earlier time if that is not known exactly; `now_us`: when it would act. `late` and `held_back` are
  /// counted. `is_stop()` is called only where the answer would be one of them, and returns whether it is the emergency
  /// stop.
  template <class IsStop>
  MayAct may_act(std::int16_t message, Time received_us, Time now_us, IsStop&& is_stop) {
    const MayAct answer = judge(message, received_us, now_us);
    if (answer == MayAct::yes) return answer;
    if (is_stop()) return MayAct::stops;
    (answer == MayAct::late ? not_acted_.late : not_acted_.held_back) += 1;
    return answer;
  }
  MayAct may_act(std::int16_t message, Time received_us, Time now_us) {
    return may_act(message, received_us, now_us, [] { return false; });
  }
  /// Decide for a message that acts as soon as it comes.
  MayAct may_act(std::int16_t message, Time now_us) { return may_act(message, now_us, now_us); }

  /// Note that a valid message came at `received_us`: silence counts from then. A message that is held back changes
  /// nothing.
  void seen(std::int16_t message, Time received_us) {
    for (std::size_t i = 0; i < memory_.size(); ++i) {
      if (memory_.rule(i).message == message && holds(i)) return;
    }
    for (std::size_t i = 0; i < memory_.size(); ++i) {
      if (memory_.rule(i).message != message) continue;
      memory_.since_us[i] = received_us;
      memory_.marks[i] = came;
    }
  }

  /// Call `handler(action)` once for each deadline that strikes now, in the file's order.
  template <class Handler>
  void poll(Time now_us, Handler&& handler) {
    poll(now_us, now_us, handler);
  }
  /// Strike deadlines as of `at_us`, which is not later than `now_us`. A silence that began between the two, by a
  /// `recover` in a handler, does not count yet.
  template <class Handler>
  void poll(Time at_us, Time now_us, Handler&& handler) {
    for (std::size_t i = 0; i < memory_.size(); ++i) {
      const Time since_us = memory_.since_us[i];
      if ((memory_.marks[i] & at_start) != 0) {
        memory_.marks[i] = struck_mark | came;
        handler(memory_.rule(i).action);
        continue;
      }
      if (has_struck(i) || passed(since_us, at_us) < memory_.rule(i).after_us) continue;
      if (static_cast<Time>(now_us - since_us) < static_cast<Time>(now_us - at_us)) continue;
      memory_.marks[i] |= struck_mark;
      handler(memory_.rule(i).action);
    }
  }

  /// End the strike of this action; does nothing if it has not struck. With `recover: explicit` all deadlines of the
  /// message begin again at `now_us`, except explicit ones that have struck themselves: each of those is ended by its
  /// own action.
  void recover(std::uint8_t action, Time now_us) {
    for (std::size_t i = 0; i < memory_.size(); ++i) {
      if (memory_.rule(i).action != action || !has_struck(i)) continue;
      end(i, now_us);
      if (is_explicit(i)) begin_others(i, now_us);
    }
  }

  /// Check whether this action has struck and not ended yet.
  bool struck(std::uint8_t action) const {
    for (std::size_t i = 0; i < memory_.size(); ++i) {
      if (memory_.rule(i).action == action && has_struck(i)) return true;
    }
    return false;
  }

  /// Return how long after `now_us` the next deadline strikes if its message stays away; `never`: none can strike
  /// before a message or `recover`.
  Time time_left(Time now_us) const {
    Time least = never;
    for (std::size_t i = 0; i < memory_.size(); ++i) {
      if ((memory_.marks[i] & at_start) != 0) return Time{0};
      if (has_struck(i)) continue;
      const Time passed_us = passed(memory_.since_us[i], now_us);
      const Time after_us = memory_.rule(i).after_us;
      const Time left_us = passed_us < after_us ? static_cast<Time>(after_us - passed_us) : Time{0};
      if (left_us < least) least = left_us;
    }
    return least;
  }
  static constexpr Time never = static_cast<Time>(~Time{0});

  /// Count a message that is held back by a rule other than a deadline.
  void hold_back() { not_acted_.held_back += 1; }

  /// Counts of the messages that `may_act` refused, and of `hold_back`.
  const NotActed<Time>& not_acted() const { return not_acted_; }

 private:
  /// A clock made of a tick and a timer may step back: then no time has passed.
  static constexpr Time most_step_us = 1'000'000;
  static Time passed(Time since_us, Time now_us) {
    return static_cast<Time>(since_us - now_us) <= most_step_us ? Time{0} : static_cast<Time>(now_us - since_us);
  }

  static constexpr std::uint8_t struck_mark = 1;
  static constexpr std::uint8_t came = 2;      ///< its message has acted once, or need not have
  static constexpr std::uint8_t at_start = 4;  ///< it has struck from the start, and its action was not called yet

  MayAct judge(std::int16_t message, Time received_us, Time now_us) const {
    const Time age_us = passed(received_us, now_us);
    MayAct answer = MayAct::yes;
    for (std::size_t i = 0; i < memory_.size(); ++i) {
      const DeadlineRule& rule = memory_.rule(i);
      if (rule.message != message) continue;
      if (age_us >= rule.after_us) return MayAct::late;
      if (holds(i)) answer = MayAct::held_back;
    }
    return answer;
  }

  bool has_struck(std::size_t i) const { return (memory_.marks[i] & (struck_mark | at_start)) != 0; }
  bool is_explicit(std::size_t i) const { return memory_.rule(i).recover != Recover::next_message; }
  bool holds(std::size_t i) const { return is_explicit(i) && has_struck(i) && (memory_.marks[i] & came) != 0; }

  void end(std::size_t i, Time now_us) {
    memory_.since_us[i] = now_us;
    memory_.marks[i] &= came;
  }

  void begin_others(std::size_t ended, Time now_us) {
    for (std::size_t i = 0; i < memory_.size(); ++i) {
      if (memory_.rule(i).message == memory_.rule(ended).message && !(is_explicit(i) && has_struck(i))) end(i, now_us);
    }
  }

  Memory memory_;
  NotActed<Time> not_acted_{};
};

/// Deadlines of an end whose rules are a constant, as in a generated header.
template <std::size_t Size, class Time = std::uint32_t>
class Deadlines : public BasicDeadlines<DeadlineArrays<Size, Time>, Time> {
 public:
  /// `rules` must outlive this object: a table of the generated header is a constant, and is not copied.
  constexpr Deadlines(const std::array<DeadlineRule, Size>& rules, Time now_us)
      : BasicDeadlines<DeadlineArrays<Size, Time>, Time>({&rules}, now_us) {}
  Deadlines(const std::array<DeadlineRule, Size>&&, Time) = delete;
};

/// Decides when a message with `every:` is due. After a stall it keeps the old rhythm and sends no burst.
template <class Time = std::uint32_t>
class Periodic {
 public:
  /// First due at `start_us`.
  constexpr Periodic(Time period_us, Time start_us) : period_us_(period_us), due_us_(start_us) {}

  bool due(Time now_us) {
    const Time late = static_cast<Time>(now_us - due_us_);
    if (late > static_cast<Time>(~Time{0}) / 2) return false;  // still in the future
    due_us_ = static_cast<Time>(due_us_ + (late / period_us_ + 1) * period_us_);
    return true;
  }

  constexpr Time next_us() const { return due_us_; }

 private:
  Time period_us_;
  Time due_us_;
};

}  // namespace wirebond
