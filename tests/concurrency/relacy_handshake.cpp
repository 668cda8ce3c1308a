// The handshake of senders, poll and the UART's interrupt under relacy, with the send queue between them: no frame may
// stay behind while nobody is going to look for it, and no run may be broken off but the one that is under way.
// `relacy_handshake SCENE SITE full|whole|bound|random AMOUNT`: SITE is a member of HandshakeOrders that is weakened to
// relaxed, or `none`.
#include <array>
#include <cstdint>
#include <cstdio>
#include <string>
#include <utility>

#include "wirebond/mcu/handshake.hpp"
#include "wirebond/mcu/send_queue.hpp"
// Relacy comes after the headers under test.
#include "relacy_search.hpp"

namespace {

using wirebond::HandshakeOrders;
using wirebond::Line;
using wirebond::Refusal;

constexpr unsigned senders = 2;

/// One frame from each of two senders, and an interrupt that serves what is pended.
struct Meeting {
  static constexpr unsigned frames_each = 1;
  static constexpr unsigned turns = 3;
  static constexpr unsigned looks = 0;
  static constexpr bool refuses = false;
};
/// More frames, a port that refuses a run now and then, and a poll that gives up on runs.
struct Crowd {
  static constexpr unsigned frames_each = 3;
  static constexpr unsigned turns = 10;
  static constexpr unsigned looks = 4;
  static constexpr bool refuses = true;
};

/// The handshake's orders, chosen when the program starts, so that one of them can be weakened.
struct ChosenOrders {
  static inline std::memory_order offers = HandshakeOrders::offers;
  static inline std::memory_order takes = HandshakeOrders::takes;
  static inline std::memory_order rests = HandshakeOrders::rests;

  /// False: there is no such site.
  static bool weaken(const std::string& site) {
    const std::pair<const char*, std::memory_order*> sites[] = {
        {"offers", &offers}, {"takes", &takes}, {"rests", &rests}};
    for (const auto& [name, order] : sites) {
      if (site != name) continue;
      *order = std::memory_order_relaxed;
      return true;
    }
    return site == "none";
  }
};

/// Threads: the senders, the interrupt, and poll where the scene has it.
template <class Scene>
struct Parties : rl::test_suite<Parties<Scene>, senders + 1 + (Scene::looks != 0)> {
  using Queue = wirebond::SendQueue<WatchedAtomics>;
  using Handshake = wirebond::Handshake<WatchedAtomics, ChosenOrders>;

  static constexpr std::size_t capacity = 8;
  static constexpr std::size_t entry_count = 2;

  std::array<std::uint8_t, capacity> ring{};
  std::array<typename Queue::Entry, entry_count> entries;
  Queue queue{ring.data(), capacity, entries.data(), entry_count};
  Handshake handshake;
  rl::atomic<unsigned> pended;  // as weak as can be: the handshake must not lean on it
  // Each written by one thread.
  std::array<unsigned, senders> accepted{};
  unsigned came = 0;
  unsigned runs = 0;
  bool sending = false;

  void before() { pended.store(0, rl::mo_relaxed, $); }

  void thread(unsigned index) {
    if (index < senders) {
      for (unsigned i = 0; i < Scene::frames_each; ++i) send(index);
    } else if (index == senders) {
      for (unsigned i = 0; i < Scene::turns; ++i) {
        if (!turn()) rl::yield(1, $);
      }
    } else {
      for (unsigned i = 0; i < Scene::looks; ++i) poll();
    }
  }

  void after() {
    while (turn()) {
    }
    // What poll asks for until it is done; a frame that nobody looks for is not among that.
    while (handshake.look().line() == Line::refused || handshake.look().restart()) {
      pend();
      while (turn()) {
      }
    }
    RL_ASSERT(came == accepted[0] + accepted[1]);
    RL_ASSERT(handshake.look().line() == Line::idle && !handshake.look().asks());
  }

 private:
  void pend() { pended.store(1, rl::mo_relaxed, $); }

  void send(unsigned sender) {
    typename Queue::Ticket ticket;
    if (queue.take(2, 0, 0, ticket) == Refusal::none) {
      queue.commit(ticket, 2);
      ++accepted[sender];
    }
    if (handshake.offer()) pend();
  }

  /// The UART's interrupt, as Link has it. False: there was nothing to do.
  bool turn() {
    if (pended.exchange(0, rl::mo_relaxed, $) != 0) {
      if (handshake.look().restart()) handshake.restarted();
      switch (handshake.take()) {
        case Handshake::Work::none: break;
        case Handshake::Work::abort:
          RL_ASSERT(sending);
          end_run();
          [[fallthrough]];
        case Handshake::Work::look: send_next(); break;
      }
      return true;
    }
    if (!sending) return false;
    RL_ASSERT(handshake.complete());
    end_run();
    send_next();
    return true;
  }

  void end_run() {
    sending = false;
    queue.end_run([this](std::uint8_t) { ++came; });
  }

  void send_next() {
    RL_ASSERT(!sending);
    while (queue.next(capacity).size == 0) {
      if (handshake.rest()) return;
    }
    handshake.found();
    sending = !Scene::refuses || ++runs % 4 != 0;
    if (!sending) handshake.refuse();
  }

  void poll() {
    const auto line = handshake.look();
    bool asks = line.asks();
    if (line.begun()) {
      handshake.note(false);
    } else if (line.line() == Line::sending) {
      asks = handshake.ask_abort() || asks;
    } else {
      handshake.ask_restart();
      asks = true;
    }
    if (asks) pend();
  }
};

}  // namespace

int main(int count, char** arguments) {
  return search<ChosenOrders>(count, arguments,
                              {{"meeting", explore<Parties<Meeting>>}, {"crowd", explore<Parties<Crowd>>}});
}
