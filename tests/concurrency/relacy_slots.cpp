// The slots of `latest` messages under relacy: every byte of a cell is a variable that must not be raced for, frames
// come whole, and never an older one after a newer one. `relacy_slots SCENE SITE full|whole|bound|random AMOUNT`: SITE
// is a member of LatestSlotsOrders that is weakened to relaxed, or `none`.
#include <array>
#include <cstdint>
#include <cstdio>
#include <cstdlib>
#include <string>
#include <utility>

#include "wirebond/mcu/latest_slots.hpp"
// Relacy comes after the header under test.
#include "relacy_search.hpp"

namespace {

using wirebond::LatestSlotsOrders;
using wirebond::Refusal;
using wirebond::Run;

constexpr unsigned writers = 2;
constexpr std::size_t cell_bytes = 3;

/// A writer's frame: its bytes are all of the same value, which also tells how many there are.
int value_of(unsigned writer, unsigned number) { return static_cast<int>(1 + writer * 16 + number); }
unsigned writer_of(int value) { return static_cast<unsigned>(value - 1) / 16; }
unsigned number_of(int value) { return static_cast<unsigned>(value - 1) % 16; }
std::size_t size_of(int value) { return 2 + static_cast<std::size_t>(value) % 2; }

/// One frame from each of two writers, while the consumer looks once: small enough for all of its schedules.
struct Meeting {
  static constexpr unsigned cells = 3;
  static constexpr unsigned frames_each = 1;
  static constexpr unsigned looks = 1;
  static constexpr bool gives_up = false;
};
/// So many frames that every cell is used again, some given back and some expired; with three cells a writer finds none
/// free at times, and takes that of the frame that waits.
struct Replacing {
  static constexpr unsigned cells = 3;
  static constexpr unsigned frames_each = 6;
  static constexpr unsigned looks = 8;
  static constexpr bool gives_up = true;
};

/// The slots' orders, chosen when the program starts, so that one of them can be weakened.
struct ChosenOrders {
  static inline std::memory_order takes = LatestSlotsOrders::takes;
  static inline std::memory_order commits = LatestSlotsOrders::commits;
  static inline std::memory_order abandons = LatestSlotsOrders::abandons;
  static inline std::memory_order sends = LatestSlotsOrders::sends;
  static inline std::memory_order frees = LatestSlotsOrders::frees;

  /// False: there is no such site.
  static bool weaken(const std::string& site) {
    const std::pair<const char*, std::memory_order*> sites[] = {
        {"takes", &takes}, {"commits", &commits}, {"abandons", &abandons}, {"sends", &sends}, {"frees", &frees}};
    for (const auto& [name, order] : sites) {
      if (site != name) continue;
      *order = std::memory_order_relaxed;
      return true;
    }
    return site == "none";
  }
};

template <class Scene>
struct Writers : rl::test_suite<Writers<Scene>, writers + 1> {
  using Slots = wirebond::BasicLatestSlots<WatchedAtomics, Scene::cells, ChosenOrders, cell_bytes>;

  std::array<std::uint8_t, Slots::memory_bytes> memory{};  // places only: what is written there is in `bytes`
  std::array<rl::var<int>, Slots::memory_bytes> bytes;
  Slots slots{memory.data()};
  // Each written by one thread.
  std::array<unsigned, writers> accepted{};
  std::array<unsigned, writers> replaced{};
  std::array<unsigned, writers> last{};    // the newest number that a writer committed
  std::array<unsigned, writers> newest{};  // the newest number that came
  unsigned came = 0;
  unsigned expired = 0;
  // When a sender began is between two ticks. Whoever sees its frame sees these.
  struct Span {
    unsigned before = 0;
    unsigned behind = 0;
  };
  rl::atomic<unsigned> ticks;
  std::array<std::array<Span, Scene::frames_each + 1>, writers> began{};
  Span newest_began{};  // of the frame that came last

  void before() { ticks.store(1, rl::mo_relaxed, $); }

  void thread(unsigned index) {
    if (index < writers) {
      for (unsigned number = 1; number <= Scene::frames_each; ++number) send(index, number);
      return;
    }
    for (unsigned look = 1; look <= Scene::looks; ++look) {
      const auto is_old = [](std::uint16_t) { return true; };
      if (Scene::gives_up && look == Scene::looks / 2 && slots.expire(0, is_old)) ++expired;
      if (!take()) rl::yield(1, $);
    }
  }

  void after() {
    const bool waits = slots.finished(0) != 0;
    if (waits) {
      RL_ASSERT(take());
      // What waited to the end was committed after all others, those of its own writer among them.
      RL_ASSERT(newest[0] == last[0] || newest[1] == last[1]);
    }
    RL_ASSERT(!take());
    RL_ASSERT(accepted[0] + accepted[1] == came + expired + replaced[0] + replaced[1]);
    RL_ASSERT(slots.finished(0) == 0 && slots.unfinished(0) == 0);
  }

 private:
  void send(unsigned writer, unsigned number) {
    typename Slots::Ticket ticket;
    Span& span = began[writer][number];
    if (Scene::gives_up) span.before = ticks.fetch_add(1, rl::mo_relaxed, $);
    // With a cell for each writer and one on the wire none is refused, whatever waits.
    RL_ASSERT(slots.take(0, cell_bytes, number, ticket) == Refusal::none);
    if (Scene::gives_up) span.behind = ticks.fetch_add(1, rl::mo_relaxed, $);
    replaced[writer] += ticket.replaces;
    const int value = value_of(writer, number);
    const std::size_t at = static_cast<std::size_t>(ticket.data - memory.data());
    for (std::size_t i = 0; i < size_of(value); ++i) bytes[at + i]($) = value;
    if (Scene::gives_up && number % 3 == writer) {
      slots.abandon(ticket);
      return;
    }
    replaced[writer] += slots.commit(ticket, size_of(value));
    last[writer] = number;
    ++accepted[writer];
  }

  bool take() {
    const Run run = slots.next(0);
    if (run.size == 0) return false;
    const std::size_t at = static_cast<std::size_t>(run.data - memory.data());
    const int value = bytes[at]($);
    RL_ASSERT(writer_of(value) < writers && run.size == size_of(value));
    RL_ASSERT(number_of(value) > newest[writer_of(value)]);
    newest[writer_of(value)] = number_of(value);
    const Span& span = began[writer_of(value)][number_of(value)];
    RL_ASSERT(span.behind >= newest_began.before);  // it did not begin before the one that came last
    newest_began = span;
    for (std::size_t i = 1; i < run.size; ++i) RL_ASSERT(bytes[at + i]($) == value);
    slots.end_run(0);
    ++came;
    return true;
  }
};

}  // namespace

int main(int count, char** arguments) {
  return search<ChosenOrders>(count, arguments,
                              {{"meeting", explore<Writers<Meeting>>}, {"replacing", explore<Writers<Replacing>>}});
}
