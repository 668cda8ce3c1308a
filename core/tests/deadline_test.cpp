// Deadlines and rhythms over a clock that wraps.
#include "wirebond/deadline.hpp"

#include <doctest/doctest.h>

#include <array>
#include <cstdint>
#include <vector>

using wirebond::DeadlineRule;
using wirebond::Deadlines;
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

TEST_CASE("a message puts its own deadlines off, and ends those that end by it") {
  Deadlines<3> deadlines(rules, 0u);
  Log log;
  deadlines.seen(4, 900'000);
  deadlines.poll(1'800'000, log);
  CHECK(log.actions.empty());
  deadlines.poll(4'000'000, log);
  CHECK(log.actions == std::vector<int>{stop, safe_mode, warn});
  deadlines.seen(4, 4'100'000);
  CHECK_FALSE(deadlines.struck(stop));
  CHECK(deadlines.struck(safe_mode));  // only an explicit call ends it
  CHECK(deadlines.struck(warn));       // another message's
  deadlines.poll(5'100'000, log);
  CHECK(log.actions.back() == stop);
}

TEST_CASE("an explicit recovery counts the silence anew") {
  Deadlines<3> deadlines(rules, 0u);
  Log log;
  deadlines.poll(3'500'000, log);
  deadlines.recover(safe_mode, 4'000'000);
  CHECK_FALSE(deadlines.struck(safe_mode));
  CHECK(deadlines.struck(stop));
  log.actions.clear();
  deadlines.poll(6'999'999, log);
  CHECK(log.actions.empty());
  deadlines.poll(7'000'000, log);
  CHECK(log.actions == std::vector<int>{safe_mode});
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
