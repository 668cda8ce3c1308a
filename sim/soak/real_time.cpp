// A soak in real time: the host's end on one pty, the MCU's on another one, a paced wire between them; a thread each.
// What wirebond soak runs without --virtual. It prints what main.cpp prints. One file, as it is one program.
#include <poll.h>
#include <signal.h>
#include <sys/prctl.h>
#include <time.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <atomic>
#include <cerrno>
#include <cstdint>
#include <cstdio>
#include <memory>
#include <mutex>
#include <string_view>
#include <thread>

#include "accounts.hpp"
#include "buffers.hpp"
#include "host_core.hpp"
#include "ledger.hpp"
#include "mix.hpp"
#include "output.hpp"
#include "received_place.hpp"
#include "run_reader.hpp"
#include "wirebond/posix/port.hpp"
#include "wirebond/posix/serial.hpp"
#include "wirebond/sim/options.hpp"
#include "wirebond/sim/pty_wire.hpp"

namespace {

using soak::Ledger;
using soak::Time;
using wirebond::sim::monotonic_ns;
using wirebond::sim::PtyWire;
using wirebond::sim::WireSettings;

std::atomic<bool> interrupted{false};

struct Options {
  Time length = 0;
  Time host_period = 1'000'000;  ///< of each topic
  Time mcu_period = 1'000'000;   ///< of each task
  WireSettings to_mcu;
  WireSettings to_host;
};

/// One direction of the wire, as a ledger asks it.
struct Line {
  PtyWire& wire;
  PtyWire::End from;

  Time line_time(std::uint64_t) const { return 0; }  // nobody knows when a byte leaves a pty
  bool was_touched(std::uint64_t begin, std::uint64_t end) { return wire.was_touched(from, begin, end); }
  std::uint64_t origin_of(std::uint64_t handed_over) { return wire.origin_of(from, handed_over); }
};

/// What the threads share. Whoever sends, or takes what came, holds `mutex`.
struct Common {
  explicit Common(PtyWire& wire) : to_mcu_line{wire, PtyWire::a}, to_host_line{wire, PtyWire::b} {}

  std::mutex mutex;
  Ledger to_mcu{mix::protocol::AtHost::max_sent_bytes};
  Ledger to_host{mix::protocol::AtMcu::max_sent_bytes};
  Line to_mcu_line;
  Line to_host_line;
  std::atomic<bool> offers{true};
  std::atomic<bool> ends{false};
  std::atomic<std::uint64_t> begun_at_mcu{0};  ///< bytes of the frames that the end has begun to write
  std::atomic<std::uint64_t> begun_at_host{0};
  std::atomic<std::uint64_t> settled_at_mcu{0};  ///< bytes of which the end has made frames, or that it has given up
  std::atomic<std::uint64_t> settled_at_host{0};

  /// Do bytes of this direction lie between its two ends, of which the later one has `received` so many, modulo 2^32?
  /// Then the reader's silence is this machine's lateness, and not the line's.
  bool is_owed(PtyWire::End from, std::uint64_t received) {
    const std::uint64_t begun = (from == PtyWire::a ? begun_at_host : begun_at_mcu).load(std::memory_order_relaxed);
    const auto counts = to_mcu_line.wire.account(from).counts;
    return counts.put < begun || counts.travelling != 0 ||
           static_cast<std::uint32_t>(counts.handed_over) != static_cast<std::uint32_t>(received);
  }

  /// Everything that was accepted has left, come out of the line, and is settled at the other end.
  bool is_over() {
    {
      const std::lock_guard<std::mutex> lock(mutex);
      if (to_mcu.waiting() + to_host.waiting() != 0) return false;
    }
    return !is_owed(PtyWire::a, settled_at_mcu.load(std::memory_order_relaxed)) &&
           !is_owed(PtyWire::b, settled_at_host.load(std::memory_order_relaxed));
  }
};

void sleep_until(Time when) {
  const timespec at = {static_cast<time_t>(when / 1'000'000'000), static_cast<long>(when % 1'000'000'000)};
  while (::clock_nanosleep(CLOCK_MONOTONIC, TIMER_ABSTIME, &at, nullptr) == EINTR) {
  }
}

Time thread_cpu_ns() {
  timespec now{};
  ::clock_gettime(CLOCK_THREAD_CPUTIME_ID, &now);
  return static_cast<Time>(now.tv_sec) * 1'000'000'000 + static_cast<Time>(now.tv_nsec);
}

/// A pty's port that notes what leaves.
class Port : public wirebond::posix::Port {
 public:
  Port(int fd, Common& common) : wirebond::posix::Port(fd), common_(common) {}

  bool start_transmit(const std::uint8_t* bytes, std::size_t size) {
    {
      const std::lock_guard<std::mutex> lock(common_.mutex);
      if constexpr (mix::reads_runs) {
        is_in_order_ =
            reader_.read(bytes, size, bytes_, monotonic_ns(), common_.to_host, common_.to_host_line) && is_in_order_;
      } else {
        is_in_order_ = common_.to_host.leave(bytes_, size, monotonic_ns(), common_.to_host_line) && is_in_order_;
      }
      bytes_ += size;
      common_.begun_at_mcu.store(bytes_, std::memory_order_relaxed);
      runs_ += 1;
    }
    return wirebond::posix::Port::start_transmit(bytes, size);
  }

  bool is_in_order() const { return is_in_order_; }
  std::uint64_t runs() const { return runs_; }

 private:
  Common& common_;
  soak::RunReader reader_;
  std::uint64_t bytes_ = 0;
  std::uint64_t runs_ = 0;
  bool is_in_order_ = true;
};

/// The generated link. Its receive ring holds what comes while this machine gives its threads no turn.
class Mcu {
 public:
  Mcu(int fd, Common& common) : common_(common), port_(fd, common), handler_(common), link_(handler_, port_, buffers_) {
    handler_.place.look = settled_.look = [this] { return soak::place_of(link_); };
  }

  bool start() { return port_.start(link_); }
  void stop() { port_.stop(); }

  void run(Time period) {
    ::prctl(PR_SET_TIMERSLACK, 1UL);
    Time tasks_at = monotonic_ns();
    Time poll_at = tasks_at;
    while (!common_.ends.load(std::memory_order_relaxed)) {
      const bool offers = common_.offers.load(std::memory_order_relaxed);
      sleep_until(offers ? std::min(tasks_at, poll_at) : poll_at);
      const Time now = monotonic_ns();
      for (; offers && tasks_at <= now; tasks_at += period) {
        for (const mix::Turn& task : mix::tasks) {
          for (unsigned i = 0; i < task.times; ++i) offer(task.message);
        }
      }
      if (poll_at > now) continue;
      poll();
      common_.settled_at_mcu.store(settled_(), std::memory_order_relaxed);
      poll_at = std::max(poll_at + poll_every, now);
    }
  }

  const auto& link() const { return link_; }
  const Port& port() const { return port_; }
  std::uint64_t polls() const { return polls_; }

 private:
  static constexpr Time poll_every = 1'000'000;
  static constexpr std::size_t receive_bytes = std::size_t{1} << 22;  ///< twenty seconds of the fastest line

  /// Its base has a function for each action of the file's deadlines.
  struct Handler : mix::Actions {
    explicit Handler(Common& shared) : common(shared) {}
    Common& common;
    soak::ReceivedPlace place;

    template <class Message>
    void on(const Message& message) {
      std::uint8_t payload[Message::Info::max_payload_bytes + 1];
      const std::size_t size = payload_bytes(message);
      const bool is_written = write_payload(message, payload);
      const std::lock_guard<std::mutex> lock(common.mutex);
      common.to_mcu.deliver(mix::host_message(Message::Info::index), payload, is_written ? size : 0, place(),
                            monotonic_ns(), mix::from_host, common.to_mcu_line);
    }
    void unknown(const wirebond::Frame&) {
      const std::lock_guard<std::mutex> lock(common.mutex);
      common.to_mcu.deliver_false();
    }
  };

  void offer(std::uint16_t message) {
    std::uint16_t& sample = next_sample_[message];
    const std::lock_guard<std::mutex> lock(common_.mutex);
    common_.to_host.fates.offered += 1;
    if (mix::send(link_, message, sample) == wirebond::Status::ok) {
      if (mix::is_latest[message]) common_.to_host.replace(message);
      common_.to_host.accept(monotonic_ns(), message, sample, mix::from_mcu(message, sample).size);
    }
    sample = static_cast<std::uint16_t>((sample + 1) % mix::samples);
  }

  /// The link's clock stands while the line does: a pty waits for its reader, and the link would break off the run; and
  /// bytes that are on their way would be taken for silence within a frame.
  void poll() {
    const auto account = link_.send_account();
    const std::uint32_t received = link_.receive_account().received;
    const bool is_heard = received != received_ || !common_.is_owed(PtyWire::a, received);
    if ((account.queued == 0 || account.sent != sent_) && is_heard) now_us_ += 1000;
    received_ = received;
    sent_ = account.sent;
    link_.poll(now_us_);
    polls_ += 1;
  }

  Common& common_;
  Port port_;
  Handler handler_;
  mix::protocol::McuBuffers<receive_bytes, soak::buffer_for(mix::protocol::AtMcu::max_sent_bytes)> buffers_{};
  mix::protocol::McuLink<Handler, Port, decltype(buffers_)> link_;
  soak::ReceivedPlace settled_;
  std::array<std::uint16_t, mix::mcu_messages> next_sample_{};
  std::uint32_t now_us_ = 0;
  std::uint32_t sent_ = 0;
  std::uint32_t received_ = 0;
  std::uint64_t polls_ = 0;
};

/// The link's core under a loop as the engine's thread runs it.
class Host {
 public:
  Host(int fd, Common& common, const WireSettings& line)
      : fd_(fd), common_(common), core_(wirebond::Pacing(line.baud, line.bits_per_byte), 16'000, now_us()) {
    link_.port_up(now_us());
  }

  void run(Time period) {
    ::prctl(PR_SET_TIMERSLACK, 1UL);
    const Time cpu_before = thread_cpu_ns();
    std::array<Time, mix::topics.size()> topics{};
    for (std::size_t i = 0; i < topics.size(); ++i) topics[i] = monotonic_ns() + period * i / topics.size();
    while (!common_.ends.load(std::memory_order_relaxed)) {
      const bool offers = common_.offers.load(std::memory_order_relaxed);
      Time until = monotonic_ns() + 10'000'000;
      for (const Time at : topics) until = offers ? std::min(until, at) : until;
      wait(until);
      read();
      const Time now = monotonic_ns();
      for (std::size_t i = 0; offers && i < topics.size(); ++i) {
        for (; topics[i] <= now; topics[i] += period) {
          for (unsigned n = 0; n < mix::topics[i].times; ++n) offer(mix::topics[i].message);
        }
      }
      link_.poll(now_us());
      write();
      common_.settled_at_host.store(link_.deframer().account().settled(), std::memory_order_relaxed);
    }
    cpu_seconds_ = static_cast<double>(thread_cpu_ns() - cpu_before) * 1e-9;
  }

  const wirebond::HostLink& link() const { return link_; }
  bool is_in_order() const { return is_in_order_; }
  double cpu_seconds() const { return cpu_seconds_; }

 private:
  static std::uint64_t now_us() { return monotonic_ns() / 1000; }

  void wait(Time until) {
    const Time now = monotonic_ns();
    const std::uint64_t due_us = link_.next_due(now / 1000);
    if (due_us != wirebond::HostOutbox::never) until = std::min(until, due_us * 1000);
    const Time wait = until > now ? until - now : 0;
    const timespec timeout = {static_cast<time_t>(wait / 1'000'000'000), static_cast<long>(wait % 1'000'000'000)};
    pollfd waiting = {fd_, static_cast<short>(POLLIN | (link_.is_blocked() ? POLLOUT : 0)), 0};
    ::ppoll(&waiting, 1, &timeout, nullptr);
  }

  void read() {
    const auto take = [&](const wirebond::Frame& frame, wirebond::MayAct, bool) {
      if (frame.message < 0) {
        common_.to_host.deliver_false();
        return;
      }
      common_.to_host.deliver(mix::mcu_message(frame.message), frame.payload, frame.payload_size,
                              frame.offset + frame.wire_size, monotonic_ns(), mix::from_mcu, common_.to_host_line);
    };
    const bool is_silent = !common_.is_owed(PtyWire::b, link_.deframer().bytes());
    const std::uint64_t before_us = now_us();
    const ssize_t size = ::read(fd_, bytes_.data(), bytes_.size());
    const std::lock_guard<std::mutex> lock(common_.mutex);
    if (size > 0) {
      const bool is_all = static_cast<std::size_t>(size) < bytes_.size();
      link_.received(bytes_.data(), static_cast<std::size_t>(size), before_us, now_us(), is_all, take);
    } else if (is_silent) {
      link_.idle(before_us, take);
    }
  }

  void offer(std::uint16_t message) {
    std::uint16_t& sample = next_sample_[message];
    const soak::Sample& sent = mix::from_host(message, sample);
    const std::lock_guard<std::mutex> lock(common_.mutex);
    common_.to_mcu.fates.offered += 1;
    const wirebond::SendResult result =
        link_.outbox().send(mix::host_index(message), sent.frame, sent.size, -1, mix::host_numbers, now_us());
    expire();
    if (result == wirebond::SendResult::accepted) common_.to_mcu.accept(monotonic_ns(), message, sample, sent.size);
    sample = static_cast<std::uint16_t>((sample + 1) % mix::samples);
  }

  void write() {
    for (;;) {
      const wirebond::Outgoing out = link_.to_write(now_us());
      if (out.size == 0) return;
      // With the lock: else the MCU might have the frame before it is noted that it left.
      const std::lock_guard<std::mutex> lock(common_.mutex);
      const ssize_t written = ::write(fd_, out.bytes, out.size);
      if (written < 0 && errno == EINTR) continue;
      const std::size_t size = written > 0 ? static_cast<std::size_t>(written) : 0;
      if (size != 0 && left_of_frame_ == 0) {
        expire();
        is_in_order_ =
            (mix::host_numbers ? common_.to_mcu.leave_next(bytes_written_, out.size, monotonic_ns())
                               : common_.to_mcu.leave(bytes_written_, out.size, monotonic_ns(), common_.to_mcu_line)) &&
            is_in_order_;
        bytes_written_ += out.size;
        common_.begun_at_host.store(bytes_written_, std::memory_order_relaxed);
        left_of_frame_ = out.size;
      }
      left_of_frame_ -= size;
      link_.written(size, now_us());
      if (size == 0) return;
    }
  }

  void expire() {
    const std::uint64_t expired = link_.outbox().account().expired;
    common_.to_mcu.expire(expired - expired_);
    expired_ = expired;
  }

  int fd_;
  Common& common_;
  soak::HostCore core_;
  wirebond::HostLink& link_ = core_.link();
  std::array<std::uint8_t, 16'384> bytes_{};
  std::array<std::uint16_t, mix::host_messages> next_sample_{};
  std::uint64_t expired_ = 0;
  std::uint64_t bytes_written_ = 0;  ///< of frames that were begun, their rest included
  std::size_t left_of_frame_ = 0;
  bool is_in_order_ = true;
  double cpu_seconds_ = 0;
};

bool obey(Options& options, const char* word) {
  std::string_view name;
  std::uint64_t value = 0;
  if (!wirebond::sim::split_option(word, name, value)) return false;
  if (name == "length_ns") return options.length = value, true;
  if (name == "host_period_ns") return options.host_period = value, true;
  if (name == "mcu_period_ns") return options.mcu_period = value, true;
  return wirebond::sim::set_both(options.to_mcu, options.to_host, name, value);
}

/// Until the length is over, or somebody interrupts; then until what was accepted has come, or nothing comes any more.
void wait_for_end(const Options& options, Common& common, PtyWire& wire, double (&use)[2], double& seconds) {
  const Time start = monotonic_ns();
  Time shown = start;
  while (!interrupted.load(std::memory_order_relaxed) && monotonic_ns() - start < options.length) {
    sleep_until(std::min(monotonic_ns() + 20'000'000, start + options.length));
    if (monotonic_ns() - shown < 400'000'000) continue;
    shown = monotonic_ns();
    const double spent = static_cast<double>(shown - start) * 1e-9;
    std::printf("{\"virtual_seconds\": %.3f, \"seconds\": %.3f}\n", spent, spent);
    std::fflush(stdout);
  }
  seconds = static_cast<double>(monotonic_ns() - start) * 1e-9;
  for (const PtyWire::End from : {PtyWire::a, PtyWire::b}) use[from] = wire.line_use(from);
  common.offers.store(false, std::memory_order_relaxed);
  constexpr Time patience = 30'000'000'000;  // then something hangs, and the account says what is missing
  Time quiet_since = monotonic_ns();
  std::uint64_t settled = 0;
  while (!common.is_over() && monotonic_ns() - quiet_since < patience) {
    sleep_until(monotonic_ns() + 1'000'000);
    const std::uint64_t at_mcu = common.settled_at_mcu.load(std::memory_order_relaxed);
    const std::uint64_t now = at_mcu + common.settled_at_host.load(std::memory_order_relaxed);
    if (now != settled) quiet_since = monotonic_ns();
    settled = now;
  }
}

int soak_in_real_time(const Options& options) {
  PtyWire wire(options.to_mcu, options.to_host);
  wire.follow();
  wire.wait_for_readers();  // else this machine's lateness would be the line's
  wirebond::posix::SerialError error;
  if (!wire.open()) return std::fprintf(stderr, "the system has no pty left\n"), 3;
  wirebond::posix::Descriptor host_tty = wirebond::posix::open_serial(wire.path(PtyWire::a), {}, error);
  wirebond::posix::Descriptor mcu_tty = wirebond::posix::open_serial(wire.path(PtyWire::b), {}, error);
  if (!host_tty.is_open() || !mcu_tty.is_open()) return std::fprintf(stderr, "a pty cannot be opened\n"), 3;
  Common common(wire);
  const auto mcu = std::make_unique<Mcu>(mcu_tty.get(), common);  // its ring is too large for a stack
  Host host(host_tty.get(), common, options.to_mcu);
  if (!mcu->start()) return std::fprintf(stderr, "the system has no descriptor left\n"), 3;
  std::atomic<bool> wire_ends{false};
  std::thread wire_thread([&] { wire.run(wire_ends, wirebond::sim::never); });
  std::thread mcu_thread([&] { mcu->run(options.mcu_period); });
  std::thread host_thread([&] { host.run(options.host_period); });
  double use[2] = {};
  double seconds = 0;
  wait_for_end(options, common, wire, use, seconds);
  common.ends.store(true, std::memory_order_relaxed);
  host_thread.join();
  mcu_thread.join();
  mcu->stop();
  wire_ends.store(true, std::memory_order_relaxed);
  wire_thread.join();
  common.to_mcu.end(common.to_mcu_line);
  common.to_host.end(common.to_host_line);

  const wirebond::sim::WireCounts& to_mcu = wire.wire(PtyWire::a).counts();
  const wirebond::sim::WireCounts& to_host = wire.wire(PtyWire::b).counts();
  const std::uint64_t unaccounted =
      soak::unaccounted(common.to_mcu, common.to_host, host.link(), mcu->link(), to_mcu, to_host) +
      (host.is_in_order() ? 0 : 1) + (mcu->port().is_in_order() ? 0 : 1);
  soak::print_head(seconds, seconds, unaccounted, host.cpu_seconds());
  soak::print_work(mcu->polls(), mcu->port().runs(), 0);
  soak::print_to_mcu({common.to_mcu, to_mcu, use[PtyWire::a], wirebond::sim::never}, host.link(), mcu->link());
  soak::print_to_host({common.to_host, to_host, use[PtyWire::b], wirebond::sim::never}, host.link(), mcu->link());
  return 0;
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
  signal(SIGINT, [](int) { interrupted.store(true, std::memory_order_relaxed); });
  return soak_in_real_time(options);
}
