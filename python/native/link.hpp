// A supervised link: thread, port and clock around a LinkCore. The core decides what a link does.
#pragma once

#include <nanobind/nanobind.h>

#include <atomic>
#include <chrono>
#include <condition_variable>
#include <cstdint>
#include <memory>
#include <mutex>
#include <optional>
#include <string>
#include <thread>
#include <vector>

#include "link_core_binding.hpp"
#include "opener.hpp"
#include "wirebond/posix/appearance.hpp"

namespace wirebond::engine {

void bind_link(nb::module_& m);

using Clock = std::chrono::steady_clock;
using Moment = std::chrono::time_point<Clock, std::chrono::duration<double>>;

/// Every public function may be called from any Python thread, with the GIL. Those that wait release it; the others
/// hold the mutex for microseconds. The thread never asks for the GIL.
class Link {
 public:
  /// Open the port, without the GIL. Throws PortError with a sentence if that fails; `waits_for_port`: the link begins
  /// without it, and waits for it.
  Link(LinkSetup setup, std::unique_ptr<Opener> opener, bool waits_for_port);
  ~Link();
  Link(const Link&) = delete;
  Link& operator=(const Link&) = delete;

  SendResult send(std::int16_t message, nb::bytes frame, std::int16_t reply, bool takes_number, std::uint64_t address);
  /// Send each of these frames, a tuple of its message and its bytes, as `send` does without a reply and address. The
  /// port is written to once for many. Returns one answer for each.
  nb::list send_all(nb::list frames);
  SendResult repeat(std::int16_t message, nb::bytes frame, double hold, std::int16_t reply, bool takes_number,
                    std::uint64_t address);
  void stop_repeating(std::int16_t message, std::optional<std::uint64_t> address);
  bool note_safe(nb::tuple safe);
  bool end_safely(std::int16_t message, std::uint64_t address);
  bool end_if_moved(std::int16_t message, std::uint64_t address);
  void hand_over();
  void end_motion();
  void set_address(std::uint64_t address);
  void listen_to_all(bool all);
  /// Returns false if the link has ended, and nothing was sent. While `close` still waits, a stop leaves before all
  /// else.
  bool stop();
  void release_stop();
  bool is_stopped();

  /// Return messages that came in since the last call; waits up to `timeout` seconds for the first one, or for a
  /// change. A signal's Python handler runs within a moment; its exception ends the wait.
  nb::list receive(double timeout);
  /// Do the same, for the one thread that takes messages whenever it is idle. Only `recall` ends its wait early: of
  /// this call, or of the next one. Does not check for signals.
  nb::list attend(double timeout);
  void recall();
  /// Wait until messages can be taken and no thread is in `attend`, or the link has ended. So a stand-in for the
  /// attending thread sleeps while that one keeps up.
  void wait_unattended(double timeout);
  /// Return deadlines that have struck or ended, ports that were opened and lost, since the last call.
  nb::list changes();

  nb::object stats();
  /// Return the last bytes of both directions. Copying the maximum holds the mutex for a tenth of a millisecond.
  nb::tuple recent();
  /// See LinkCore. A tap holds the mutex only while two vectors are swapped.
  int open_tap(std::size_t capacity);
  nb::tuple take_tap(int number);
  void close_tap(int number);
  void note(const std::string& text);
  const char* state();
  /// Return why the port is closed, as a sentence; empty while it is open.
  std::string why();
  /// Return the driver's actual line settings when the port was last opened; none: it has none, or was never open.
  std::optional<LineReport> line();
  bool is_closed() const { return is_closed_.load(); }
  /// Set the stamper of received messages; see Message. Call it before any of them is taken.
  void set_stamper(nb::object stamper) { stamper_ = std::move(stamper); }
  std::vector<std::uint8_t> struck_deadlines();
  void recover_deadline(std::uint8_t action);

  /// End leases with their safe values, and accept nothing more. Does not wait: call `close` as well.
  void begin_close();
  /// Do the same, send what is queued (at most for a second), and close the port. Every caller waits for that.
  void close();

  /// In a forked child: close this process's copies of the descriptors, and do nothing else. The thread does not exist
  /// here, and the mutex may be held for ever.
  void abandon();

 private:
  // Everything below is called by the thread, or with mutex_ held.
  void run();
  void go_on();
  template <class Condition>
  void wait_for(std::unique_lock<std::mutex>& lock, Moment end, Condition holds);
  template <class Condition>
  void wait_at_port(std::unique_lock<std::mutex>& lock, Moment end, Condition holds);
  void wake_after_caller(std::uint64_t us);
  void open_again(std::unique_lock<std::mutex>& lock, std::uint64_t now_us);
  void read_some();
  void write_some();
  void look_at_settings(std::uint64_t now_us);
  void go_down(int code, std::uint64_t now_us);
  void lose_port(std::uint64_t now_us);
  void look_again(std::uint64_t now_us);
  void tell();
  void wake_callers();
  nb::list messages_of(const std::deque<Arrivals>& taken) const;
  void wake() const;
  void wake_if_late(std::uint64_t now_us) const;

  std::unique_ptr<Opener> opener_;  ///< the thread's, once it runs; const members are for all
  std::mutex mutex_;
  std::condition_variable arrived_;     ///< for `receive`, `attend` and `close`
  bool is_caller_at_port_ = false;      ///< one of them waits for the port's bytes itself, and for `caller_wakeup_`
  std::condition_variable unattended_;  ///< for `wait_unattended`
  bool is_attended_ = false;
  bool is_recalled_ = false;
  LinkCore core_;       ///< makes no Python object: that may run any Python code, which must not wait for the mutex
  nb::object stamper_;  ///< of received messages; see Message
  posix::Descriptor port_;
  posix::Descriptor wakeup_;
  posix::Descriptor caller_wakeup_;
  std::uint64_t waited_until_us_ = 0;  ///< when a caller waited last
  posix::Descriptor left_;             ///< a timer, which wakes the thread when a caller has left the port unwatched
  bool is_left_timed_ = false;         ///< it runs, or has not been taken note of
  posix::Appearance appearance_;       ///< the thread's: watches since the port was last opened or tried
  std::string why_;
  std::optional<LineReport> line_;  ///< of the port opened last
  std::uint64_t up_since_us_ = 0;
  std::uint64_t next_settings_look_us_ = 0;
  std::uint64_t next_open_us_ = 0;
  std::uint64_t open_wait_us_;  ///< between two tries; grows
  std::atomic<bool> stops_opening_{false};
  std::uint64_t planned_us_ = 0;  ///< when the thread wakes by itself
  bool watches_port_ = true;      ///< the thread waits for the port's bytes; no caller does so for it
  bool watches_room_ = false;     ///< the thread also waits until the port can take bytes
  bool is_closing_ = false;
  std::uint64_t close_by_us_ = 0;
  bool is_done_ = false;
  std::atomic<bool> is_closed_{false};
  std::thread thread_;
};

}  // namespace wirebond::engine
