// Both ends of a link and the wire between them in one process, under virtual time: what wirebond soak runs. It prints
// one line of JSON about twice a second, and the result as the last one.
#include <signal.h>

#include <algorithm>
#include <array>
#include <chrono>
#include <cinttypes>
#include <cstdio>
#include <string_view>
#include <utility>

#include "host.hpp"
#include "ledger.hpp"
#include "mcu.hpp"
#include "mix.hpp"
#include "wirebond/sim/options.hpp"
#include "wirebond/sim/wire.hpp"

namespace {

using soak::Ledger;
using soak::Time;
using wirebond::sim::Wire;
using wirebond::sim::WireSettings;

constexpr Time second = 1'000'000'000;

volatile sig_atomic_t interrupted = 0;

struct Options {
  Time length = 0;
  Time host_period = 1'000'000;  ///< of each topic
  Time mcu_period = 1'000'000;   ///< of each task
  WireSettings to_mcu;
  WireSettings to_host;
};

double seconds_since(std::chrono::steady_clock::time_point start) {
  return std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count();
}

/// Everything on one time line.
class Soak {
 public:
  explicit Soak(const Options& options)
      : options_(options), to_mcu_wire_(options.to_mcu), to_host_wire_(options.to_host) {
    for (std::size_t i = 0; i < topics_.size(); ++i) {
      topics_[i] = options.host_period * i / topics_.size();  // programs of a host do not begin together
    }
  }

  /// Until the length is over, or until somebody interrupts; then until the line is empty.
  void run() {
    const auto start = std::chrono::steady_clock::now();
    double shown = 0;
    std::uint64_t turn = 0;
    Time end = options_.length;
    while (now_ < end) {
      step(true, end);
      if (++turn % 65'536 != 0) continue;
      const double spent = seconds_since(start);
      if (interrupted != 0) end = now_;
      if (spent - shown < 0.4) continue;
      shown = spent;
      std::printf("{\"virtual_seconds\": %.3f, \"seconds\": %.3f}\n", static_cast<double>(now_) * 1e-9, spent);
      std::fflush(stdout);
    }
    ended_at_ = end;
    measure_line_use();
    const Time settled =
        end + host_wait_bound() + second;  // all that was accepted has left, and idle bytes are settled
    while (now_ < settled) step(false, settled);
    seconds_ = seconds_since(start);
    to_mcu_.end(to_mcu_wire_);
    to_host_.end(to_host_wire_);
  }

  void print() const {
    std::printf(
        "{\"result\": {\"virtual_seconds\": %.6f, \"seconds\": %.6f, \"speedup\": %.2f, \"unaccounted\": %" PRIu64
        ", \"host_cpu_seconds\": %.6f, ",
        static_cast<double>(ended_at_) * 1e-9, seconds_, static_cast<double>(ended_at_) * 1e-9 / seconds_,
        unaccounted(), host_.cpu_seconds());
    std::printf("\"mcu_work\": {\"polls\": %" PRIu64 ", \"runs\": %" PRIu64 ", \"receive_events\": %" PRIu64 "}, ",
                mcu_.polls(), mcu_.uart().runs(), mcu_.uart().events());
    const auto host = host_.link().outbox().account();
    const std::uint64_t no_room = host.refused_full;
    const std::uint64_t away = host.refused_down + host.refused_stopped;
    print_direction("to_mcu", to_mcu_, to_mcu_wire_, to_mcu_use_, no_room, away, host_wait_bound());
    std::printf(", \"discarded_bytes\": [");
    print_causes(mcu_.link().receiver().account());
    std::printf("], \"lapped_bytes\": %u, \"refused_by_rules\": %u}, ", mcu_.link().receive_account().lapped,
                refused_by_rules());
    const auto mcu = mcu_.link().send_account();
    const std::uint64_t full = mcu.refused(wirebond::Refusal::full) + mcu.refused(wirebond::Refusal::held);
    print_direction("to_host", to_host_, to_host_wire_, to_host_use_, full, mcu.refused() - full, mcu_wait_bound());
    std::printf(", \"discarded_bytes\": [");
    print_causes(host_.link().deframer().account());
    std::printf("], \"lapped_bytes\": 0, \"refused_by_rules\": 0}}}\n");
    std::fflush(stdout);
  }

 private:
  static constexpr int curve_points = 100;

  void step(bool offers, Time end) {
    Time next = std::min(host_.next(now_), mcu_.next());
    next = std::min(next, poll_at_);
    if (offers) {
      next = std::min(next, tasks_at_);
      for (const Time at : topics_) next = std::min(next, at);
    }
    now_ = std::max(now_, std::min(next, end));
    if (now_ >= end) return;
    mcu_.run(now_);
    if (poll_at_ <= now_) {
      mcu_.poll(now_);
      poll_at_ += soak::Mcu::poll_every;
    }
    if (offers && tasks_at_ <= now_) {
      for (const mix::Turn& task : mix::tasks) {
        for (unsigned i = 0; i < task.times; ++i) mcu_.offer(now_, task.message);
      }
      tasks_at_ += options_.mcu_period;
    }
    for (std::size_t i = 0; offers && i < topics_.size(); ++i) {
      if (topics_[i] > now_) continue;
      for (unsigned n = 0; n < mix::topics[i].times; ++n) host_.offer(now_, mix::topics[i].message);
      topics_[i] += options_.host_period;
    }
    if (host_due_ <= now_ || to_host_wire_.next_handover() <= now_) host_.wake(now_);
    host_due_ = host_.next(now_);
  }

  /// The share of the time in which the line carried bits.
  void measure_line_use() {
    const auto use = [this](const Wire& wire) {
      const Time ahead = wire.free_at() > ended_at_ ? wire.free_at() - ended_at_ : 0;
      return (static_cast<double>(wire.line_time(wire.counts().put)) - static_cast<double>(ahead)) /
             static_cast<double>(ended_at_ == 0 ? 1 : ended_at_);
    };
    to_mcu_use_ = use(to_mcu_wire_);
    to_host_use_ = use(to_host_wire_);
  }

  /// Queue bytes at the line's rate, one run and one gap. At the host a run is what may lie in the driver; there is no
  /// gap, but its clock counts whole microseconds.
  Time host_wait_bound() const {
    return to_mcu_wire_.line_time(soak::Host::queue_bytes) + wirebond::Pacing::most_us * 1000 + 1000;
  }
  Time mcu_wait_bound() const {
    return to_host_wire_.line_time(soak::Mcu::send_bytes + mix::longest_run_bytes) + options_.to_host.restart_gap;
  }

  /// Frames that passed their checks and broke a rule of a field or of a deadline: no handler got them.
  std::uint32_t refused_by_rules() const {
    const auto counters = mcu_.link().counters();
    return mcu_.link().receiver().violations().rejected + counters.late + counters.held_back;
  }

  static std::uint64_t difference(std::uint64_t a, std::uint64_t b) { return a > b ? a - b : b - a; }
  static std::uint64_t difference_32(std::uint64_t a, std::uint32_t b) {
    return difference(static_cast<std::uint32_t>(a), b);
  }

  /// How many frames and bytes the accounts of both ends and what was seen from outside differ by.
  std::uint64_t unaccounted() const {
    std::uint64_t sum = 0;
    for (const Ledger* ledger : {&to_mcu_, &to_host_}) {
      const soak::Fates& fates = ledger->fates;
      sum += difference(fates.accepted, fates.left + fates.expired + ledger->waiting());
      sum += difference(fates.left, fates.delivered + fates.lost_to_faults + fates.lost_intact + ledger->travelling());
      sum += difference(ledger->latency.total(), fates.delivered);
    }
    const auto host = host_.link().outbox().account();
    sum += difference(host.offered, to_mcu_.fates.offered) + difference(host.accepted, to_mcu_.fates.accepted);
    sum += difference(host.sent, to_mcu_.fates.left) + difference(host.queued, to_mcu_.waiting());
    sum += difference(host.expired, to_mcu_.fates.expired);
    sum += host.balances() ? 0 : 1;
    const auto mcu = mcu_.link().send_account();
    sum += difference_32(to_host_.fates.offered, mcu.offered) + difference_32(to_host_.fates.accepted, mcu.accepted);
    sum += difference_32(to_host_.fates.left, mcu.sent) + difference_32(to_host_.waiting(), mcu.queued);
    sum += difference_32(to_host_.fates.expired, mcu.expired);
    sum += mcu.balances() ? 0 : 1;
    sum += (host_.is_in_order() ? 0 : 1) + (mcu_.is_in_order() ? 0 : 1);

    const auto& at_host = host_.link().deframer();
    sum += difference(at_host.account().frames, to_host_.fates.delivered + to_host_.fates.false_frames);
    sum += difference(at_host.bytes(), at_host.account().settled() + at_host.pending());
    sum += difference(at_host.bytes(), to_host_wire_.counts().handed_over);
    const auto& at_mcu = mcu_.link().receiver();
    const auto ring = mcu_.link().receive_account();
    sum += difference_32(to_mcu_.fates.delivered + to_mcu_.fates.false_frames + refused_by_rules(),
                         at_mcu.account().frames);
    sum += difference_32(to_mcu_wire_.counts().handed_over, ring.received);
    sum += difference_32(ring.received,
                         ring.handed_out + ring.lapped + ring.dropped + static_cast<std::uint32_t>(mcu_.unread()));
    sum += difference_32(at_mcu.account().settled() + static_cast<std::uint32_t>(at_mcu.pending()), ring.handed_out);
    sum += (to_mcu_wire_.counts().closes() ? 0 : 1) + (to_host_wire_.counts().closes() ? 0 : 1);
    return sum;
  }

  /// By cause, in the order of the engine.
  template <class Account>
  static void print_causes(const Account& account) {
    for (std::size_t i = 0; i < wirebond::cause_count; ++i) {
      std::printf("%s%" PRIu64, i == 0 ? "" : ", ", static_cast<std::uint64_t>(account.discarded_bytes[i]));
    }
  }

  /// All but the closing brace.
  static void print_direction(const char* name, const Ledger& ledger, const Wire& wire, double use,
                              std::uint64_t no_room, std::uint64_t other, Time bound) {
    const soak::Fates& fates = ledger.fates;
    const wirebond::sim::WireCounts& counts = wire.counts();
    std::printf("\"%s\": {\"line_use\": %.6f, \"offered\": %" PRIu64 ", \"accepted\": %" PRIu64
                ", \"refused_queue_full\": %" PRIu64 ", \"refused_otherwise\": %" PRIu64 ", \"sent\": %" PRIu64
                ", \"queued\": %" PRIu64 ", \"expired\": %" PRIu64 ", \"delivered\": %" PRIu64
                ", \"lost_to_faults\": %" PRIu64 ", \"lost_intact\": %" PRIu64 ", \"false_frames\": %" PRIu64 ", ",
                name, use, fates.offered, fates.accepted, no_room, other, fates.left, ledger.waiting(), fates.expired,
                fates.delivered, fates.lost_to_faults, fates.lost_intact, fates.false_frames);
    std::printf("\"bytes\": %" PRIu64 ", \"bit_errors\": %" PRIu64 ", \"burst_bytes\": %" PRIu64
                ", \"dropped_bytes\": %" PRIu64 ", \"inserted_bytes\": %" PRIu64 ", \"splits\": %" PRIu64 ", ",
                counts.put, counts.bit_errors, counts.burst_bytes, counts.dropped, counts.inserted, counts.splits);
    std::printf("\"longest_wait_us\": %.3f, \"wait_bound_us\": %.3f, \"latency_us\": {",
                static_cast<double>(ledger.longest_wait) * 1e-3, static_cast<double>(bound) * 1e-3);
    for (const auto& [text, share] : {std::pair{"p50", 0.5}, {"p90", 0.9}, {"p99", 0.99}, {"p99.9", 0.999}}) {
      std::printf("\"%s\": %.3f, ", text, static_cast<double>(ledger.latency.percentile(share)) * 1e-3);
    }
    std::printf("\"max\": %.3f}, \"latency_curve\": [", static_cast<double>(ledger.latency.most()) * 1e-3);
    for (int i = 0; i <= curve_points; ++i) {
      const double share = static_cast<double>(i) / curve_points;
      std::printf("%s[%.4f, %.3f]", i == 0 ? "" : ", ", share,
                  static_cast<double>(ledger.latency.percentile(share)) * 1e-3);
    }
    std::printf("]");
  }

  Options options_;
  Wire to_mcu_wire_;
  Wire to_host_wire_;
  Ledger to_mcu_;
  Ledger to_host_;
  soak::Mcu mcu_{to_mcu_wire_, to_host_wire_, to_mcu_, to_host_};
  soak::Host host_{to_mcu_wire_, to_host_wire_, to_host_, to_mcu_};
  Time now_ = 0;
  Time poll_at_ = 0;
  Time tasks_at_ = 0;
  Time host_due_ = 0;
  std::array<Time, mix::topics.size()> topics_{};
  Time ended_at_ = 0;
  double to_mcu_use_ = 0;
  double to_host_use_ = 0;
  double seconds_ = 0;
};

bool obey(Options& options, const char* word) {
  std::string_view name;
  std::uint64_t value = 0;
  if (!wirebond::sim::split_option(word, name, value)) return false;
  if (name == "length_ns") return options.length = value, true;
  if (name == "host_period_ns") return options.host_period = value, true;
  if (name == "mcu_period_ns") return options.mcu_period = value, true;
  if (name == "restart_gap_ns") return options.to_host.restart_gap = value, true;
  if (name == "batch_ns") return options.to_host.batch = value, true;
  if (name == "jitter_ns") return options.to_host.jitter = value, true;
  return wirebond::sim::set_both(options.to_mcu, options.to_host, name, value);
}

}  // namespace

int main(int argument_count, char** arguments) {
  Options options;
  for (int i = 1; i < argument_count; ++i) {
    if (obey(options, arguments[i])) continue;
    std::fprintf(stderr, "unknown argument '%s'\n", arguments[i]);
    return 2;
  }
  if (!mix::prepare()) {
    std::fprintf(stderr, "a sample of a message cannot be decoded\n");
    return 2;
  }
  signal(SIGINT, [](int) { interrupted = 1; });
  Soak soak(options);
  soak.run();
  soak.print();
  return 0;
}
