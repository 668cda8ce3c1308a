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
#include <vector>

#include "accounts.hpp"
#include "host.hpp"
#include "ledger.hpp"
#include "mcu.hpp"
#include "mix.hpp"
#include "output.hpp"
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
  std::vector<Time> plugs;  ///< the adapter is pulled out, put in again, and so on
};

double seconds_since(std::chrono::steady_clock::time_point start) {
  return std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count();
}

/// Everything on one time line.
class Soak {
 public:
  explicit Soak(const Options& options)
      : options_(options), to_mcu_wire_(options.to_mcu), to_host_wire_(options.to_host) {
    to_mcu_wire_.follow();
    to_host_wire_.follow();
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
    soak::print_head(static_cast<double>(ended_at_) * 1e-9, seconds_, unaccounted(), host_.cpu_seconds());
    soak::print_work(mcu_.polls(), mcu_.uart().runs(), mcu_.uart().events());
    soak::print_to_mcu({to_mcu_, to_mcu_wire_.counts(), to_mcu_use_, host_wait_bound()}, host_.link(), mcu_.link());
    soak::print_to_host({to_host_, to_host_wire_.counts(), to_host_use_, mcu_wait_bound()}, host_.link(), mcu_.link());
  }

 private:
  void step(bool offers, Time end) {
    Time next = std::min({host_.next(now_), mcu_.next(), next_plug()});
    next = std::min(next, poll_at_);
    if (offers) {
      next = std::min(next, tasks_at_);
      for (const Time at : topics_) next = std::min(next, at);
    }
    now_ = std::max(now_, std::min(next, end));
    if (now_ >= end) return;
    if (next_plug() <= now_) {
      host_.is_plugged() ? host_.unplug(now_) : host_.plug(now_);
      ++plugs_done_;
    }
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

  Time next_plug() const {
    return plugs_done_ < options_.plugs.size() ? options_.plugs[plugs_done_] : wirebond::sim::never;
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
  /// gap, but its clock counts whole microseconds. Where `urgent` or `latest` frames overtake others there is none.
  Time host_wait_bound() const {
    return to_mcu_wire_.line_time(soak::HostCore::queue_bytes) + wirebond::Pacing::most_us * 1000 + 1000;
  }
  Time mcu_wait_bound() const {
    if (mix::overtakes) return wirebond::sim::never;
    return to_host_wire_.line_time(soak::Mcu::send_bytes + mix::longest_run_bytes) + options_.to_host.restart_gap;
  }

  std::uint64_t unaccounted() const {
    return soak::unaccounted(to_mcu_, to_host_, host_.link(), mcu_.link(), to_mcu_wire_.counts(),
                             to_host_wire_.counts()) +
           (host_.is_in_order() ? 0 : 1) + (mcu_.is_in_order() ? 0 : 1);
  }

  Options options_;
  Wire to_mcu_wire_;
  Wire to_host_wire_;
  Ledger to_mcu_{mix::protocol::AtHost::max_sent_bytes};
  Ledger to_host_{mix::protocol::AtMcu::max_sent_bytes};
  soak::Mcu mcu_{to_mcu_wire_, to_host_wire_, to_mcu_, to_host_};
  soak::Host host_{to_mcu_wire_, to_host_wire_, to_host_, to_mcu_};
  Time now_ = 0;
  Time poll_at_ = 0;
  Time tasks_at_ = 0;
  Time host_due_ = 0;
  std::size_t plugs_done_ = 0;
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
  if (name == "plug_ns") return options.plugs.push_back(value), true;
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
