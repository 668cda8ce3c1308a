// Silence and rhythm: which message stayed away too long, which is due. Time comes in as an argument and may wrap.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>

namespace wirebond {

/// How a deadline ends once it has struck.
enum class Recover : std::uint8_t {
  next_message,   ///< by the next message
  explicit_call,  ///< only by `Deadlines::recover`; until then its message is held back
};

/// One line of the protocol file's `deadlines`.
struct DeadlineRule {
  std::int16_t message;    ///< index of the message that must not stay away
  std::uint32_t after_us;  ///< silence that is too long; less than 2^31
  std::uint8_t action;     ///< what then: index of the action, for the handler
  Recover recover;
};

/// The shortest silence of these rules; 0: there are none.
template <std::size_t Size>
constexpr std::uint32_t shortest(const std::array<DeadlineRule, Size>& rules) {
  std::uint32_t least = 0;
  for (std::size_t i = 0; i < Size; ++i) {
    if (least == 0 || rules[i].after_us < least) least = rules[i].after_us;
  }
  return least;
}

/// May a message that passed every check act? Any other answer than `yes` means: no handler, no subscription, no reply
/// of a service, no deadline put off. Its frame was delivered all the same: the account counts it, the line is not
/// silent.
enum class MayAct : std::uint8_t {
  yes,
  late,       ///< it is as old as the shortest deadline of its message at this end, or older
  held_back,  ///< a deadline of its message with `recover: explicit` has struck, and `recover` was not called yet
};

/// Messages that did not act, by the reason.
template <class Counter>
struct NotActed {
  Counter late = 0;
  Counter held_back = 0;
};

/// The rules of a set of deadlines and what is known of each of them, where the number is a constant.
template <std::size_t Size, class Time>
struct DeadlineArrays {
  constexpr std::size_t size() const { return Size; }
  constexpr const DeadlineRule& rule(std::size_t i) const { return (*rules)[i]; }

  const std::array<DeadlineRule, Size>* rules;
  std::array<Time, Size> since_us{};
  std::array<std::uint8_t, Size> marks{};
};

/// The same where it is known at run time only. Whoever owns the memory keeps it for as long as the deadlines live.
template <class Time>
struct DeadlineSpans {
  std::size_t size() const { return count; }
  const DeadlineRule& rule(std::size_t i) const { return rules[i]; }

  const DeadlineRule* rules;
  std::size_t count;
  Time* since_us;       ///< `count` of them
  std::uint8_t* marks;  ///< the same
};

/// Watches every deadline of one end, from start-up on, without help from the other end. One thread or interrupt at a
/// time. `Time` is an unsigned count of microseconds; it may wrap, as long as `poll` is called more often than that.
///
/// What a deadline does, by what happens:
///
/// | state | a message that acts | silence for `after` | `recover` |
/// | --- | --- | --- | --- |
/// | waiting, no message ever came | waiting | struck early | - |
/// | waiting | silence begins again | struck | - |
/// | struck early | waiting | - | waiting |
/// | struck, `recover: next_message` | waiting | - | waiting |
/// | struck, `recover: explicit` | none acts: all are held back | - | waiting |
///
/// So a deadline that strikes before its message ever came, because the other end takes long to start, holds nothing
/// back, whatever its `recover` says.
template <class Memory, class Time>
class BasicDeadlines {
 public:
  constexpr BasicDeadlines(const Memory& memory, Time now_us) : memory_(memory) { start(now_us); }

  /// Every silence is counted from here on, and nothing has struck.
  constexpr void start(Time now_us) {
    for (std::size_t i = 0; i < memory_.size(); ++i) {
      memory_.since_us[i] = now_us;
      memory_.marks[i] = 0;
    }
  }

  /// Ask this before a message that passed its checks acts. `received_us`: when its bytes came, or an earlier time
  /// where that is not known exactly; `now_us`: when it would act. Any other answer than `yes` is counted.
  MayAct may_act(std::int16_t message, Time received_us, Time now_us) {
    const Time age_us = static_cast<Time>(now_us - received_us);
    MayAct answer = MayAct::yes;
    for (std::size_t i = 0; i < memory_.size(); ++i) {
      const DeadlineRule& rule = memory_.rule(i);
      if (rule.message != message) continue;
      if (age_us >= rule.after_us) {
        not_acted_.late += 1;
        return MayAct::late;
      }
      if (holds(i)) answer = MayAct::held_back;
    }
    if (answer == MayAct::held_back) not_acted_.held_back += 1;
    return answer;
  }
  /// The same for a message that acts as soon as it comes.
  MayAct may_act(std::int16_t message, Time now_us) { return may_act(message, now_us, now_us); }

  /// A valid message came at `received_us`: silence counts from there. One that is held back changes nothing.
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

  /// Calls `handler(action)` once for each deadline that strikes now, in the file's order.
  template <class Handler>
  void poll(Time now_us, Handler&& handler) {
    poll(now_us, now_us, handler);
  }
  /// The same as it was at `at_us`, which is not later than `now_us`. A silence that began between the two, by a
  /// `recover` in a handler, is none yet.
  template <class Handler>
  void poll(Time at_us, Time now_us, Handler&& handler) {
    for (std::size_t i = 0; i < memory_.size(); ++i) {
      const Time since_us = memory_.since_us[i];
      if (has_struck(i) || static_cast<Time>(at_us - since_us) < memory_.rule(i).after_us) continue;
      if (static_cast<Time>(now_us - since_us) < static_cast<Time>(now_us - at_us)) continue;
      memory_.marks[i] |= struck_mark;
      handler(memory_.rule(i).action);
    }
  }

  /// End what `poll` began for this action; nothing happens where it has not struck. With `recover: explicit` all
  /// deadlines of the message begin again at `now_us`, but for those that are explicit and have struck themselves: each
  /// of these is ended by its own action.
  void recover(std::uint8_t action, Time now_us) {
    for (std::size_t i = 0; i < memory_.size(); ++i) {
      if (memory_.rule(i).action != action || !has_struck(i)) continue;
      end(i, now_us);
      if (is_explicit(i)) begin_others(i, now_us);
    }
  }

  /// Has this action struck, and not ended yet?
  bool struck(std::uint8_t action) const {
    for (std::size_t i = 0; i < memory_.size(); ++i) {
      if (memory_.rule(i).action == action && has_struck(i)) return true;
    }
    return false;
  }

  /// How long until the next deadline strikes, seen from `now_us`, if its message stays away; `never`: none can strike
  /// any more before a message or `recover`.
  Time time_left(Time now_us) const {
    Time least = never;
    for (std::size_t i = 0; i < memory_.size(); ++i) {
      if (has_struck(i)) continue;
      const Time passed_us = static_cast<Time>(now_us - memory_.since_us[i]);
      const Time after_us = memory_.rule(i).after_us;
      const Time left_us = passed_us < after_us ? static_cast<Time>(after_us - passed_us) : Time{0};
      if (left_us < least) least = left_us;
    }
    return least;
  }
  static constexpr Time never = static_cast<Time>(~Time{0});

  /// What `may_act` refused.
  const NotActed<Time>& not_acted() const { return not_acted_; }

 private:
  static constexpr std::uint8_t struck_mark = 1;
  static constexpr std::uint8_t came = 2;  ///< its message has acted once

  bool has_struck(std::size_t i) const { return (memory_.marks[i] & struck_mark) != 0; }
  bool is_explicit(std::size_t i) const { return memory_.rule(i).recover == Recover::explicit_call; }
  bool holds(std::size_t i) const { return is_explicit(i) && memory_.marks[i] == (struck_mark | came); }

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

/// The deadlines of an end whose rules are a constant, as a generated header has them.
template <std::size_t Size, class Time = std::uint32_t>
class Deadlines : public BasicDeadlines<DeadlineArrays<Size, Time>, Time> {
 public:
  /// `rules` outlive this object: a table of the generated header is a constant, and takes no memory twice.
  constexpr Deadlines(const std::array<DeadlineRule, Size>& rules, Time now_us)
      : BasicDeadlines<DeadlineArrays<Size, Time>, Time>({&rules}, now_us) {}
  Deadlines(const std::array<DeadlineRule, Size>&&, Time) = delete;
};

/// Says when a message with `every:` is due. After a stall it goes on at the old rhythm and sends no burst.
template <class Time = std::uint32_t>
class Periodic {
 public:
  /// First due at `start_us`.
  constexpr Periodic(Time period_us, Time start_us) : period_us_(period_us), due_us_(start_us) {}

  bool due(Time now_us) {
    const Time late = static_cast<Time>(now_us - due_us_);
    if (late > static_cast<Time>(~Time{0}) / 2) return false;  // still ahead
    due_us_ = static_cast<Time>(due_us_ + (late / period_us_ + 1) * period_us_);
    return true;
  }

  constexpr Time next_us() const { return due_us_; }

 private:
  Time period_us_;
  Time due_us_;
};

}  // namespace wirebond
