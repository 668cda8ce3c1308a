// The send queue under relacy: every byte of a frame is a variable that must not be raced for, and frames must come
// whole, once, and in order for each sender. `relacy_queue SCENE SITE full|whole|bound|random AMOUNT`: SITE is a
// member of SendQueueOrders that is weakened to relaxed, or `none`. Of the scenes only `alone` is small enough for
// `whole`, and none for `full`.
#include <array>
#include <cstdint>
#include <cstdio>
#include <cstdlib>
#include <string>
#include <type_traits>
#include <utility>

#include "wirebond/mcu/send_queue.hpp"
// Relacy comes after the header under test.
#include "relacy_search.hpp"

namespace {

using wirebond::Refusal;
using wirebond::Run;
using wirebond::SendQueueOrders;

constexpr unsigned senders = 2;
constexpr std::size_t reserved_bytes = 4;

/// A sender's frame: its bytes are all of the same value. Sender 0 needs less than it reserves.
int value_of(unsigned sender, unsigned number) { return static_cast<int>(1 + sender * 16 + number); }
std::size_t used_by(unsigned sender) { return sender == 0 ? 2 : reserved_bytes; }

/// Two frames from each of two senders, with room for all; the consumer looks when both are done.
struct Alone {
  static constexpr std::size_t capacity = 16;
  static constexpr std::size_t entry_count = 4;
  static constexpr unsigned frames_each = 2;
  static constexpr unsigned threads = senders;
  static constexpr unsigned takes = 0;
  static constexpr unsigned retries = 0;
};
/// Room for two frames, as all scenes below have it.
struct Narrow {
  static constexpr std::size_t capacity = 8;
  static constexpr std::size_t entry_count = 2;
};
/// Two frames from each of two senders, while the consumer looks twice.
struct Pairs : Narrow {
  static constexpr unsigned frames_each = 2;
  static constexpr unsigned threads = senders + 1;
  static constexpr unsigned takes = 2;
  static constexpr unsigned retries = 0;
};
/// One frame from each of two senders, while the consumer looks once.
struct Passing : Narrow {
  static constexpr unsigned frames_each = 1;
  static constexpr unsigned threads = senders + 1;
  static constexpr unsigned takes = 1;
  static constexpr unsigned retries = 0;
};
/// So many frames that room and entries are used again, and the consumer is at work all the time.
struct Circling : Narrow {
  static constexpr unsigned frames_each = 4;
  static constexpr unsigned threads = senders + 1;
  static constexpr unsigned takes = 12;
  static constexpr unsigned retries = 6;
};

/// The same, and each frame gets its place on the wire as it leaves: the consumer writes to it.
struct Numbered : Circling {};

/// The queue's orders, chosen when the program starts, so that one of them can be weakened.
struct ChosenOrders {
  static inline std::memory_order opens = SendQueueOrders::opens;
  static inline std::memory_order closes = SendQueueOrders::closes;
  static inline std::memory_order looks = SendQueueOrders::looks;
  static inline std::memory_order frees = SendQueueOrders::frees;
  static inline std::memory_order finds = SendQueueOrders::finds;
  static inline std::memory_order gives_back = SendQueueOrders::gives_back;
  static inline std::memory_order takes = SendQueueOrders::takes;

  /// False: there is no such site.
  static bool weaken(const std::string& site) {
    const std::pair<const char*, std::memory_order*> sites[] = {
        {"opens", &opens}, {"closes", &closes},         {"looks", &looks}, {"frees", &frees},
        {"finds", &finds}, {"gives_back", &gives_back}, {"takes", &takes}};
    for (const auto& [name, order] : sites) {
      if (site != name) continue;
      *order = std::memory_order_relaxed;
      return true;
    }
    return site == "none";
  }
};

template <class Scene>
struct Senders : rl::test_suite<Senders<Scene>, Scene::threads> {
  using Queue = wirebond::SendQueue<WatchedAtomics, ChosenOrders>;

  static constexpr std::size_t capacity = Scene::capacity;
  static constexpr std::size_t entry_count = Scene::entry_count;
  static constexpr bool is_numbered = std::is_same_v<Scene, Numbered>;

  std::array<std::uint8_t, capacity> ring{};  // places only: what is written there is in `bytes`
  std::array<rl::var<int>, capacity> bytes;
  std::array<typename Queue::Entry, entry_count> entries;
  Queue queue{ring.data(), capacity, entries.data(), entry_count};
  // Each written by one thread.
  std::array<unsigned, senders> accepted{};
  std::array<unsigned, senders> came{};
  std::array<unsigned, senders> newest{};
  // The consumer's: frames that got a number, and those that left.
  int finished = 0;
  int left = 0;

  void thread(unsigned index) {
    if (index < senders) {
      for (unsigned number = 1; number <= Scene::frames_each; ++number) send(index, number);
    } else {
      for (unsigned i = 0; i < Scene::takes; ++i) {
        if (!take()) rl::yield(1, $);
      }
    }
  }

  void after() {
    while (take()) {
    }
    for (unsigned sender = 0; sender < senders; ++sender) RL_ASSERT(came[sender] == accepted[sender]);
    RL_ASSERT(queue.used_bytes() == 0 && queue.used_entries() == 0);
  }

 private:
  void send(unsigned sender, unsigned number) {
    typename Queue::Ticket ticket;
    for (unsigned tried = 0; queue.take(reserved_bytes, 0, 0, ticket) != Refusal::none; ++tried) {
      if (tried == Scene::retries) return;
      rl::yield(1, $);
    }
    for (std::size_t i = 0; i < reserved_bytes; ++i) {
      bytes[static_cast<std::size_t>(ticket.data - ring.data()) + i]($) = value_of(sender, number);
    }
    queue.commit(ticket, used_by(sender));
    ++accepted[sender];
  }

  bool take() {
    const Run run = queue.next(capacity, true, [&](std::uint8_t* frame, std::size_t size, std::uint8_t) {
      const std::size_t end = static_cast<std::size_t>(frame - ring.data()) + size;
      if constexpr (is_numbered) bytes[end - 1]($) = 100 + ++finished;
      return size;
    });
    if (run.size == 0) return false;
    std::size_t at = static_cast<std::size_t>(run.data - ring.data());
    for (std::size_t frame = 0; frame < run.frames; ++frame) {
      const int value = bytes[at]($);
      const unsigned sender = static_cast<unsigned>(value - 1) / 16;
      const unsigned number = static_cast<unsigned>(value - 1) % 16;
      RL_ASSERT(sender < senders && number > newest[sender]);
      newest[sender] = number;
      const std::size_t own = used_by(sender) - is_numbered;
      for (std::size_t i = 0; i < own; ++i) RL_ASSERT(bytes[at + i]($) == value);
      if (is_numbered) RL_ASSERT(bytes[at + own]($) == 100 + ++left);
      at += used_by(sender);
      ++came[sender];
    }
    queue.end_run();
    RL_ASSERT(queue.used_bytes() <= capacity && queue.used_entries() <= entry_count);
    return true;
  }
};

}  // namespace

int main(int count, char** arguments) {
  return search<ChosenOrders>(count, arguments,
                              {{"alone", explore<Senders<Alone>>},
                               {"pairs", explore<Senders<Pairs>>},
                               {"passing", explore<Senders<Passing>>},
                               {"circling", explore<Senders<Circling>>},
                               {"numbered", explore<Senders<Numbered>>}});
}
