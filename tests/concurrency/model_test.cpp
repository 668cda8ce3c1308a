// The outbox against a list: random senders that hold grants across each other's calls, random consumers; after every
// step each count, and each run, is what the model says. One thread.
#include <doctest/doctest.h>

#include <array>
#include <cstdint>
#include <map>
#include <optional>
#include <random>
#include <vector>

#include "list_model.hpp"
#include "wirebond/mcu/outbox.hpp"

using wirebond::Queue;
using wirebond::Refusal;
using wirebond::Run;
using wirebond::SendAccount;

namespace {

constexpr std::size_t cell_bytes = 12;

template <std::int16_t Index>
struct Newest {
  struct Info {
    static constexpr std::int16_t index = Index;
    static constexpr Queue queue = Queue::latest;
    static constexpr std::size_t max_frame_bytes = cell_bytes;
  };
};

template <std::size_t Bytes, std::size_t Frames, bool Passes>
struct Config : wirebond::OutboxConfig {
  using Atomics = wirebond::CompareAndSwap<std::uint16_t>;  // as on the MCU: positions wrap within a test
  static constexpr std::size_t ring_bytes = Bytes;
  static constexpr std::size_t ring_frames = Frames;
  static constexpr std::size_t urgent_bytes = 32;
  static constexpr std::size_t urgent_frames = 4;
  using Latest = wirebond::MessageList<Newest<0>, Newest<1>>;
  static constexpr std::size_t latest_cells = 3;  // so that often none is free
  static constexpr bool passes_unfinished = Passes;
};

/// How often the corners were reached, so that the test cannot pass without them.
struct Corners {
  std::size_t exactly_full = 0;
  std::size_t empty_again = 0;
  std::size_t refused_full = 0;
  std::size_t refused_held = 0;
  std::size_t replaced = 0;
  std::size_t replaced_unsent = 0;  ///< by a sender that found no free cell
  std::size_t expired = 0;
  std::size_t aborted = 0;
  std::size_t runs_of_several = 0;
};

template <class Configured>
class Comparison {
  using Outbox = wirebond::Outbox<Configured>;
  struct Held {
    wirebond::Grant<Outbox> grant;
    std::uint64_t name;
    Queue queue;
    std::size_t slot;
    std::uint16_t stamp;
  };

 public:
  explicit Comparison(unsigned seed, Corners& corners) : random_(seed), corners_(corners) {}

  void step() {
    now_ms_ = static_cast<std::uint16_t>(now_ms_ + draw(40));
    switch (draw(16)) {
      case 0:
      case 1:
      case 2:
      case 3:
      case 4:
      case 5: reserve(); break;
      case 6:
      case 7:
      case 8:
      case 9: finish(); break;
      case 10:
      case 11:
      case 12: next(); break;
      case 13:
      case 14: end_run(draw(8) == 0); break;
      default: expire(); break;
    }
    compare();
  }

 private:
  unsigned draw(unsigned below) { return static_cast<unsigned>(random_() % below); }
  model::List& list_of(Queue queue) { return queue == Queue::urgent ? urgent_ : ring_; }

  void reserve() {
    auto& held = senders_[draw(static_cast<unsigned>(senders_.size()))];
    if (held.has_value()) return;
    const auto queue = static_cast<Queue>(draw(3));
    const std::size_t slot = draw(2);
    const std::size_t size = 1 + draw(draw(4) == 0 ? 40 : 12);
    const std::uint64_t name = ++names_;
    ++model_.offered;
    auto grant =
        queue == Queue::latest ? outbox_.reserve_latest(slot, size, now_ms_) : outbox_.reserve(size, queue, now_ms_);
    const Refusal expected =
        queue == Queue::latest ? slots_[slot].reserve(size) : list_of(queue).reserve(name, size, now_ms_);
    REQUIRE(grant.refusal() == expected);
    REQUIRE(grant.ok() == (expected == Refusal::none));
    if (!grant.ok()) {
      ++model_.refused_by[static_cast<std::size_t>(expected)];
      corners_.refused_full += expected == Refusal::full;
      corners_.refused_held += expected == Refusal::held;
      return;
    }
    if (queue == Queue::latest && slots_[slot].replaces) ++model_.replaced, ++corners_.replaced_unsent;
    REQUIRE(grant.size() == size);
    for (std::size_t i = 0; i < size; ++i) grant.data()[i] = byte_at(name, i);
    held.emplace(Held{std::move(grant), name, queue, slot, now_ms_});
  }

  void finish() {
    auto& held = senders_[draw(static_cast<unsigned>(senders_.size()))];
    if (!held.has_value()) return;
    if (draw(6) == 0) {
      const Refusal why = draw(2) == 0 ? Refusal::abandoned : Refusal::range;
      ++model_.refused_by[static_cast<std::size_t>(why)];
      if (held->queue == Queue::latest) {
        --slots_[held->slot].writing;
      } else {
        list_of(held->queue).abandon(held->name);
      }
      if (why == Refusal::range) held->grant.give_back(why);
    } else {
      const std::size_t used = draw(3) == 0 ? 1 + draw(static_cast<unsigned>(held->grant.size())) : held->grant.size();
      ++model_.accepted;
      sizes_[held->name] = used;
      if (held->queue == Queue::latest) {
        const bool replaces = slots_[held->slot].commit(held->name, held->stamp);
        model_.replaced += replaces;
        corners_.replaced += replaces;
      } else {
        list_of(held->queue).commit(held->name, used);
      }
      held->grant.commit(used);
    }
    held.reset();  // abandoned grants end here
  }

  void next() {
    const std::size_t max_bytes = 1 + draw(60);
    std::size_t finished = 0;
    const Run run = outbox_.next(max_bytes, [&](std::uint8_t*, std::size_t, std::uint8_t) { ++finished; });
    if (!run_.empty()) {  // one is under way: the same again
      REQUIRE(run.frames == run_.size());
      REQUIRE(finished == 0);
      return check_bytes(run);
    }
    run_ = urgent_.next(max_bytes, Configured::passes_unfinished);
    if (run_.empty()) run_ = by_turns(run, max_bytes);
    REQUIRE(run.frames == run_.size());
    REQUIRE(finished == run_.size());
    corners_.runs_of_several += run_.size() > 1;
    check_bytes(run);
  }

  /// After a run of the queue it is the slots' turn. Which slot is the outbox's to choose.
  std::vector<std::uint64_t> by_turns(const Run& run, std::size_t max_bytes) {
    const bool slots_wait = slots_[0].waiting.has_value() || slots_[1].waiting.has_value();
    if (!slots_turn_ || !slots_wait) {
      std::vector<std::uint64_t> names = ring_.next(max_bytes, Configured::passes_unfinished);
      slots_turn_ = !names.empty();
      if (slots_turn_ || !slots_wait) return names;
    }
    slots_turn_ = false;
    const std::uint8_t* const cells = memory_.data() + Configured::ring_bytes + Configured::urgent_bytes;
    REQUIRE(run.data >= cells);
    const std::size_t slot = static_cast<std::size_t>(run.data - cells) / (Configured::latest_cells * cell_bytes);
    REQUIRE(slots_[slot].waiting.has_value());
    slots_[slot].sending = slots_[slot].waiting;
    slots_[slot].waiting.reset();
    return {*slots_[slot].sending};
  }

  void check_bytes(const Run& run) {
    std::size_t at = 0;
    for (const std::uint64_t name : run_) {
      for (std::size_t i = 0; i < sizes_[name]; ++i) REQUIRE(run.data[at + i] == byte_at(name, i));
      at += sizes_[name];
    }
    REQUIRE(run.size == at);
  }

  void end_run(bool aborts) {
    if (aborts) {
      outbox_.aborted();
      model_.aborted += static_cast<std::uint32_t>(run_.size());
      corners_.aborted += run_.size();
    } else {
      outbox_.sent();
      model_.sent += static_cast<std::uint32_t>(run_.size());
    }
    run_.clear();
    for (model::Slot& slot : slots_) slot.sending.reset();
    if (urgent_.is_sending()) urgent_.end_run();
    if (ring_.is_sending()) ring_.end_run();
    corners_.empty_again += ring_.used_bytes() == 0;
  }

  void expire() {
    const std::uint16_t max_age_ms = static_cast<std::uint16_t>(draw(4) == 0 ? 0 : 300);
    const bool all = draw(8) == 0;
    const auto is_old = [&](std::uint16_t stamp) {
      return all || static_cast<std::uint16_t>(now_ms_ - stamp) > max_age_ms;
    };
    std::size_t expired = urgent_.expire(is_old) + ring_.expire(is_old);
    for (model::Slot& slot : slots_) {
      if (!slot.waiting.has_value() || !is_old(slot.waiting_stamp)) continue;
      slot.waiting.reset();
      ++expired;
    }
    if (all) {
      outbox_.expire_all();
    } else {
      outbox_.expire_older(now_ms_, max_age_ms);
    }
    model_.expired += static_cast<std::uint32_t>(expired);
    corners_.expired += expired;
  }

  void compare() {
    model_.queued = static_cast<std::uint32_t>(ring_.queued() + urgent_.queued());
    model_.unfinished = static_cast<std::uint32_t>(ring_.unfinished() + urgent_.unfinished());
    for (const model::Slot& slot : slots_) {
      model_.queued += static_cast<std::uint32_t>(slot.queued());
      model_.unfinished += static_cast<std::uint32_t>(slot.writing);
    }
    const SendAccount account = outbox_.account();
    REQUIRE(account.balances());
    REQUIRE(account.offered == model_.offered);
    REQUIRE(account.accepted == model_.accepted);
    REQUIRE(account.refused_by == model_.refused_by);
    REQUIRE(account.sent == model_.sent);
    REQUIRE(account.replaced == model_.replaced);
    REQUIRE(account.expired == model_.expired);
    REQUIRE(account.aborted == model_.aborted);
    REQUIRE(account.queued == model_.queued);
    REQUIRE(account.unfinished == model_.unfinished);
    REQUIRE(outbox_.used_bytes() == ring_.used_bytes());
    REQUIRE(outbox_.peak_bytes() <= Configured::ring_bytes);
    REQUIRE(outbox_.peak_bytes() >= ring_.used_bytes());
    corners_.exactly_full += ring_.is_full();
  }

  static std::uint8_t byte_at(std::uint64_t name, std::size_t i) { return static_cast<std::uint8_t>(name * 37 + i); }

  std::mt19937 random_;
  Corners& corners_;
  std::array<std::uint8_t, Outbox::memory_bytes> memory_{};
  Outbox outbox_{memory_.data()};
  std::array<std::optional<Held>, 6> senders_;  // behind the outbox: grants end first

  model::List ring_{Configured::ring_bytes, Configured::ring_frames};
  model::List urgent_{Configured::urgent_bytes, Configured::urgent_frames};
  std::array<model::Slot, 2> slots_{model::Slot{Configured::latest_cells, cell_bytes},
                                    model::Slot{Configured::latest_cells, cell_bytes}};
  SendAccount model_;
  std::map<std::uint64_t, std::size_t> sizes_;
  std::vector<std::uint64_t> run_;
  std::uint64_t names_ = 0;
  std::uint16_t now_ms_ = 0;
  bool slots_turn_ = false;
};

template <class Configured>
void compare_for(unsigned seeds, unsigned steps) {
  Corners corners;
  for (unsigned seed = 0; seed < seeds; ++seed) {
    CAPTURE(seed);
    Comparison<Configured> comparison(seed, corners);
    for (unsigned i = 0; i < steps; ++i) comparison.step();
  }
  CHECK(corners.exactly_full > 100);
  CHECK(corners.empty_again > 100);
  CHECK(corners.refused_full > 100);
  CHECK(corners.refused_held > 100);
  CHECK(corners.replaced > 100);
  CHECK(corners.replaced_unsent > 10);
  CHECK(corners.expired > 100);
  CHECK(corners.aborted > 100);
  CHECK(corners.runs_of_several > 100);
}

}  // namespace

TEST_CASE("an outbox whose bytes run out first is the list, step by step") {
  compare_for<Config<64, 16, true>>(15, 4000);
}

TEST_CASE("an outbox whose entries run out first is the list, step by step") {
  compare_for<Config<256, 4, true>>(15, 4000);
}

TEST_CASE("an outbox where nothing passes an unfinished frame is the list, step by step") {
  compare_for<Config<64, 16, false>>(15, 4000);
}
