// A supervised link: thread, port and clock around a LinkCore. The core decides what a link does.
// One file: all of it is one thread and its callers, around one lock.
#include "link.hpp"

#include <nanobind/stl/string.h>
#include <poll.h>
#include <sys/eventfd.h>
#include <sys/timerfd.h>
#include <time.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <chrono>
#include <cmath>
#include <cstring>
#include <memory>

#include "objects.hpp"
#include "wirebond/engine/account.hpp"
#include "without_gil.hpp"

namespace wirebond::engine {

namespace {

// Delay before a port that was lost or could not be opened is tried again: doubled each time, up to the last one. A
// change in its folder ends the delay.
constexpr std::uint64_t first_open_wait_us = 20'000;
constexpr std::uint64_t last_open_wait_us = 1'000'000;
constexpr std::uint64_t last_watched_wait_us =
    200'000;                                           // checking a file costs little, in case its appearance is missed
constexpr std::uint64_t least_open_wait_us = 5'000;    // however often files appear
constexpr std::uint64_t settled_after_us = 1'000'000;  // a port that lasted this long does not fail at once
constexpr std::uint64_t drain_on_close_us = 1'000'000;
constexpr std::uint64_t longest_sleep_us = 500'000;
constexpr std::uint64_t settings_look_us = 250'000;  // another program's settings stay in force no longer than a sleep
// How long the port may go unwatched after a caller has left it. A program that asks and answers is back sooner, and
// the thread sleeps on.
constexpr std::uint64_t unwatched_us = 200;
constexpr std::size_t read_bytes = 4096;
constexpr std::size_t write_at_once_bytes = 4096;
constexpr double signal_slice = 0.05;  // seconds between two checks for signals

/// Return CLOCK_MONOTONIC, the clock of Python's time.monotonic().
std::uint64_t monotonic_us() {
  timespec now{};
  ::clock_gettime(CLOCK_MONOTONIC, &now);
  return static_cast<std::uint64_t>(now.tv_sec) * 1'000'000 + static_cast<std::uint64_t>(now.tv_nsec) / 1000;
}

Moment moment_in(double seconds) {
  return Clock::now() + std::chrono::duration<double>(std::isnan(seconds) ? 0.0 : std::clamp(seconds, 0.0, 1e9));
}

timespec timespec_of(std::uint64_t us) {
  return {static_cast<time_t>(us / 1'000'000), static_cast<long>(us % 1'000'000) * 1000};
}

/// Make an event or a timer that was read no longer readable.
void take_event(const posix::Descriptor& event) {
  std::uint64_t ignored;
  static_cast<void>(!::read(event.get(), &ignored, sizeof ignored));
}

void raise_event(const posix::Descriptor& event) {
  const std::uint64_t one = 1;
  static_cast<void>(!::write(event.get(), &one, sizeof one));  // a full counter wakes as well
}

const std::uint8_t* data_of(const nb::bytes& bytes) { return static_cast<const std::uint8_t*>(bytes.data()); }

/// `code`: the system's error number; 0 if it gave none.
[[noreturn]] void throw_port_error(const std::string& text, int code, const std::string& path) {
  const nb::object type = nb::module_::import_("wirebond.errors").attr("PortError");
  const nb::object number = code == 0 ? nb::object(nb::none()) : nb::object(nb::int_(code));
  PyErr_SetObject(type.ptr(), type(text, number, path).ptr());
  throw nb::python_error();
}

}  // namespace

Link::Link(LinkSetup setup, std::unique_ptr<Opener> opener, bool waits_for_port)
    : opener_(std::move(opener)),
      core_(std::move(setup), monotonic_us()),
      appearance_(opener_->path()),
      open_wait_us_(first_open_wait_us) {
  PortProblem problem;
  {
    const WithoutGil released;
    port_ = appearance_.watching([&] { return opener_->open(stops_opening_, problem); });
  }
  if (!port_.is_open() && !waits_for_port) throw_port_error(problem.sentence, problem.code, opener_->name());
  wakeup_ = posix::Descriptor(::eventfd(0, EFD_NONBLOCK | EFD_CLOEXEC));
  caller_wakeup_ = posix::Descriptor(::eventfd(0, EFD_NONBLOCK | EFD_CLOEXEC));
  left_ = posix::Descriptor(::timerfd_create(CLOCK_MONOTONIC, TFD_NONBLOCK | TFD_CLOEXEC));
  if (!wakeup_.is_open() || !caller_wakeup_.is_open() || !left_.is_open()) {
    const int code = errno;
    throw_port_error(std::string("the system has no event descriptor left: ") + std::strerror(code), code,
                     opener_->name());
  }
  const std::uint64_t now = monotonic_us();
  if (port_.is_open()) {
    line_ = opener_->line();
    up_since_us_ = now;
    core_.port_up(now);
  } else {
    why_ = std::move(problem.sentence);
    look_again(now);
  }
  thread_ = std::thread([this] { run(); });
}

Link::~Link() { close(); }

void Link::begin_close() {
  const std::lock_guard lock(mutex_);
  if (is_closing_) return;
  is_closing_ = true;
  stops_opening_.store(true);
  const std::uint64_t now = monotonic_us();
  close_by_us_ = now + drain_on_close_us;
  core_.outbox().close();
  core_.note_changes(now, "closed");
  write_some();
  is_closed_.store(true);
  wake();
}

void Link::close() {
  begin_close();
  std::thread thread;
  {
    const std::lock_guard lock(mutex_);
    thread.swap(thread_);  // of two callers, one joins
    if (!thread.joinable() && is_done_) return;
  }
  const WithoutGil released;
  if (thread.joinable()) {
    thread.join();
  } else {
    std::unique_lock lock(mutex_);
    arrived_.wait(lock, [&] { return is_done_; });
  }
}

void Link::abandon() {
  port_.reset();
  wakeup_.reset();
  caller_wakeup_.reset();
  left_.reset();
  appearance_.stop();
}

void Link::wake() const { raise_event(wakeup_); }

/// Wake the sleeping thread if something is due before it wakes by itself.
void Link::wake_if_late(std::uint64_t now_us) const {
  const HostLink& link = core_.link();
  if (core_.next_due(now_us) < planned_us_ || (link.is_blocked() && !watches_room_)) wake();
}

// ---- called by programs -----------------------------------------------------------------------------------------

SendResult Link::send(std::int16_t message, nb::bytes frame, std::int16_t reply, bool takes_number,
                      std::uint64_t address) {
  const std::lock_guard lock(mutex_);
  const std::uint64_t now = monotonic_us();
  const SendResult result =
      core_.outbox().send(message, data_of(frame), frame.size(), reply, takes_number, now, address);
  if (result == SendResult::accepted) {
    write_some();
    wake_if_late(now);
  }
  return result;
}

nb::list Link::send_all(nb::list frames) {
  struct Given {
    std::int16_t message;
    nb::bytes frame;
  };
  std::vector<Given> given;  // read before the mutex is held: Python may run any code in between
  given.reserve(frames.size());
  for (nb::handle each : frames) {
    const auto pair = nb::cast<nb::tuple>(each);
    given.push_back({nb::cast<std::int16_t>(nb::object(pair[0])), nb::cast<nb::bytes>(nb::object(pair[1]))});
  }
  std::vector<SendResult> answers;
  answers.reserve(given.size());
  {
    const std::lock_guard lock(mutex_);
    std::size_t unwritten = 0;
    const std::uint64_t now = monotonic_us();
    for (const Given& one : given) {
      answers.push_back(core_.outbox().send(one.message, data_of(one.frame), one.frame.size(), -1, true, now, 0));
      unwritten += one.frame.size();
      if (unwritten < write_at_once_bytes) continue;
      write_some();
      unwritten = 0;
    }
    write_some();
    wake_if_late(now);
  }
  nb::list out;
  for (const SendResult answer : answers) out.append(answer_of(answer));
  return out;
}

SendResult Link::repeat(std::int16_t message, nb::bytes frame, double hold, std::int16_t reply, bool takes_number,
                        std::uint64_t address) {
  const std::lock_guard lock(mutex_);
  const std::uint64_t now = monotonic_us();
  const SendResult result =
      core_.outbox().repeat(message, data_of(frame), frame.size(), reply, takes_number, to_us(hold), now, address);
  core_.note_changes(now);
  write_some();
  wake_if_late(now);
  return result;
}

void Link::stop_repeating(std::int16_t message, std::optional<std::uint64_t> address) {
  const std::lock_guard lock(mutex_);
  if (address) {
    core_.outbox().stop_repeating(message, *address);
  } else {
    core_.outbox().stop_repeating(message);
  }
  core_.note_changes(monotonic_us());
}

bool Link::note_safe(nb::tuple safe) {
  StopFrame frame = stop_frame(to_node(safe));
  const std::lock_guard lock(mutex_);
  return core_.note_safe(std::move(frame));
}

bool Link::end_safely(std::int16_t message, std::uint64_t address) {
  const std::lock_guard lock(mutex_);
  const std::uint64_t now = monotonic_us();
  if (!core_.outbox().end_safely(message, address)) return false;
  core_.note_changes(now);
  write_some();
  wake_if_late(now);
  return true;
}

bool Link::end_if_moved(std::int16_t message, std::uint64_t address) {
  const std::lock_guard lock(mutex_);
  const std::uint64_t now = monotonic_us();
  if (!core_.outbox().end_if_moved(message, address)) return false;
  core_.note_changes(now);
  write_some();
  wake_if_late(now);
  return true;
}

void Link::hand_over() {
  const std::lock_guard lock(mutex_);
  core_.outbox().hand_over_motion();
}

void Link::end_motion() {
  const std::lock_guard lock(mutex_);
  const std::uint64_t now = monotonic_us();
  core_.outbox().end_motion();
  core_.note_changes(now);
  write_some();
  wake_if_late(now);
}

void Link::set_address(std::uint64_t address) {
  const std::lock_guard lock(mutex_);
  core_.link().addressing().set_address(address);
}

void Link::listen_to_all(bool all) {
  const std::lock_guard lock(mutex_);
  core_.link().addressing().listen_to_all(all);
}

bool Link::stop() {
  const std::lock_guard lock(mutex_);
  if (is_done_ || (is_closing_ && !port_.is_open())) return false;
  const std::uint64_t now = monotonic_us();
  core_.outbox().stop(now);
  core_.note_changes(now, "stopped");
  write_some();
  wake_if_late(now);
  return true;
}

void Link::release_stop() {
  const std::lock_guard lock(mutex_);
  core_.outbox().release_stop();
  core_.note_changes(monotonic_us());
}

bool Link::is_stopped() {
  const std::lock_guard lock(mutex_);
  return core_.outbox().is_stopped();
}

nb::list Link::receive(double timeout) {
  const Moment end = moment_in(timeout);
  std::deque<Arrivals> taken;
  for (;;) {
    bool is_over = false;
    {
      const WithoutGil released;
      std::unique_lock lock(mutex_);
      // A closing program takes its changes at the end, so that only the end cuts the last wait short.
      wait_for(lock, std::min(moment_in(signal_slice), end),
               [&] { return core_.has_arrivals() || is_done_ || (core_.has_changes() && !is_closing_); });
      taken = core_.take();
      is_over = is_done_ || (core_.has_changes() && !is_closing_) || Clock::now() >= end;
    }
    if (!taken.empty() || is_over) break;
    if (PyErr_CheckSignals() != 0) throw nb::python_error();
  }
  return messages_of(taken);
}

nb::list Link::attend(double timeout) {
  std::deque<Arrivals> taken;
  {
    const WithoutGil released;
    std::unique_lock lock(mutex_);
    is_attended_ = true;
    // Not at the port: a thread of handlers would wake for each frame, and costs more than the native one.
    arrived_.wait_until(lock, moment_in(timeout), [&] { return core_.has_news() || is_recalled_ || is_done_; });
    is_attended_ = is_recalled_ = false;
    taken = core_.take();
  }
  return messages_of(taken);
}

void Link::recall() {
  const std::lock_guard lock(mutex_);
  is_recalled_ = true;
  wake_callers();
}

void Link::wait_unattended(double timeout) {
  const WithoutGil released;
  std::unique_lock lock(mutex_);
  unattended_.wait_until(lock, moment_in(timeout), [&] { return (core_.has_news() && !is_attended_) || is_done_; });
}

/// Wait until `holds()`, at most until `end`. A caller that is back soon waits at the port itself, so that bytes wake
/// it alone: in a round trip the thread would come between. Others are told, and so are all while the port is closed.
template <class Condition>
void Link::wait_for(std::unique_lock<std::mutex>& lock, Moment end, Condition holds) {
  if (!is_caller_at_port_ && monotonic_us() - waited_until_us_ <= unwatched_us) wait_at_port(lock, end, holds);
  arrived_.wait_until(lock, end, holds);
  waited_until_us_ = monotonic_us();
}

/// Do the thread's work at the port until `holds()`, `end`, or the loss of the port.
template <class Condition>
void Link::wait_at_port(std::unique_lock<std::mutex>& lock, Moment end, Condition holds) {
  while (port_.is_open() && !holds()) {
    const std::chrono::duration<double, std::micro> left = end - Clock::now();
    if (left.count() <= 0) break;
    wake_after_caller(0);
    pollfd watched[2] = {{caller_wakeup_.get(), POLLIN, 0}, {port_.get(), POLLIN, 0}};
    const timespec timeout = timespec_of(static_cast<std::uint64_t>(std::ceil(left.count())));
    is_caller_at_port_ = true;
    lock.unlock();
    ::ppoll(watched, 2, &timeout, nullptr);
    lock.lock();
    is_caller_at_port_ = false;
    if (watched[0].revents != 0) take_event(caller_wakeup_);
    if (watched[1].revents == 0) continue;
    go_on();
    wake_if_late(monotonic_us());
    if (core_.has_news()) tell();
  }
  if (port_.is_open() && !watches_port_ && !is_left_timed_) wake_after_caller(unwatched_us);
}

/// Wake the thread then, which sleeps and does not watch the port; 0: never.
void Link::wake_after_caller(std::uint64_t us) {
  if (us == 0 && !is_left_timed_) return;
  const itimerspec once{{}, timespec_of(us)};
  ::timerfd_settime(left_.get(), 0, &once, nullptr);
  is_left_timed_ = us != 0;
}

/// With the GIL, and without a lock.
nb::list Link::messages_of(const std::deque<Arrivals>& taken) const { return to_list(taken, stamper_); }

void Link::wake_callers() {
  arrived_.notify_all();
  if (is_caller_at_port_) raise_event(caller_wakeup_);
}

/// Wake the attending thread, or all waiters.
void Link::tell() {
  wake_callers();
  if (!is_attended_) unattended_.notify_all();
}

nb::list Link::changes() {
  std::deque<LinkChange> changes;
  {
    const std::lock_guard lock(mutex_);
    changes = core_.take_changes();
  }
  return to_list(changes);
}

std::optional<LineReport> Link::line() {
  const std::lock_guard lock(mutex_);
  return line_;
}

nb::object Link::stats() {
  LinkAccount account;
  {
    const std::lock_guard lock(mutex_);
    account = core_.account();
  }
  // This makes objects: a garbage collection may close another link, or this one.
  return to_object(account_node(account, core_.protocol(), core_.receives()));
}

nb::tuple Link::recent() {
  RecentCopy copy;
  {
    const std::lock_guard lock(mutex_);
    copy = core_.recent().copy();
  }
  return to_tuple(copy);
}

int Link::open_tap(std::size_t capacity) {
  const std::lock_guard lock(mutex_);
  return core_.open_tap(capacity, monotonic_us());
}

nb::tuple Link::take_tap(int number) {
  TapCopy taken;
  {
    const std::lock_guard lock(mutex_);
    taken = core_.take_tap(number);
  }
  return to_tuple(taken);
}

void Link::close_tap(int number) {
  const std::lock_guard lock(mutex_);
  core_.close_tap(number);
}

void Link::note(const std::string& text) {
  const std::lock_guard lock(mutex_);
  core_.note(text, monotonic_us());
}

const char* Link::state() {
  const std::lock_guard lock(mutex_);
  return name_of(core_.link().state(monotonic_us()));
}

std::string Link::why() {
  const std::lock_guard lock(mutex_);
  return why_;
}

std::vector<std::uint8_t> Link::struck_deadlines() {
  const std::lock_guard lock(mutex_);
  return core_.struck_deadlines();
}

void Link::recover_deadline(std::uint8_t action) {
  const std::lock_guard lock(mutex_);
  core_.recover_deadline(action, monotonic_us());
  tell();
  wake();  // its silence counts again
}

// ---- the thread ------------------------------------------------------------------------------------------------

void Link::run() {
  std::unique_lock lock(mutex_);
  for (;;) {
    const std::uint64_t now = monotonic_us();
    if (is_closing_ && (!port_.is_open() || core_.outbox().is_empty() || now >= close_by_us_)) break;
    watches_port_ = port_.is_open() && !is_caller_at_port_;
    watches_room_ = port_.is_open() && core_.link().is_blocked();
    pollfd watched[3] = {{wakeup_.get(), POLLIN, 0}, {left_.get(), POLLIN, 0}, {appearance_.get(), POLLIN, 0}};
    if (port_.is_open()) {
      watched[2].fd = watches_port_ || watches_room_ ? port_.get() : -1;
      watched[2].events = static_cast<short>((watches_port_ ? POLLIN : 0) | (watches_room_ ? POLLOUT : 0));
    }
    planned_us_ = std::min(core_.next_due(now), now + longest_sleep_us);
    if (!port_.is_open()) planned_us_ = std::min(planned_us_, std::max(next_open_us_, now));
    const timespec timeout = timespec_of(planned_us_ - now);
    const bool has_news = core_.has_news();
    const bool is_attended = is_attended_;
    if (has_news && is_caller_at_port_) raise_event(caller_wakeup_);
    lock.unlock();
    if (has_news) arrived_.notify_all();  // here, so that a waiter does not wake only to wait for the mutex
    if (has_news && !is_attended) unattended_.notify_all();
    ::ppoll(watched, 3, &timeout, nullptr);
    lock.lock();
    planned_us_ = 0;  // awake
    if (watched[0].revents != 0) take_event(wakeup_);
    if (watched[1].revents != 0) wake_after_caller(0);
    if (!port_.is_open()) open_again(lock, monotonic_us());
    go_on();
  }
  why_.clear();
  lose_port(monotonic_us());
  appearance_.stop();
  core_.outbox().end();
  is_done_ = true;
  wake_callers();
  unattended_.notify_all();
}

/// Read, do what is due, and write.
void Link::go_on() {
  if (port_.is_open()) {
    read_some();
    look_at_settings(monotonic_us());
  }
  core_.poll(monotonic_us());
  write_some();
}

void Link::read_some() {
  std::uint8_t chunk[read_bytes];
  const std::uint64_t began_us = monotonic_us();
  const ssize_t got = ::read(port_.get(), chunk, sizeof chunk);
  if (got > 0) {
    core_.received(chunk, static_cast<std::size_t>(got), began_us, monotonic_us(),
                   static_cast<std::size_t>(got) < read_bytes / 2);  // a driver may deliver less than it has
  } else if (got < 0 && (errno == EAGAIN || errno == EINTR)) {
    if (errno == EAGAIN) core_.idle(began_us);
  } else {  // 0 is a hang-up; EIO, ENXIO and others a lost device
    go_down(got == 0 ? 0 : errno, began_us);
  }
}

void Link::look_at_settings(std::uint64_t now_us) {
  if (now_us < next_settings_look_us_ || !port_.is_open()) return;
  next_settings_look_us_ = now_us + settings_look_us;
  if (opener_->restore_settings(port_.get())) core_.settings_restored(now_us);
}

void Link::write_some() {
  if (core_.outbox().is_empty() || !port_.is_open()) return;
  int held = 0;  // as far as the driver knows; a UART or an adapter may hold more
  if (::ioctl(port_.get(), TIOCOUTQ, &held) == 0 && held > 0) {
    core_.link().driver_holds(static_cast<std::size_t>(held), monotonic_us());
  }
  while (port_.is_open()) {
    const std::uint64_t now = monotonic_us();
    const Outgoing out = core_.to_write(now, true);
    if (out.size == 0) return;
    const ssize_t done = opener_->write(port_.get(), out.bytes, out.size);
    if (done < 0 && errno != EAGAIN && errno != EINTR) return go_down(errno, now);
    if (done < 0 && errno == EINTR) continue;
    core_.written(done < 0 ? 0 : static_cast<std::size_t>(done), now);
    if (done <= 0) return;
  }
}

/// `code`: of the failed read or write; 0: the port ended, or the link is ending.
void Link::go_down(int code, std::uint64_t now_us) {
  why_ = opener_->why_gone(code);
  lose_port(now_us);
}

void Link::lose_port(std::uint64_t now_us) {
  posix::close_serial(port_);  // a connection has no lock to give back
  core_.port_down(now_us, why_);
  if (now_us - std::min(up_since_us_, now_us) > settled_after_us) open_wait_us_ = first_open_wait_us;
  look_again(now_us);
  tell();
  wake();  // the thread looks for the port again; a caller may have lost it
}

/// Plan the next try, and the events that may bring it forward.
void Link::look_again(std::uint64_t now_us) {
  next_open_us_ = now_us + open_wait_us_;
  open_wait_us_ = std::min(2 * open_wait_us_, appearance_.get() < 0 ? last_open_wait_us : last_watched_wait_us);
}

/// Open the port without the mutex: that may take long, and a stop must not wait for it.
void Link::open_again(std::unique_lock<std::mutex>& lock, std::uint64_t now_us) {
  if (appearance_.changed()) {
    open_wait_us_ = first_open_wait_us;
    next_open_us_ = std::min(next_open_us_, now_us + least_open_wait_us);
  }
  if (is_closing_ || now_us < next_open_us_) return;
  PortProblem problem;
  // It is watched until the next attempt: a device may be back before its loss is noticed.
  posix::Descriptor port = appearance_.watching([&] {
    lock.unlock();
    posix::Descriptor opened = opener_->open(stops_opening_, problem);
    lock.lock();
    return opened;
  });
  if (is_closing_) return posix::close_serial(port);
  now_us = monotonic_us();
  if (!port.is_open()) {
    why_ = std::move(problem.sentence);
    return look_again(now_us);
  }
  port_ = std::move(port);
  why_.clear();
  line_ = opener_->line();
  up_since_us_ = now_us;
  core_.port_up(now_us);
}

}  // namespace wirebond::engine
