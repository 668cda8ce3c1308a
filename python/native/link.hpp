// A supervised link: thread, port and clock around a LinkCore. What a link does is decided in core.
#pragma once

#include <nanobind/nanobind.h>

#include <atomic>
#include <condition_variable>
#include <cstdint>
#include <memory>
#include <mutex>
#include <optional>
#include <string>
#include <thread>
#include <vector>

#include "link_core.hpp"
#include "opener.hpp"
#include "wirebond/posix/appearance.hpp"

namespace wirebond::engine {

void bind_link(nb::module_& m);

/// Every public function may be called from any Python thread, with the GIL. Those that wait release it; the others
/// hold the mutex for microseconds, and the thread never asks for the GIL.
class Link {
 public:
  /// Opens the port, without the GIL. Throws PortError with a sentence where that fails; `waits_for_port`: the link
  /// begins without it, and looks for it.
  Link(LinkSetup setup, std::unique_ptr<Opener> opener, bool waits_for_port);
  ~Link();
  Link(const Link&) = delete;
  Link& operator=(const Link&) = delete;

  SendResult send(std::int16_t message, nb::bytes frame, std::int16_t reply, bool takes_number, std::uint64_t address);
  /// Each of these frames, a tuple of its message and its bytes, as `send` sends one without a reply and address. The
  /// port is written to once for many. One answer for each.
  nb::list send_all(nb::list frames);
  SendResult repeat(std::int16_t message, nb::bytes frame, double hold, std::int16_t reply, bool takes_number,
                    std::uint64_t address);
  void stop_repeating(std::int16_t message, std::optional<std::uint64_t> address);
  bool note_safe(nb::tuple safe);
  bool end_safely(std::int16_t message, std::uint64_t address);
  void set_address(std::uint64_t address);
  void listen_to_all(bool all);
  /// False: the link has ended, and nothing was sent. While `close` still waits a stop leaves before all else.
  bool stop();
  void release_stop();
  bool is_stopped();

  /// Messages that came in since the last call; waits up to `timeout` seconds for the first one, or for a change. A
  /// signal's Python handler runs within a moment; its exception ends the wait.
  nb::list receive(double timeout);
  /// The same for the one thread that takes what comes whenever it has nothing else to do. Only `recall` ends its wait
  /// early: of this call, or of the next one. Signals are not looked for.
  nb::list attend(double timeout);
  void recall();
  /// Wait until something is there to be taken and nobody is in `attend`, or the link has ended. So who stands in for
  /// the thread that attends sleeps as long as that keeps up.
  void wait_unattended(double timeout);
  /// Deadlines that have struck or ended, ports that came and went, since the last call.
  nb::list changes();

  nb::dict stats();
  /// The last bytes of both directions. Copying the most that is kept holds the mutex for a tenth of a millisecond.
  nb::tuple recent();
  /// See LinkCore. A tap holds the mutex for as long as two vectors are exchanged.
  int open_tap(std::size_t capacity);
  nb::tuple take_tap(int number);
  void close_tap(int number);
  void note(const std::string& text);
  const char* state();
  /// Why the port is away, as a sentence; empty while it is there.
  std::string why();
  /// What the driver made of the line's settings when the port was opened last; none: it has none, or was never open.
  std::optional<LineReport> line();
  bool is_closed() const { return is_closed_.load(); }
  /// Of received messages; see Message. Before any of them is taken.
  void set_stamper(nb::object stamper) { core_.stamper = std::move(stamper); }
  std::vector<std::uint8_t> struck_deadlines();
  void recover_deadline(std::uint8_t action);

  /// Leases end, with their safe values, and nothing more is taken. Waits for nothing: call `close` as well.
  void begin_close();
  /// The same; then what is queued leaves (a second at most), and the port is given back. Every call waits for that.
  void close();

  /// In a forked child: give back this process's copies of the descriptors, and nothing else. The thread is not here,
  /// and the mutex may be held for ever.
  void abandon();

 private:
  // Everything below is called by the thread, or with mutex_ held.
  void run();
  void open_again(std::unique_lock<std::mutex>& lock, std::uint64_t now_us);
  void read_some();
  void write_some();
  void go_down(int code, std::uint64_t now_us);
  void lose_port(std::uint64_t now_us);
  void look_again(std::uint64_t now_us);
  void tell();
  nb::list messages_of(const std::deque<Arrivals>& taken) const;
  void wake() const;
  void wake_if_late(std::uint64_t now_us) const;

  std::unique_ptr<Opener> opener_;  ///< the thread's, once that runs; what is const is everybody's
  std::mutex mutex_;
  std::condition_variable arrived_;     ///< for `receive`, `attend` and `close`
  std::condition_variable unattended_;  ///< for `wait_unattended`
  bool is_attended_ = false;
  bool is_recalled_ = false;
  LinkCore core_;
  posix::Descriptor port_;
  posix::Descriptor wakeup_;
  posix::Appearance appearance_;  ///< the thread's: watches while the port is away
  std::string why_;
  std::optional<LineReport> line_;  ///< of the port that was opened last
  std::uint64_t up_since_us_ = 0;
  std::uint64_t next_open_us_ = 0;
  std::uint64_t open_wait_us_;  ///< between two tries; grows
  std::atomic<bool> stops_opening_{false};
  std::uint64_t planned_us_ = 0;  ///< when the thread wakes by itself
  bool watches_room_ = false;     ///< the thread also waits for the port to take bytes
  bool is_closing_ = false;
  std::uint64_t close_by_us_ = 0;
  bool is_done_ = false;
  std::atomic<bool> is_closed_{false};
  std::thread thread_;
};

}  // namespace wirebond::engine
