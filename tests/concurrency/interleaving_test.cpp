// Senders and the consumer, each interrupted or suspended at every atomic step while others run: by script, all of
// them, and by random schedules. Every frame that was accepted must come whole, once, and in order for its sender; and
// the numbers that frames get as they leave are in the order of the wire, without a gap.
#include <doctest/doctest.h>

#include <array>
#include <cstdint>
#include <functional>
#include <memory>
#include <random>
#include <utility>
#include <vector>

#include "fiber.hpp"
#include "hooked_policy.hpp"
#include "wirebond/mcu/outbox.hpp"

using wirebond::Queue;
using wirebond::Refusal;
using wirebond::Run;

namespace {

struct Config : wirebond::OutboxConfig {
  using Atomics = HookedAtomics;
  static constexpr std::size_t ring_bytes = 32;
  static constexpr std::size_t ring_frames = 4;
};
using Outbox = wirebond::Outbox<Config>;

/// An outbox with its users: what each one sends, and what the consumer found. A frame is its size, sender, number, and
/// the number again up to its end. As it leaves, it gets its place on the wire in its last byte, and every other frame
/// loses a byte, as stuffed frames do.
class World {
 public:
  static constexpr std::size_t senders = 6;

  /// Three quarters of what is granted are used where `shrinks`.
  bool push(std::size_t sender, bool shrinks = false) {
    const std::size_t size = shrinks ? 8 : 6;
    auto grant = outbox_.reserve(size);
    last_refusal_ = grant.refusal();
    if (!grant.ok()) return false;
    const auto number = static_cast<std::uint8_t>(++offered_[sender]);
    std::uint8_t* const data = grant.data();
    const std::size_t used = shrinks ? 6 : size;
    data[0] = static_cast<std::uint8_t>(used);
    data[1] = static_cast<std::uint8_t>(sender);
    for (std::size_t i = 2; i < size; ++i) data[i] = number;
    grant.commit(used);
    ++accepted_[sender];
    return true;
  }

  void drop() {
    auto grant = outbox_.reserve(5);
    for (std::size_t i = 0; i < grant.size(); ++i) grant.data()[i] = 0xDD;
  }

  /// One run, checked and sent; false: there is none.
  bool take() {
    const Run run = outbox_.next(16, [&](std::uint8_t* frame, std::size_t size, std::uint8_t) {
      wrong_ += size != 6 || frame[5] != frame[2];
      if (finished_ % 2 == 1) frame[0] = 5;
      frame[frame[0] - 1] = finished_++;
      return std::size_t{frame[0]};
    });
    std::size_t size = 0;
    for (std::size_t at = 0; at < run.size; at += size) {
      const std::uint8_t* const frame = run.data + at;
      const std::size_t sender = frame[1];
      size = left_ % 2 == 1 ? 5 : 6;
      bool whole = frame[0] == size && sender < senders && run.size - at >= size && frame[size - 1] == left_;
      for (std::size_t i = 3; whole && i < size - 1; ++i) whole = frame[i] == frame[2];
      ++left_;
      if (!whole) return ++wrong_ == 0;
      const auto expected = static_cast<std::uint8_t>(came_[sender] + 1);
      wrong_ += frame[2] != expected;
      ++came_[sender];
    }
    outbox_.sent();
    return run.size != 0;
  }

  /// The consumer frees what was given up, and takes nothing.
  void look() { outbox_.expire_older(0, 1); }

  /// Is there no more in use than the ring has, and no less than what waits?
  bool has_right_room() const {
    std::size_t waiting = 0;
    for (std::size_t sender = 0; sender < senders; ++sender) waiting += accepted_[sender] - came_[sender];
    return outbox_.used_bytes() <= Config::ring_bytes && outbox_.used_bytes() >= 6 * waiting;
  }

  /// Take all that is left; then nothing may be missing, and the account and the room must be what they were at first.
  bool ends_well() {
    for (unsigned i = 0; i < 20 && take(); ++i) {
    }
    const wirebond::SendAccount account = outbox_.account();
    return wrong_ == 0 && came_ == accepted_ && account.balances() && account.queued == 0 && account.unfinished == 0 &&
           outbox_.used_bytes() == 0;
  }

  std::uint32_t accepted(std::size_t sender) const { return accepted_[sender]; }
  std::uint32_t came(std::size_t sender) const { return came_[sender]; }
  Refusal last_refusal() const { return last_refusal_; }

 private:
  std::array<std::uint8_t, Outbox::memory_bytes> memory_{};
  Outbox outbox_{memory_.data()};
  std::array<std::uint32_t, senders> offered_{};
  std::array<std::uint32_t, senders> accepted_{};
  std::array<std::uint32_t, senders> came_{};
  std::uint8_t finished_ = 0;  // frames that got a number
  std::uint8_t left_ = 0;      // frames that left
  std::size_t wrong_ = 0;
  Refusal last_refusal_ = Refusal::none;
};

/// What a task or an interrupt does.
enum Act { push_two, push_shrunk, drop, take, acts };

/// Levels of interrupts, one script: level i is interrupted by level i + 1 at its step `at[i]`.
template <std::size_t Depth>
class Nest {
 public:
  Nest(const std::array<Act, Depth + 1>& script, const std::array<unsigned, Depth>& at) : acts_(script), at_(at) {}

  void run() {
    current_ = this;
    HookedAtomics::hook = [] { current_->step(); };
    act();
    HookedAtomics::hook = nullptr;
  }
  /// Were there as many steps at this level?
  bool reached(std::size_t level) const { return reached_[level]; }
  World world;

 private:
  void step() {
    if (level_ == Depth || ++steps_[level_] != at_[level_] + 1) return;
    reached_[level_] = true;
    ++level_;
    act();
    --level_;
  }

  void act() {
    const std::size_t sender = level_;
    switch (acts_[level_]) {
      case push_two:
        world.push(sender);
        world.push(sender);
        break;
      case push_shrunk: world.push(sender, true); break;
      case drop: world.drop(); break;
      default: world.take(); break;
    }
  }

  static inline Nest* current_ = nullptr;
  std::array<Act, Depth + 1> acts_;
  std::array<unsigned, Depth> at_;
  std::array<unsigned, Depth> steps_{};
  std::array<bool, Depth> reached_{};
  std::size_t level_ = 0;
};

/// Every step of `script` at which its interrupts may come. `before` frames wait already, `taken` have left.
template <std::size_t Depth>
std::size_t nest_everywhere(const std::array<Act, Depth + 1>& script, unsigned taken, unsigned before) {
  std::size_t runs = 0;
  std::array<unsigned, Depth> at{};
  for (;;) {
    Nest<Depth> nest(script, at);
    for (unsigned i = 0; i < taken; ++i) {
      nest.world.push(5);
      nest.world.take();
    }
    for (unsigned i = 0; i < before; ++i) nest.world.push(5);
    nest.run();
    ++runs;
    const bool well = nest.world.ends_well();
    if (!well) CAPTURE(at);
    REQUIRE(well);
    // The next combination: the innermost level counts up, and the level before it where it had no such step.
    std::size_t level = Depth;
    while (level > 0 && !nest.reached(level - 1)) --level;
    if (level == 0) return runs;
    ++at[level - 1];
    for (std::size_t inner = level; inner < Depth; ++inner) at[inner] = 0;
  }
}

template <std::size_t Depth>
bool has_one_consumer(const std::array<Act, Depth + 1>& script) {
  unsigned consumers = 0;
  for (const Act act : script) consumers += act == take;
  return consumers <= 1;
}

template <std::size_t Depth>
std::size_t nest_all_scripts(unsigned taken, unsigned before) {
  std::size_t runs = 0;
  unsigned scripts = 1;
  for (std::size_t i = 0; i <= Depth; ++i) scripts *= acts;
  for (unsigned number = 0; number < scripts; ++number) {
    std::array<Act, Depth + 1> script;
    for (unsigned i = 0, rest = number; i <= Depth; ++i, rest /= acts) script[i] = static_cast<Act>(rest % acts);
    CAPTURE(number);
    if (has_one_consumer<Depth>(script)) runs += nest_everywhere<Depth>(script, taken, before);
  }
  return runs;
}

/// Somebody who is suspended before step `at` of what he does, and goes on when he is resumed.
class Suspended {
 public:
  Suspended(unsigned at, std::function<void()> act) : at_(at), fiber_(std::move(act)) {}

  /// Run up to the step. False: it ended before.
  bool start() {
    current_ = this;
    HookedAtomics::hook = [] {
      if (current_->steps_++ == current_->at_) Fiber::pause();
    };
    fiber_.resume();
    HookedAtomics::hook = nullptr;
    return !fiber_.ended();
  }
  void finish() { fiber_.resume(); }

 private:
  static inline Suspended* current_ = nullptr;
  unsigned at_;
  unsigned steps_ = 0;
  Fiber fiber_;
};

}  // namespace

TEST_CASE("interrupts that come at every step, two deep, into an empty ring, a full one, and across its end") {
  CHECK(nest_all_scripts<2>(0, 0) > 5'000);
  CHECK(nest_all_scripts<2>(3, 2) > 5'000);
  CHECK(nest_all_scripts<2>(2, 4) > 5'000);
}

TEST_CASE("interrupts that come at every step, three deep" * doctest::skip()) {
  CHECK(nest_all_scripts<3>(0, 0) > 100'000);
  CHECK(nest_all_scripts<3>(3, 2) > 100'000);
}

TEST_CASE("two senders suspended at every step delay no other sender's frame, whoever goes on first") {
  std::size_t held = 0;
  for (unsigned taken = 0; taken < 8; ++taken) {
    for (unsigned first_at = 0, first_ends = 0; first_ends == 0; ++first_at) {
      for (unsigned second_at = 0, second_ends = 0; second_ends == 0; ++second_at) {
        for (const bool in_order : {true, false}) {
          CAPTURE(taken);
          CAPTURE(first_at);
          CAPTURE(second_at);
          World world;
          for (unsigned i = 0; i < taken; ++i) {
            world.push(5);
            world.take();
          }
          Suspended first(first_at, [&] { world.push(0); });
          Suspended second(second_at, [&] { world.push(1, true); });
          first_ends = !first.start();
          second_ends = !second.start();
          // A third one sends until there is no more room, twice round the ring where it may.
          for (unsigned i = 0; i < 12; ++i) {
            while (world.take()) {
            }
            if (!world.push(2)) break;
          }
          held += world.last_refusal() == Refusal::held;
          while (world.take()) {
          }
          REQUIRE(world.came(2) == world.accepted(2));
          REQUIRE(world.accepted(2) >= 1);
          (in_order ? first : second).finish();
          while (world.take()) {
          }
          (in_order ? second : first).finish();
          REQUIRE(world.ends_well());
        }
      }
    }
  }
  CHECK(held > 100);
}

TEST_CASE("a sender and the consumer suspended at every step, in each other's middle") {
  for (const Act act : {push_two, push_shrunk, drop}) {
    for (unsigned waiting = 0; waiting < 3; ++waiting) {
      for (const bool takes : {true, false}) {
        for (unsigned sender_at = 0, sender_ends = 0; sender_ends == 0; ++sender_at) {
          for (unsigned consumer_at = 0, consumer_ends = 0; consumer_ends == 0; ++consumer_at) {
            CAPTURE(act);
            CAPTURE(waiting);
            CAPTURE(sender_at);
            CAPTURE(consumer_at);
            World world;
            Suspended sender(sender_at, [&] {
              if (act == drop) return world.drop();
              world.push(0, act == push_shrunk);
              if (act == push_two) world.push(0);
            });
            Suspended consumer(consumer_at, [&] { takes ? static_cast<void>(world.take()) : world.look(); });
            sender_ends = !sender.start();
            for (unsigned i = 0; i < waiting; ++i) world.push(1);
            consumer_ends = !consumer.start();
            sender.finish();
            world.push(0);
            consumer.finish();
            REQUIRE(world.has_right_room());
            REQUIRE(world.ends_well());
          }
        }
      }
    }
  }
}

TEST_CASE("a sender suspended at every step of reserve is not refused where there is room when it goes on") {
  for (unsigned laps = 0; laps < 12; ++laps) {
    for (unsigned at = 0, ends = 0; ends == 0; ++at) {
      CAPTURE(laps);
      CAPTURE(at);
      World world;
      Suspended sender(at, [&] { world.push(0); });
      ends = !sender.start();
      for (unsigned i = 0; i < laps; ++i) {
        world.push(1);
        world.take();
      }
      sender.finish();
      REQUIRE(world.accepted(0) == 1);
      REQUIRE(world.ends_well());
    }
  }
}

TEST_CASE("random schedules of four senders and the consumer, a step at a time") {
  HookedAtomics::hook = &Fiber::pause;
  std::size_t refused = 0;
  for (unsigned seed = 0; seed < 600; ++seed) {
    CAPTURE(seed);
    std::mt19937 random(seed);
    World world;
    std::vector<std::unique_ptr<Fiber>> fibers;
    for (std::size_t sender = 0; sender < 4; ++sender) {
      fibers.push_back(std::make_unique<Fiber>([&world, &refused, sender] {
        for (unsigned i = 0; i < 25; ++i) {
          if (i % 7 == 6) world.drop();
          refused += !world.push(sender, sender % 2 == 0);
        }
      }));
    }
    fibers.push_back(std::make_unique<Fiber>([&world] {
      for (unsigned i = 0; i < 60; ++i) world.take();
    }));
    // One fiber runs for a while and then another one, so that senders are left behind by laps, too.
    for (std::size_t alive = fibers.size(); alive != 0;) {
      Fiber& fiber = *fibers[random() % fibers.size()];
      if (fiber.ended()) continue;
      for (unsigned steps = 1 + static_cast<unsigned>(random() % (random() % 4 == 0 ? 200 : 6)); steps != 0; --steps) {
        fiber.resume();
      }
      alive -= fiber.ended();
    }
    REQUIRE(world.ends_well());
  }
  HookedAtomics::hook = nullptr;
  CHECK(refused > 1000);
}
