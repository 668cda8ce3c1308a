// Two ptys joined by a simulated wire in real time. The only header here that opens, waits or reads a clock.
#pragma once

#include <poll.h>
#include <sys/prctl.h>
#include <time.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <atomic>
#include <cerrno>
#include <cstddef>
#include <cstdint>
#include <mutex>
#include <optional>
#include <vector>

#include "wirebond/posix/pty.hpp"
#include "wirebond/sim/uart.hpp"
#include "wirebond/sim/wire.hpp"

namespace wirebond::sim {

inline Time monotonic_ns() {
  timespec now{};
  ::clock_gettime(CLOCK_MONOTONIC, &now);
  return static_cast<Time>(now.tv_sec) * 1'000'000'000 + static_cast<Time>(now.tv_nsec);
}

/// Bytes of one direction. `is_misheard`: the end that receives it has other settings than the one that sends.
/// `overrun`: bytes that came out, and that the reader had no room for. `handed_over`: those that it had room for.
struct PtyWireAccount {
  WireCounts counts;
  double line_use = 0;
  bool is_misheard = false;
  std::uint64_t handed_over = 0;
  std::uint64_t overrun = 0;
};

/// Bytes that a program writes into one pty come out of the other at the line's pace. A pty's buffer of 4 KB plays the
/// driver's: a program that writes faster than the line waits for it. Nothing makes the sender wait for a reader: bytes
/// that do not fit into the reader's buffer are lost and counted, as on a UART.
///
/// A simulation of both ends on one machine may not want to lose bytes by its own lateness: see `wait_for_readers`.
///
/// Bytes come out at most some 100 us late, as long as the machine schedules the thread.
class PtyWire {
 public:
  /// The two ends; a direction is named by the end where it begins.
  enum End : std::size_t { a, b };

  PtyWire(const WireSettings& a_to_b, const WireSettings& b_to_a)
      : wires_{Wire(a_to_b), Wire(b_to_a)}, start_(monotonic_ns()) {}

  /// Open the ptys. Returns false (errno set) if the system has no pty left.
  bool open() { return posix::open_pty(ptys_[a]) && posix::open_pty(ptys_[b]); }
  const char* path(End end) const { return ptys_[end].path.c_str(); }

  /// Before `run`: let bytes that do not fit into the reader's buffer wait, as in the buffers of a large computer.
  void wait_for_readers() { waits_ = true; }

  /// Before `run`: join both directions to one line, as on two wires of RS-485. Bytes that an end sends come out at
  /// that end, too, and if both send at the same time the bytes of both change. An echo that does not fit into its
  /// sender's buffer is lost.
  void join_directions() { is_joined_ = true; }

  /// Before `run`: give the two ends different settings, with which they receive each other.
  void set_shapes(const UartShape& of_a, const UartShape& of_b) {
    if (!of_b.understands(of_a)) receivers_[a].emplace(of_a, of_b);
    if (!of_a.understands(of_b)) receivers_[b].emplace(of_b, of_a);
  }

  /// Before `run`, any number of times: pull the cable between the ptys at this time after the start, for so long.
  void script_unplug(Time at, Time length) { unplugs_.push_back({at, at + length}); }

  /// Before `run`, any number of times: script a fault of the first byte put onto the line after this time, or of this
  /// many. Up to 5 ms of line time, or one write of a program, may have been put before.
  void script_fault(Time at, End from, ScriptedFault::Kind kind, std::uint8_t value, std::uint64_t count) {
    scripted_.push_back({at, from, kind, value, count});
  }

  /// Carry bytes until `ends` is true, or `length` is over. Returns 0, or an errno: a pty has failed.
  int run(const std::atomic<bool>& ends, Time length) {
    ::prctl(PR_SET_TIMERSLACK, 1UL);  // else each wait takes 50 us more
    {
      const std::lock_guard<std::mutex> lock(mutex_);
      start_ = monotonic_ns();
    }
    while (!ends.load(std::memory_order_relaxed)) {
      const Time now = elapsed();
      if (now >= length) break;
      pollfd waiting[2];
      Time next = now + longest_wait;
      if (const int error = carry(now, waiting, next); error != 0) return error;
      next = std::min(next, length);
      const Time before_wait = elapsed();
      const Time wait = next > before_wait ? next - before_wait : 0;
      const timespec timeout = {static_cast<time_t>(wait / 1'000'000'000), static_cast<long>(wait % 1'000'000'000)};
      if (::ppoll(waiting, 2, &timeout, nullptr) < 0 && errno != EINTR) return errno;
    }
    const std::lock_guard<std::mutex> lock(mutex_);
    ended_ = elapsed();
    return 0;
  }

  // ---- any thread, even while it runs

  /// See Wire::was_touched.
  bool was_touched(End from, std::uint64_t begin, std::uint64_t end) {
    const std::lock_guard<std::mutex> lock(mutex_);
    return wires_[from].was_touched(begin, end);
  }
  /// See Wire::follow; before `run`.
  void follow() {
    for (Wire& wire : wires_) wire.follow();
  }
  /// See Wire::origin_of.
  std::uint64_t origin_of(End from, std::uint64_t handed_over) {
    const std::lock_guard<std::mutex> lock(mutex_);
    return wires_[from].origin_of(handed_over);
  }
  /// Return a consistent account of one direction, as of now, or of the end of `run`.
  PtyWireAccount account(End from) {
    const std::lock_guard<std::mutex> lock(mutex_);
    const WireCounts& counts = wires_[from].counts();
    const bool is_misheard = receivers_[from].has_value();
    const std::uint64_t came_out = is_misheard ? heard_[from] : counts.handed_over;
    return {counts, line_use_of(from), is_misheard, came_out - overrun_[from], overrun_[from]};
  }
  /// Return the time since the start of `run`, or its length after its end.
  Time length() {
    const std::lock_guard<std::mutex> lock(mutex_);
    return ended_ != 0 ? ended_ : elapsed();
  }
  /// Return the share of time in which this direction carried bits, from its first byte until now, or until the end.
  double line_use(End from) {
    const std::lock_guard<std::mutex> lock(mutex_);
    return line_use_of(from);
  }

  // ---- after `run`

  const Wire& wire(End from) const { return wires_[from]; }

 private:
  static constexpr Time most_ahead = 5'000'000;     ///< line time of bytes that are taken off a pty early
  static constexpr Time step = 100'000;             ///< between two checks of what comes out
  static constexpr Time longest_wait = 50'000'000;  ///< so that `ends` is seen

  Time elapsed() const { return monotonic_ns() - start_; }

  double line_use_of(End from) const {
    const Wire& wire = wires_[from];
    const Time now = ended_ != 0 ? ended_ : elapsed();
    if (wire.counts().put == 0 || now <= first_[from]) return 0;
    const Time ahead = wire.free_at() > now ? wire.free_at() - now : 0;
    const Time busy = wire.line_time(wire.counts().put);
    return static_cast<double>(busy > ahead ? busy - ahead : 0) / static_cast<double>(now - first_[from]);
  }

  /// Do all that is due now; set what to wait for, and until when.
  int carry(Time now, pollfd (&waiting)[2], Time& next) {
    const std::lock_guard<std::mutex> lock(mutex_);
    move_cable(now);
    script_due(now, next);
    for (const Unplug& unplug : unplugs_) {
      for (const Time at : {unplug.from, unplug.to}) next = at > now ? std::min(next, at) : next;
    }
    for (const End from : {a, b}) {
      if (const int error = take(from, now); error != 0) return error;
      if (const int error = hand_over(from, now); error != 0) return error;
      const Wire& wire = wires_[from];
      const bool has_room = wire.free_at() < now + most_ahead;
      waiting[from] = {has_room ? ptys_[from].controller.get() : -1, POLLIN, 0};
      if (!has_room) next = std::min(next, wire.free_at() - most_ahead / 2);
      // The last byte on the line comes out when it is due: it may be the end of a frame.
      if (wire.next_handover() != never) next = std::min(next, std::max(wire.next_handover(), now + step));
      if (wire.settings().batch == 0 && wire.free_at() > now) next = std::min(next, wire.free_at());
      if (!kept_[from].empty()) next = std::min(next, now + step);
    }
    return 0;
  }

  void move_cable(Time now) {
    bool is_out = false;
    for (const Unplug& unplug : unplugs_) is_out = is_out || (now >= unplug.from && now < unplug.to);
    for (Wire& wire : wires_) {
      if (is_out && wire.is_plugged()) wire.unplug(now);
      if (!is_out && !wire.is_plugged()) wire.plug();
    }
  }

  /// Pass due faults to the wires, and forget them.
  void script_due(Time now, Time& next) {
    for (std::size_t i = 0; i < scripted_.size();) {
      const Scripted& fault = scripted_[i];
      if (fault.at > now) {
        next = std::min(next, fault.at);
        ++i;
        continue;
      }
      Wire& wire = wires_[fault.from];
      const std::uint64_t first = wire.counts().put;
      for (std::uint64_t byte = 0; byte < fault.count; ++byte) wire.script({first + byte, fault.kind, fault.value});
      scripted_.erase(scripted_.begin() + static_cast<std::ptrdiff_t>(i));
    }
  }

  int take(End from, Time now) {
    Wire& wire = wires_[from];
    std::array<std::uint8_t, 1024> bytes;
    while (wire.free_at() < now + most_ahead) {
      const ssize_t size = ::read(ptys_[from].controller.get(), bytes.data(), bytes.size());
      if (size < 0 && errno != EAGAIN && errno != EINTR) return errno;
      if (size <= 0) return 0;
      // Read the clock again: the bytes may have been written after `now`. With an earlier time they would come out
      // faster than the line carries them, and an answer would collide with the end of its request.
      const Time came = elapsed();
      if (wire.counts().put == 0) first_[from] = came;
      const Time begin = std::max(came, wire.free_at());
      wire.put(bytes.data(), static_cast<std::size_t>(size), came);
      Wire& other = wires_[from == a ? b : a];
      if (is_joined_ && other.free_at() > begin) {
        const Time both_until = std::min(wire.free_at(), other.free_at());
        wire.collide(begin, both_until);
        other.collide(begin, both_until);
      }
    }
    return 0;
  }

  int hand_over(End from, Time now) {
    std::vector<std::uint8_t>& kept = kept_[from];
    const auto keep = [&](std::uint8_t byte) {
      kept.push_back(byte);
      ++heard_[from];
    };
    std::optional<UartReceiver>& receiver = receivers_[from];
    const std::size_t came = wires_[from].read(now, [&](const std::uint8_t* bytes, std::size_t size) {
      if (is_joined_) static_cast<void>(!::write(ptys_[from].controller.get(), bytes, size));
      if (receiver) {
        receiver->take(bytes, size, keep);
      } else {
        kept.insert(kept.end(), bytes, bytes + size);
      }
    });
    if (receiver && came != 0 && wires_[from].next_handover() == never) receiver->rest(keep);
    std::size_t done = 0;
    while (done != kept.size()) {
      const int to = ptys_[from == a ? b : a].controller.get();
      const ssize_t written = ::write(to, kept.data() + done, kept.size() - done);
      if (written < 0 && errno == EINTR) continue;
      if (written < 0 && errno != EAGAIN) return errno;
      if (written <= 0) break;
      done += static_cast<std::size_t>(written);
    }
    kept.erase(kept.begin(), kept.begin() + static_cast<std::ptrdiff_t>(done));
    if (!waits_) {
      overrun_[from] += kept.size();
      kept.clear();
    }
    return 0;
  }

  std::array<Wire, 2> wires_;
  std::array<posix::Pty, 2> ptys_;
  Time start_;
  Time ended_ = 0;
  bool waits_ = false;
  bool is_joined_ = false;
  std::mutex mutex_;                               ///< guards the wires while it runs
  std::array<std::vector<std::uint8_t>, 2> kept_;  ///< came out, but is not read
  struct Unplug {
    Time from;
    Time to;
  };
  struct Scripted {
    Time at;
    End from;
    ScriptedFault::Kind kind;
    std::uint8_t value;
    std::uint64_t count;
  };
  std::vector<Unplug> unplugs_;
  std::vector<Scripted> scripted_;  ///< not passed yet
  std::array<Time, 2> first_{};
  std::array<std::uint64_t, 2> overrun_{};
  std::array<std::optional<UartReceiver>, 2> receivers_;  ///< by the sending end
  std::array<std::uint64_t, 2> heard_{};
};

}  // namespace wirebond::sim
