// Deadlines and rhythms over a clock that wraps.
#include "wirebond/deadline.hpp"

#include <doctest/doctest.h>

#include <array>
#include <cstdint>
#include <vector>

using wirebond::BasicDeadlines;
using wirebond::DeadlineRule;
using wirebond::Deadlines;
using wirebond::DeadlineSpans;
using wirebond::MayAct;
using wirebond::Periodic;
using wirebond::Recover;

namespace {

enum Action : std::uint8_t { stop, safe_mode, warn };

constexpr std::array<DeadlineRule, 3> rules = {{
    {4, 1'000'000, stop, Recover::next_message},
    {4, 3'000'000, safe_mode, Recover::explicit_call},
    {5, 2'000'000, warn, Recover::next_message},
}};

struct Log {
  std::vector<int> actions;
  void operator()(std::uint8_t action) { actions.push_back(action); }
};

}  // namespace

TEST_CASE("silence from the start strikes each deadline once, in order of time") {
  for (const std::uint32_t start : {0u, 0xFFFFFFFFu - 500'000u}) {  // the second wraps on its way
    CAPTURE(start);
    Deadlines<3> deadlines(rules, start);
    Log log;
    deadlines.poll(start + 999'999, log);
    CHECK(log.actions.empty());
    deadlines.poll(start + 1'000'000, log);
    deadlines.poll(start + 1'000'001, log);
    CHECK(log.actions == std::vector<int>{stop});
    deadlines.poll(start + 9'000'000, log);
    CHECK(log.actions == std::vector<int>{stop, safe_mode, warn});
    CHECK(deadlines.struck(stop));
    CHECK(deadlines.struck(safe_mode));
  }
}

TEST_CASE("a clock that steps back by a second or less strikes nothing, and makes nothing late") {
  for (const std::uint32_t step : {1u, 1'500u, 1'000'000u}) {
    CAPTURE(step);
    Deadlines<3> deadlines(rules, 5'000'000u);
    Log log;
    deadlines.seen(4, 6'000'000);
    deadlines.poll(6'000'000 - step, log);
    CHECK(log.actions.empty());
    CHECK(deadlines.may_act(4, 6'000'000, 6'000'000 - step) == MayAct::yes);
    CHECK(deadlines.time_left(6'000'000 - step) == 1'000'000);
    deadlines.poll(7'000'000, log);
    CHECK(log.actions == std::vector<int>{stop, warn});
  }
}

TEST_CASE("a message puts its own deadlines off, and ends those that end by it") {
  Deadlines<3> deadlines(rules, 0u);
  Log log;
  deadlines.seen(4, 900'000);
  deadlines.poll(1'800'000, log);
  CHECK(log.actions.empty());
  deadlines.poll(4'000'000, log);
  CHECK(log.actions == std::vector<int>{stop, safe_mode, warn});
  deadlines.seen(5, 4'100'000);
  CHECK_FALSE(deadlines.struck(warn));
  CHECK(deadlines.struck(stop));  // another message's
  deadlines.poll(6'100'000, log);
  CHECK(log.actions.back() == warn);
}

TEST_CASE("an explicit deadline that has struck holds its message back until `recover`") {
  for (const std::uint32_t start : {0u, 0xFFFFFFFFu - 3'200'000u}) {  // the second wraps after the strike
    CAPTURE(start);
    Deadlines<3> deadlines(rules, start);
    Log log;
    CHECK(deadlines.may_act(4, start) == MayAct::yes);
    deadlines.seen(4, start);
    deadlines.poll(start + 3'000'000, log);
    CHECK(log.actions == std::vector<int>{stop, safe_mode, warn});
    CHECK(deadlines.may_act(4, start + 3'100'000) == MayAct::held_back);
    CHECK(deadlines.may_act(5, start + 3'100'000) == MayAct::yes);  // another message
    deadlines.seen(4, start + 3'200'000);                           // nor does it end or put off a deadline
    CHECK(deadlines.struck(stop));
    CHECK(deadlines.may_act(4, start + 3'300'000) == MayAct::held_back);
    CHECK(deadlines.not_acted().held_back == 2);
    deadlines.recover(stop, start + 3'350'000);  // ends its own, and nothing else
    CHECK(deadlines.struck(safe_mode));
    CHECK(deadlines.may_act(4, start + 3'360'000) == MayAct::held_back);
    deadlines.recover(safe_mode, start + 3'400'000);
    CHECK_FALSE(deadlines.struck(safe_mode));
    CHECK_FALSE(deadlines.struck(stop));
    CHECK(deadlines.may_act(4, start + 3'400'001) == MayAct::yes);
    log.actions.clear();
    deadlines.poll(start + 4'399'999, log);
    CHECK(log.actions.empty());
    deadlines.poll(start + 6'400'000, log);
    CHECK(log.actions == std::vector<int>{stop, safe_mode});
    CHECK(deadlines.not_acted().late == 0);
  }
}

TEST_CASE("an explicit deadline that strikes before its message ever came holds nothing back") {
  Deadlines<3> deadlines(rules, 0u);
  Log log;
  deadlines.poll(30'000'000, log);  // the host boots
  CHECK(deadlines.struck(safe_mode));
  CHECK(deadlines.may_act(4, 30'000'001) == MayAct::yes);
  CHECK(deadlines.struck(safe_mode));  // it broke a rule of its fields, say: only a valid one ends it
  deadlines.seen(4, 30'000'001);
  CHECK_FALSE(deadlines.struck(safe_mode));
  log.actions.clear();
  deadlines.poll(33'000'001, log);
  CHECK(log.actions == std::vector<int>{stop, safe_mode});
  CHECK(deadlines.may_act(4, 33'000'002) == MayAct::held_back);  // from its first message on, it holds
  deadlines.start(40'000'000);
  CHECK(deadlines.may_act(4, 40'000'001) == MayAct::yes);  // and start means start
}

TEST_CASE("a message as old as the shortest of its deadlines is late") {
  for (const std::uint32_t start : {0u, 0xFFFFFFFFu - 400'000u}) {
    CAPTURE(start);
    Deadlines<3> deadlines(rules, start);
    CHECK(deadlines.may_act(4, start, start + 999'999) == MayAct::yes);
    CHECK(deadlines.may_act(4, start, start + 1'000'000) == MayAct::late);
    CHECK(deadlines.may_act(5, start, start + 1'999'999) == MayAct::yes);
    CHECK(deadlines.may_act(5, start, start + 2'000'000) == MayAct::late);
    CHECK(deadlines.may_act(6, start, start + 100'000'000) == MayAct::yes);  // it has no deadline
    CHECK(deadlines.not_acted().late == 2);
    CHECK(deadlines.not_acted().held_back == 0);
  }
}

TEST_CASE("a message that is late and held back is counted once") {
  Deadlines<3> deadlines(rules, 0u);
  Log log;
  deadlines.seen(4, 0);
  deadlines.poll(3'000'000, log);
  CHECK(deadlines.may_act(4, 2'000'000, 3'000'000) == MayAct::late);
  CHECK(deadlines.not_acted().late == 1);
  CHECK(deadlines.not_acted().held_back == 0);
}

TEST_CASE("silence counts from when the bytes came, not from when somebody looked") {
  Deadlines<3> deadlines(rules, 0u);
  Log log;
  REQUIRE(deadlines.may_act(4, 500'000, 1'400'000) == MayAct::yes);
  deadlines.seen(4, 500'000);
  deadlines.poll(1'499'999, log);
  CHECK(log.actions.empty());
  deadlines.poll(1'500'000, log);
  CHECK(log.actions == std::vector<int>{stop});
}

TEST_CASE("recover without a strike changes nothing: who calls it all the time does not put a deadline off") {
  Deadlines<3> deadlines(rules, 0u);
  Log log;
  for (std::uint32_t now_us = 0; now_us < 3'000'000; now_us += 1'000) {
    deadlines.recover(safe_mode, now_us);
    deadlines.poll(now_us, log);
  }
  deadlines.poll(3'000'000, log);
  CHECK(log.actions == std::vector<int>{stop, warn, safe_mode});
}

TEST_CASE("of two explicit deadlines of a message each is ended by its own action") {
  static constexpr std::array<DeadlineRule, 2> both = {{
      {4, 1'000'000, safe_mode, Recover::explicit_call},
      {4, 2'000'000, stop, Recover::explicit_call},
  }};
  Deadlines<2> deadlines(both, 0u);
  Log log;
  deadlines.seen(4, 0);
  deadlines.poll(2'000'000, log);
  deadlines.recover(safe_mode, 2'100'000);
  CHECK_FALSE(deadlines.struck(safe_mode));
  CHECK(deadlines.struck(stop));
  CHECK(deadlines.may_act(4, 2'200'000) == MayAct::held_back);
  deadlines.recover(stop, 2'300'000);
  CHECK(deadlines.may_act(4, 2'400'000) == MayAct::yes);
}

TEST_CASE("rules that are known at run time only are watched alike") {
  std::vector<DeadlineRule> table(rules.begin(), rules.end());
  std::vector<std::uint64_t> since(3);
  std::vector<std::uint8_t> marks(3, 0xFF);
  const DeadlineSpans<std::uint64_t> spans{table.data(), table.size(), since.data(), marks.data()};
  BasicDeadlines<DeadlineSpans<std::uint64_t>, std::uint64_t> deadlines(spans, 7'000'000'000u);
  Log log;
  deadlines.seen(4, 7'000'000'000u);
  deadlines.poll(7'003'000'000u, log);
  CHECK(log.actions == std::vector<int>{stop, safe_mode, warn});
  CHECK(deadlines.may_act(4, 7'003'000'001u) == MayAct::held_back);
  deadlines.recover(safe_mode, 7'003'000'002u);
  CHECK(deadlines.may_act(4, 7'003'000'003u) == MayAct::yes);
  CHECK_FALSE(deadlines.struck(stop));
}

TEST_CASE("an end without deadlines is fine") {
  constexpr std::array<DeadlineRule, 0> none{};
  Deadlines<0> deadlines(none, 0u);
  Log log;
  deadlines.seen(1, 5);
  deadlines.recover(1, 5);
  deadlines.poll(0xFFFFFFFFu, log);
  CHECK(log.actions.empty());
  CHECK_FALSE(deadlines.struck(0));
}

TEST_CASE("a rhythm is due at its times and keeps them after a stall, across the wrap of the clock") {
  for (const std::uint32_t start : {0u, 0xFFFFFFFFu - 25u}) {
    CAPTURE(start);
    Periodic<> periodic(10, start);
    CHECK_FALSE(periodic.due(start - 1));
    CHECK(periodic.due(start));
    CHECK_FALSE(periodic.due(start + 9));
    CHECK(periodic.due(start + 13));
    CHECK(periodic.next_us() == start + 20);
    CHECK(periodic.due(start + 57));  // a stall: one, not four
    CHECK_FALSE(periodic.due(start + 59));
    CHECK(periodic.due(start + 60));
  }
}
