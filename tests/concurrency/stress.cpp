// Threads send as fast as they can into a queue, one thread takes runs out of it and checks each frame: whole, once,
// and in order for each sender. `stress KIND SENDERS FRAMES`, KIND one of
//   outbox  frames of the normal queue
//   mixed   also urgent ones, `latest` ones, grants given back, grants of which less is used, frames that expire or
//   abort mutex   the same frames through a plain ring behind a mutex
// prints one line of JSON. Exit code 1 where a frame that was accepted is missing, or the account does not balance.
#include <array>
#include <atomic>
#include <chrono>
#include <cstdint>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <ctime>
#include <string_view>
#include <thread>
#include <vector>

#include "frames.hpp"
#include "mutex_ring.hpp"
#include "wirebond/mcu/outbox.hpp"

using wirebond::Queue;
using wirebond::Refusal;
using wirebond::Run;
using wirebond::SendAccount;

namespace {

constexpr std::size_t ring_bytes = 2048;
constexpr std::size_t max_run = 256;
enum Kind : std::uint8_t { normal, urgent, latest, kinds };

template <std::int16_t Index>
struct Newest {
  struct Info {
    static constexpr std::int16_t index = Index;
    static constexpr Queue queue = Queue::latest;
    static constexpr std::size_t max_frame_bytes = frames::most;
  };
};

struct Config : wirebond::OutboxConfig {
  static constexpr std::size_t ring_bytes = ::ring_bytes;
  static constexpr std::size_t ring_frames = 128;
  static constexpr std::size_t urgent_bytes = 256;
  static constexpr std::size_t urgent_frames = 8;
  using Latest = wirebond::MessageList<Newest<0>, Newest<1>>;
  static constexpr std::size_t latest_cells = 5;
};
using Outbox = wirebond::Outbox<Config>;

/// The consumer's book: what came, by sender and kind.
class Book {
 public:
  explicit Book(unsigned senders) : next_(senders) {}

  void run_came(const std::uint8_t* data, std::size_t size) {
    while (size != 0) {
      const frames::Frame frame = frames::read(data, size);
      if (frame.size == 0 || frame.sender >= next_.size() || frame.kind >= kinds) {
        ++wrong_;  // torn: where the next frame would begin is not known
        return;
      }
      std::uint32_t& next = next_[frame.sender][frame.kind];
      // Frames that were never accepted leave gaps in the numbers of kinds where the sender does not try again.
      if (frame.number < next || (frame.kind == normal && frame.number != next && !allows_gaps)) ++wrong_;
      next = frame.number + 1;
      ++came_;
      data += frame.size;
      size -= frame.size;
    }
  }

  std::uint64_t came() const { return came_; }
  std::uint64_t wrong() const { return wrong_; }
  bool allows_gaps = false;

 private:
  std::vector<std::array<std::uint32_t, kinds>> next_;
  std::uint64_t came_ = 0;
  std::uint64_t wrong_ = 0;
};

struct Result {
  std::uint64_t accepted = 0;
  std::uint64_t gone_otherwise = 0;  // accepted, and rightly not delivered
  std::uint64_t refused = 0;
  bool balances = true;
};

/// Threads run `send(sender)`; meanwhile `take(book)` runs until all have ended, and once more.
template <class Send, class Take>
double run_threads(unsigned senders, Book& book, Send&& send, Take&& take) {
  const auto begin = std::chrono::steady_clock::now();
  std::atomic<unsigned> running{senders};
  std::vector<std::thread> threads;
  for (unsigned i = 0; i < senders; ++i) {
    threads.emplace_back([&, i] {
      send(static_cast<std::uint8_t>(i));
      running.fetch_sub(1);
    });
  }
  bool last = false;
  while (!last) {
    last = running.load() == 0;
    while (take(book)) {
    }
    std::this_thread::yield();
  }
  for (std::thread& thread : threads) thread.join();
  return std::chrono::duration<double>(std::chrono::steady_clock::now() - begin).count();
}

double through_mutex(unsigned senders, std::uint32_t each, Book& book, Result& result) {
  static MutexRing<ring_bytes> ring;
  std::atomic<std::uint64_t> refused{0};
  const auto send = [&](std::uint8_t sender) {
    std::array<std::uint8_t, frames::most> frame;
    std::uint64_t full = 0;
    for (std::uint32_t number = 0; number < each; ++number) {
      const std::size_t size = frames::size_of(sender, number);
      frames::write(frame.data(), sender, normal, number, size);
      for (; !ring.push(frame.data(), size); ++full) std::this_thread::yield();
    }
    refused.fetch_add(full);
  };
  const auto take = [&](Book& to) {
    static std::array<std::uint8_t, max_run> run;
    const std::size_t size = ring.pop(run.data(), run.size());
    to.run_came(run.data(), size);
    return size != 0;
  };
  const double seconds = run_threads(senders, book, send, take);
  result.accepted = std::uint64_t{senders} * each;
  result.refused = refused.load();
  return seconds;
}

/// Send one frame of this kind; false: refused.
bool offer(Outbox& outbox, std::uint8_t sender, Kind kind, std::uint32_t number, std::size_t reserved) {
  auto grant = kind == latest ? outbox.reserve_latest(sender % 2, reserved)
                              : outbox.reserve(reserved, kind == urgent ? Queue::urgent : Queue::normal);
  if (!grant.ok()) return false;
  const std::size_t size = frames::size_of(sender, number);
  frames::write(grant.data(), sender, kind, number, size);
  grant.commit(size);
  return true;
}

void send_normal(Outbox& outbox, std::uint8_t sender, std::uint32_t each) {
  for (std::uint32_t number = 0; number < each; ++number) {
    const std::size_t size = frames::size_of(sender, number);
    while (!offer(outbox, sender, normal, number, size)) std::this_thread::yield();
  }
}

void send_mixed(Outbox& outbox, std::uint8_t sender, std::uint32_t each) {
  for (std::uint32_t number = 0; number < each; ++number) {
    const std::uint32_t draw = frames::mixed(number + 77u * sender) % 8;
    const std::size_t size = frames::size_of(sender, number);
    if (draw == 0) {
      auto dropped = outbox.reserve(size);
      if (dropped.ok()) std::memset(dropped.data(), 0xDD, dropped.size());
    } else {
      const Kind kind = draw == 1 ? urgent : draw == 2 ? latest : normal;
      const std::size_t reserved = draw == 3 ? frames::most : size;
      if (!offer(outbox, sender, kind, number, reserved)) std::this_thread::yield();
    }
  }
}

double through_outbox(unsigned senders, std::uint32_t each, bool is_mixed, Book& book, Result& result) {
  static std::array<std::uint8_t, Outbox::memory_bytes> memory;
  static Outbox outbox(memory.data());
  book.allows_gaps = is_mixed;
  std::uint32_t round = 0;
  const auto send = [&](std::uint8_t sender) {
    if (is_mixed) {
      send_mixed(outbox, sender, each);
    } else {
      send_normal(outbox, sender, each);
    }
  };
  const auto take = [&](Book& to) {
    ++round;
    if (is_mixed && round % 1024 == 0) outbox.expire_all();
    const Run run = outbox.next(max_run);
    if (run.size == 0) return false;
    if (is_mixed && round % 128 == 0) {
      outbox.aborted();
      return true;
    }
    to.run_came(run.data, run.size);
    outbox.sent();
    return true;
  };
  const double seconds = run_threads(senders, book, send, take);
  const SendAccount account = outbox.account();
  result.accepted = account.accepted;
  result.gone_otherwise = account.replaced + account.expired + account.aborted;
  result.refused = account.refused();
  result.balances = account.balances() && account.queued == 0 && account.unfinished == 0;
  return seconds;
}

}  // namespace

int main(int count, char** arguments) {
  if (count != 4) {
    std::fprintf(stderr, "usage: stress outbox|mixed|mutex SENDERS FRAMES\n");
    return 2;
  }
  const std::string_view kind = arguments[1];
  const unsigned senders = static_cast<unsigned>(std::atoi(arguments[2]));
  const std::uint32_t each = static_cast<std::uint32_t>(std::atoi(arguments[3])) / senders;
  Book book(senders);
  Result result;
  const double seconds = kind == "mutex" ? through_mutex(senders, each, book, result)
                                         : through_outbox(senders, each, kind == "mixed", book, result);
  const std::uint64_t due = result.accepted - result.gone_otherwise;
  const std::uint64_t missing = due > book.came() ? due - book.came() : book.came() - due;
  const std::uint64_t lost = missing + book.wrong();
  std::printf(
      "{\"accepted\": %llu, \"lost\": %llu, \"refused\": %llu, \"balances\": %s, \"seconds\": %.3f, "
      "\"processor_seconds\": %.3f}\n",
      static_cast<unsigned long long>(result.accepted), static_cast<unsigned long long>(lost),
      static_cast<unsigned long long>(result.refused), result.balances ? "true" : "false", seconds,
      static_cast<double>(std::clock()) / CLOCKS_PER_SEC);
  return lost == 0 && result.balances ? 0 : 1;
}
