// A supervised link over a tty: one native thread reads, deframes, timestamps, sends, repeats and reconnects.
// Protocol rules live in core; here are threads and descriptors.
#pragma once

#include <nanobind/nanobind.h>

#include <atomic>
#include <condition_variable>
#include <cstdint>
#include <deque>
#include <memory>
#include <mutex>
#include <string>
#include <thread>
#include <vector>

#include "decoder.hpp"
#include "protocol.hpp"
#include "wirebond/deadline.hpp"
#include "wirebond/posix/serial.hpp"

namespace wirebond::engine {

void bind_link(nb::module_& m);

/// Every public function may be called from any Python thread. Waiting functions release the GIL.
class Link {
 public:
  struct Options {
    std::string path;
    posix::SerialSettings serial;
    double idle_seconds = 0.02;
  };

  /// Opens the port; throws PortError with a sentence when it cannot be opened the first time.
  Link(std::shared_ptr<const ProtocolTable> protocol, std::shared_ptr<const FormatTable> receive, Options options,
       const std::vector<DeadlineRule>& deadlines);
  ~Link();
  Link(const Link&) = delete;
  Link& operator=(const Link&) = delete;

  /// Hand over one whole frame. 0: accepted; 1: the link is down; 2: the queue is full. `urgent`: it goes before all
  /// that waits, and a full queue does not refuse it. `reply`: index of the message that answers it; -1: none.
  int send(nb::bytes frame, bool urgent, std::int16_t reply);

  /// Repeat `frame` every `period`, until `hold` seconds after this call; then `safe` once, if not empty. `reply` as
  /// for `send`.
  void repeat(std::size_t message, nb::bytes frame, nb::bytes safe, double period, double hold, std::int16_t reply);
  void stop_repeating(std::size_t message);

  /// Messages that came in since the last call; waits up to `timeout` seconds for the first one.
  nb::list receive(double timeout);

  nb::dict stats();
  std::string state();
  std::vector<std::uint8_t> struck_deadlines();
  void recover_deadline(std::uint8_t action);
  void close();

 private:
  static constexpr std::size_t max_waiting_messages = 65536;
  static constexpr std::size_t max_queued_bytes = 65536;

  struct Arrivals {
    std::shared_ptr<Batch> batch;
    std::vector<Event> events;
  };
  struct Outgoing {
    std::vector<std::uint8_t> bytes;
    int repeated = -1;        ///< message index of a repeated frame: only the newest waits
    std::int16_t reply = -1;  ///< index of the message that answers it
  };
  struct Repeated {
    std::size_t message = 0;
    std::vector<std::uint8_t> frame;
    std::vector<std::uint8_t> safe;
    Periodic<std::uint64_t> rhythm{1, 0};
    std::uint64_t lease_end_us = 0;
    std::int16_t reply = -1;
  };
  struct SendAccount {
    std::uint64_t offered = 0;
    std::uint64_t accepted = 0;
    std::uint64_t refused_down = 0;
    std::uint64_t refused_full = 0;
    std::uint64_t sent = 0;
    std::uint64_t sent_bytes = 0;
    std::uint64_t replaced = 0;
    std::uint64_t expired = 0;
    std::uint64_t aborted = 0;
  };

  // Everything below is called by the thread, or with mutex_ held.
  void run();
  void read_some();
  void take(const Frame& frame, std::uint64_t now_us, Arrivals& arrivals);
  void publish(Arrivals&& arrivals);
  bool enqueue(Outgoing outgoing, bool urgent);
  void write_some();
  void run_repeated(std::uint64_t now_us);
  void run_deadlines(std::uint64_t now_us);
  void go_down();
  void try_reopen(std::uint64_t now_us);
  int wait_ms(std::uint64_t now_us) const;
  void wake() const;

  std::shared_ptr<const ProtocolTable> protocol_;
  std::shared_ptr<const FormatTable> format_;
  Options options_;

  std::mutex mutex_;
  std::condition_variable arrived_;
  posix::Descriptor port_;
  posix::Descriptor wakeup_;
  std::vector<std::uint8_t> workspace_;
  HostDeframer deframer_;
  std::vector<std::uint64_t> counts_;
  std::deque<Arrivals> arrivals_;
  std::size_t waiting_messages_ = 0;
  std::uint64_t dropped_messages_ = 0;
  std::deque<Outgoing> queue_;
  std::size_t queued_bytes_ = 0;
  std::size_t written_of_first_ = 0;
  SendAccount account_;
  std::vector<Repeated> repeated_;
  std::vector<std::array<DeadlineRule, 1>> deadline_rules_;  // the deadlines point into it
  std::vector<Deadlines<1, std::uint64_t>> deadlines_;
  std::uint64_t last_frame_us_ = 0;
  std::uint64_t next_open_us_ = 0;
  std::uint64_t last_byte_us_ = 0;
  std::uint64_t reconnects_ = 0;
  bool closing_ = false;
  std::uint64_t close_by_us_ = 0;
  bool thread_done_ = false;
  std::thread thread_;
};

}  // namespace wirebond::engine
