// Silence and rhythm: which message stayed away too long, which is due. Time comes in as an argument and may wrap.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>

namespace wirebond {

/// How a deadline ends once it has struck.
enum class Recover : std::uint8_t {
  next_message,   ///< by the next message
  explicit_call,  ///< only by `Deadlines::recover`
};

/// One line of the protocol file's `deadlines`.
struct DeadlineRule {
  std::int16_t message;    ///< index of the message that must not stay away
  std::uint32_t after_us;  ///< silence that is too long; less than 2^31
  std::uint8_t action;     ///< what then: index of the action, for the handler
  Recover recover;
};

/// Watches every deadline of one end, from start-up on, without help from the other end.
/// `Time` is an unsigned count of microseconds; it may wrap, as long as `poll` is called more often than that.
/// One thread or interrupt at a time.
template <std::size_t Size, class Time = std::uint32_t>
class Deadlines {
 public:
  /// `rules` outlive this object: a table of the generated header is a constant, and takes no memory twice.
  constexpr Deadlines(const std::array<DeadlineRule, Size>& rules, Time now_us) : rules_(&rules) { start(now_us); }
  Deadlines(const std::array<DeadlineRule, Size>&&, Time) = delete;

  /// Every silence is counted from here on, and nothing has struck.
  constexpr void start(Time now_us) {
    for (std::size_t i = 0; i < Size; ++i) {
      since_us_[i] = now_us;
      struck_[i] = false;
    }
  }

  /// A valid message came in at `now_us`.
  void seen(std::int16_t message, Time now_us) {
    for (std::size_t i = 0; i < Size; ++i) {
      if ((*rules_)[i].message != message) continue;
      since_us_[i] = now_us;
      if ((*rules_)[i].recover == Recover::next_message) struck_[i] = false;
    }
  }

  /// Calls `handler(action)` once for each deadline that strikes now, in the file's order.
  template <class Handler>
  void poll(Time now_us, Handler&& handler) {
    for (std::size_t i = 0; i < Size; ++i) {
      if (struck_[i] || static_cast<Time>(now_us - since_us_[i]) < (*rules_)[i].after_us) continue;
      struck_[i] = true;
      handler((*rules_)[i].action);
    }
  }

  /// End what `poll` began for this action; the silence is counted anew from `now_us`.
  void recover(std::uint8_t action, Time now_us) {
    for (std::size_t i = 0; i < Size; ++i) {
      if ((*rules_)[i].action != action) continue;
      struck_[i] = false;
      since_us_[i] = now_us;
    }
  }

  /// Has this action struck, and not ended yet?
  bool struck(std::uint8_t action) const {
    for (std::size_t i = 0; i < Size; ++i) {
      if ((*rules_)[i].action == action && struck_[i]) return true;
    }
    return false;
  }

 private:
  const std::array<DeadlineRule, Size>* rules_;
  std::array<Time, Size> since_us_{};
  std::array<bool, Size> struck_{};
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
