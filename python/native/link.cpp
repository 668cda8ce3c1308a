// A supervised link: thread, port and clock around a LinkCore. What a link does is decided in core.
#include "link.hpp"

#include <nanobind/stl/optional.h>
#include <nanobind/stl/shared_ptr.h>
#include <nanobind/stl/string.h>
#include <nanobind/stl/vector.h>
#include <poll.h>
#include <pthread.h>
#include <sys/eventfd.h>
#include <time.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <chrono>
#include <cmath>
#include <cstring>
#include <memory>

#include "without_gil.hpp"

namespace wirebond::engine {

namespace {

// How long after a port went away, or could not be opened, it is tried again: twice as long each time, up to the last
// one. What appears in its folder ends the wait.
constexpr std::uint64_t first_open_wait_us = 20'000;
constexpr std::uint64_t last_open_wait_us = 1'000'000;
constexpr std::uint64_t least_open_wait_us = 5'000;    // however much appears
constexpr std::uint64_t settled_after_us = 1'000'000;  // a port that lasted so long is no port that fails at once
constexpr std::uint64_t drain_on_close_us = 1'000'000;
constexpr std::uint64_t longest_sleep_us = 500'000;
constexpr std::size_t read_bytes = 4096;
constexpr std::size_t write_at_once_bytes = 4096;
constexpr double signal_slice = 0.05;  // seconds between two looks for signals

/// CLOCK_MONOTONIC, the clock of Python's time.monotonic().
std::uint64_t monotonic_us() {
  timespec now{};
  ::clock_gettime(CLOCK_MONOTONIC, &now);
  return static_cast<std::uint64_t>(now.tv_sec) * 1'000'000 + static_cast<std::uint64_t>(now.tv_nsec) / 1000;
}

using Clock = std::chrono::steady_clock;
using Moment = std::chrono::time_point<Clock, std::chrono::duration<double>>;

Moment moment_in(double seconds) {
  return Clock::now() + std::chrono::duration<double>(std::isnan(seconds) ? 0.0 : std::clamp(seconds, 0.0, 1e9));
}

std::uint64_t to_us(double seconds) { return static_cast<std::uint64_t>(std::llround(seconds * 1e6)); }

const std::uint8_t* data_of(const nb::bytes& bytes) { return static_cast<const std::uint8_t*>(bytes.data()); }

/// `code`: the system's error number; 0 where it gave none.
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
    port_ = opener_->open(stops_opening_, problem);
  }
  if (!port_.is_open() && !waits_for_port) throw_port_error(problem.sentence, problem.code, opener_->name());
  wakeup_ = posix::Descriptor(::eventfd(0, EFD_NONBLOCK | EFD_CLOEXEC));
  if (!wakeup_.is_open()) {
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
    thread.swap(thread_);  // of two callers one joins
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
  appearance_.stop();
}

void Link::wake() const {
  const std::uint64_t one = 1;
  static_cast<void>(!::write(wakeup_.get(), &one, sizeof one));  // a full counter wakes as well
}

/// The thread sleeps: wake it where something is due before it wakes by itself.
void Link::wake_if_late(std::uint64_t now_us) const {
  const HostLink& link = core_.link();
  if (core_.next_due(now_us) < planned_us_ || (link.is_blocked() && !watches_room_)) wake();
}

// ---- what programs call ----------------------------------------------------------------------------------------

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
  std::vector<Given> given;  // read before the mutex is held: Python may run anything in between
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
  StopFrame frame = stop_frame(safe);
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
      // What closes takes its changes at the end, so that nothing but the end cuts the last wait short.
      arrived_.wait_until(lock, std::min(moment_in(signal_slice), end),
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
    arrived_.wait_until(lock, moment_in(timeout), [&] { return core_.has_news() || is_recalled_ || is_done_; });
    is_attended_ = is_recalled_ = false;
    taken = core_.take();
  }
  return messages_of(taken);
}

void Link::recall() {
  const std::lock_guard lock(mutex_);
  is_recalled_ = true;
  arrived_.notify_all();
}

void Link::wait_unattended(double timeout) {
  const WithoutGil released;
  std::unique_lock lock(mutex_);
  unattended_.wait_until(lock, moment_in(timeout), [&] { return (core_.has_news() && !is_attended_) || is_done_; });
}

/// With the GIL, and no lock.
nb::list Link::messages_of(const std::deque<Arrivals>& taken) const {
  nb::list out;
  for (const Arrivals& arrivals : taken) out.extend(to_list(arrivals.batch, arrivals.events, core_.stamper));
  return out;
}

/// Something came, or happened: to who attends alone; where nobody does, to all who wait.
void Link::tell() {
  arrived_.notify_all();
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

nb::dict Link::stats() {
  LinkAccount account;
  {
    const std::lock_guard lock(mutex_);
    account = core_.account();
  }
  return to_dict(account, core_.protocol(),
                 core_.receives());  // makes objects: a garbage collection may close another link, or this
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
    watches_room_ = core_.link().is_blocked();
    pollfd watched[2] = {{wakeup_.get(), POLLIN, 0}, {appearance_.get(), POLLIN, 0}};
    if (port_.is_open()) {
      watched[1].fd = port_.get();
      watched[1].events = static_cast<short>(POLLIN | (watches_room_ ? POLLOUT : 0));
    }
    planned_us_ = std::min(core_.next_due(now), now + longest_sleep_us);
    if (!port_.is_open()) planned_us_ = std::min(planned_us_, std::max(next_open_us_, now));
    const std::uint64_t wait = planned_us_ - now;
    const timespec timeout{static_cast<time_t>(wait / 1'000'000), static_cast<long>(wait % 1'000'000) * 1000};
    const bool has_news = core_.has_news();
    const bool is_attended = is_attended_;
    lock.unlock();
    if (has_news) arrived_.notify_all();  // here, so that who waits does not wake only to wait for the mutex
    if (has_news && !is_attended) unattended_.notify_all();
    ::ppoll(watched, 2, &timeout, nullptr);
    lock.lock();
    planned_us_ = 0;  // awake
    std::uint64_t ignored;
    if (watched[0].revents != 0) static_cast<void>(!::read(wakeup_.get(), &ignored, sizeof ignored));
    if (port_.is_open()) {
      read_some();
    } else {
      open_again(lock, monotonic_us());
    }
    core_.poll(monotonic_us());
    write_some();
  }
  why_.clear();
  lose_port(monotonic_us());
  appearance_.stop();
  core_.outbox().end();
  is_done_ = true;
  arrived_.notify_all();
  unattended_.notify_all();
}

void Link::read_some() {
  std::uint8_t chunk[read_bytes];
  const std::uint64_t began_us = monotonic_us();
  const ssize_t got = ::read(port_.get(), chunk, sizeof chunk);
  if (got > 0) {
    core_.received(chunk, static_cast<std::size_t>(got), began_us, monotonic_us(),
                   static_cast<std::size_t>(got) < read_bytes / 2);  // a driver hands over less than it has
  } else if (got < 0 && (errno == EAGAIN || errno == EINTR)) {
    if (errno == EAGAIN) core_.idle(began_us);
  } else {  // 0 is a hang-up; EIO, ENXIO and others a device that went away
    go_down(got == 0 ? 0 : errno, began_us);
  }
}

void Link::write_some() {
  if (core_.outbox().is_empty() || !port_.is_open()) return;
  int held = 0;  // what the driver knows of; a UART or an adapter may hold more
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

/// `code`: of the read or write that failed; 0: the port ended, or the link does.
void Link::go_down(int code, std::uint64_t now_us) {
  why_ = opener_->why_gone(code);
  lose_port(now_us);
}

void Link::lose_port(std::uint64_t now_us) {
  port_.reset();
  core_.port_down(now_us, why_);
  if (now_us - std::min(up_since_us_, now_us) > settled_after_us) open_wait_us_ = first_open_wait_us;
  look_again(now_us);
  tell();
}

/// The next try, and what may bring it forward.
void Link::look_again(std::uint64_t now_us) {
  next_open_us_ = now_us + open_wait_us_;
  open_wait_us_ = std::min(2 * open_wait_us_, last_open_wait_us);
  if (appearance_.get() < 0 && !opener_->path().empty()) appearance_.watch();
}

/// Without the mutex while the port is opened: that may take its time, and a stop must not wait for it.
void Link::open_again(std::unique_lock<std::mutex>& lock, std::uint64_t now_us) {
  if (appearance_.changed()) {
    open_wait_us_ = first_open_wait_us;
    next_open_us_ = std::min(next_open_us_, now_us + least_open_wait_us);
  }
  if (is_closing_ || now_us < next_open_us_) return;
  PortProblem problem;
  lock.unlock();
  posix::Descriptor port = opener_->open(stops_opening_, problem);
  lock.lock();
  if (is_closing_) return;
  now_us = monotonic_us();
  if (!port.is_open()) {
    why_ = std::move(problem.sentence);
    return look_again(now_us);
  }
  port_ = std::move(port);
  why_.clear();
  line_ = opener_->line();
  appearance_.stop();
  up_since_us_ = now_us;
  core_.port_up(now_us);
}

// ---- binding ---------------------------------------------------------------------------------------------------

namespace {

/// How many forks there were on the way to this process. Asked at each call, where a system call would be felt.
unsigned forks() {
  static std::atomic<unsigned> count{0};
  static const int registered = ::pthread_atfork(nullptr, nullptr, [] { count.fetch_add(1); });
  static_cast<void>(registered);
  return count.load(std::memory_order_relaxed);
}

/// A Link that a forked child does not touch: it has neither its thread nor its locks.
class LinkHandle {
 public:
  LinkHandle(LinkSetup setup, std::unique_ptr<Opener> opener, bool waits_for_port)
      : link_(std::make_unique<Link>(std::move(setup), std::move(opener), waits_for_port)), forks_(forks()) {}
  ~LinkHandle() { leave_in_child(); }

  /// Null in a forked child.
  Link* get() {
    leave_in_child();
    return link_.get();
  }

  Link& operator*() {
    Link* const link = get();
    if (link != nullptr) return *link;
    const nb::object type = nb::module_::import_("wirebond.errors").attr("LinkDownError");
    PyErr_SetString(type.ptr(),
                    "this link belongs to the process that opened it, and this one is its fork; open the "
                    "port in the process that uses it");
    throw nb::python_error();
  }

  void leave_in_child() {
    if (link_ == nullptr || forks() == forks_) return;
    link_->abandon();
    static_cast<void>(link_.release());  // its destructor would wait for a thread that is not here
  }

 private:
  std::unique_ptr<Link> link_;
  unsigned forks_;
};

/// `resolve` is called without locks, and no link's thread is there any more when the interpreter ends: so the thread
/// may wait for the GIL here.
Resolve calling(nb::callable resolve) {
  return [resolve = std::move(resolve)](PortProblem& problem) -> std::string {
    const nb::gil_scoped_acquire gil;
    try {
      return nb::cast<std::string>(resolve());
    } catch (nb::python_error& error) {
      problem = {nb::cast<std::string>(nb::str(error.value())), 0};
      const nb::object code = nb::getattr(error.value(), "errno", nb::none());
      if (!code.is_none()) problem.code = nb::cast<int>(code);
      return {};
    }
  };
}

/// `port`: `name`; `root`, where the system's files are, for a tty, and `resolve` for one that moves; or `host` and
/// `service` for TCP.
std::unique_ptr<Opener> opener_of(const nb::dict& port, nb::handle settings) {
  auto name = nb::cast<std::string>(port["name"]);
  if (port.contains("host")) {
    return tcp_opener(std::move(name), nb::cast<std::string>(port["host"]), nb::cast<std::string>(port["service"]));
  }
  posix::SerialSettings serial;
  const auto parity = nb::cast<std::string>(settings.attr("parity"));
  serial.baud = nb::cast<std::uint32_t>(settings.attr("baud"));
  serial.data_bits = nb::cast<std::uint8_t>(settings.attr("data_bits"));
  serial.parity = parity == "even" ? posix::Parity::even : parity == "odd" ? posix::Parity::odd : posix::Parity::none;
  serial.stop_bits = nb::cast<std::uint8_t>(settings.attr("stop_bits"));
  auto root = nb::cast<std::string>(port["root"]);
  if (port.contains("resolve")) {
    return moving_serial_opener(std::move(name), calling(nb::cast<nb::callable>(port["resolve"])), serial,
                                std::move(root));
  }
  return serial_opener(std::move(name), serial, std::move(root));
}

/// As `wirebond.link.line.line_from` takes it.
nb::object to_dict(const std::optional<LineReport>& line) {
  if (!line) return nb::none();
  static constexpr const char* parities[] = {"none", "even", "odd"};
  static constexpr const char* answers[] = {"not_offered", "refused", "accepted"};
  const posix::SerialReport& serial = line->serial;
  nb::dict out;
  out["baud"] = serial.actual.baud;
  out["asked_baud"] = line->asked_baud;
  out["data_bits"] = serial.actual.data_bits;
  out["parity"] = parities[static_cast<std::size_t>(serial.actual.parity)];
  out["stop_bits"] = serial.actual.stop_bits;
  out["is_exclusive"] = serial.is_exclusive;
  out["low_latency"] = answers[static_cast<std::size_t>(serial.low_latency)];
  if (line->timer.before_ms >= 0) {
    out["latency_timer"] =
        nb::make_tuple(line->timer.path, line->timer.before_ms, line->timer.now_ms, line->timer.code);
  }
  return out;
}

}  // namespace

void bind_link(nb::module_& m) {
  nb::class_<LinkHandle>(m, "Link")
      .def(
          "__init__",
          [](LinkHandle* self, std::shared_ptr<const ProtocolTable> protocol,
             std::shared_ptr<const FormatTable> receive, nb::dict port, nb::handle settings) {
            LinkSetup setup = link_setup(std::move(protocol), std::move(receive), settings);
            new (self) LinkHandle(std::move(setup), opener_of(port, settings), nb::cast<bool>(port["waits"]));
          },
          nb::arg("protocol"), nb::arg("receive"), nb::arg("port"), nb::arg("settings"))
      .def(
          "send",
          [](LinkHandle& self, std::int16_t message, nb::bytes frame, std::int16_t reply, bool takes_number,
             std::uint64_t address) { return answer_of((*self).send(message, frame, reply, takes_number, address)); },
          nb::arg("message"), nb::arg("frame"), nb::arg("reply"), nb::arg("takes_number"), nb::arg("address"))
      .def(
          "send_all", [](LinkHandle& self, nb::list frames) { return (*self).send_all(frames); }, nb::arg("frames"))
      .def(
          "repeat",
          [](LinkHandle& self, std::int16_t message, nb::bytes frame, double hold, std::int16_t reply,
             bool takes_number, std::uint64_t address) {
            return answer_of((*self).repeat(message, frame, hold, reply, takes_number, address));
          },
          nb::arg("message"), nb::arg("frame"), nb::arg("hold"), nb::arg("reply"), nb::arg("takes_number"),
          nb::arg("address"))
      .def(
          "note_safe", [](LinkHandle& self, nb::tuple safe) { return (*self).note_safe(safe); }, nb::arg("safe"))
      .def(
          "end_safely",
          [](LinkHandle& self, std::int16_t message, std::uint64_t address) {
            return (*self).end_safely(message, address);
          },
          nb::arg("message"), nb::arg("address"))
      .def(
          "set_address", [](LinkHandle& self, std::uint64_t address) { (*self).set_address(address); },
          nb::arg("address"))
      .def(
          "listen_to_all", [](LinkHandle& self, bool all) { (*self).listen_to_all(all); }, nb::arg("all"))
      .def(
          "stop_repeating",
          [](LinkHandle& self, std::int16_t message, std::optional<std::uint64_t> address) {
            (*self).stop_repeating(message, address);
          },
          nb::arg("message"), nb::arg("address") = nb::none())
      .def("stop", [](LinkHandle& self) { return (*self).stop(); })
      .def("release_stop", [](LinkHandle& self) { (*self).release_stop(); })
      .def("is_stopped", [](LinkHandle& self) { return (*self).is_stopped(); })
      .def(
          "receive", [](LinkHandle& self, double timeout) { return (*self).receive(timeout); }, nb::arg("timeout"))
      .def(
          "attend", [](LinkHandle& self, double timeout) { return (*self).attend(timeout); }, nb::arg("timeout"))
      .def("recall", [](LinkHandle& self) { (*self).recall(); })
      .def(
          "wait_unattended", [](LinkHandle& self, double timeout) { (*self).wait_unattended(timeout); },
          nb::arg("timeout"))
      .def("set_stamper", [](LinkHandle& self, nb::object stamper) { (*self).set_stamper(std::move(stamper)); })
      .def("changes", [](LinkHandle& self) { return (*self).changes(); })
      .def("line", [](LinkHandle& self) { return to_dict((*self).line()); })
      .def("stats", [](LinkHandle& self) { return (*self).stats(); })
      .def("recent", [](LinkHandle& self) { return (*self).recent(); })
      .def(
          "open_tap", [](LinkHandle& self, std::size_t capacity) { return (*self).open_tap(capacity); },
          nb::arg("capacity"))
      .def(
          "take_tap", [](LinkHandle& self, int tap) { return (*self).take_tap(tap); }, nb::arg("tap"))
      .def(
          "close_tap", [](LinkHandle& self, int tap) { (*self).close_tap(tap); }, nb::arg("tap"))
      .def(
          "note", [](LinkHandle& self, const std::string& text) { (*self).note(text); }, nb::arg("text"))
      .def("state", [](LinkHandle& self) { return (*self).state(); })
      .def("why", [](LinkHandle& self) { return (*self).why(); })
      .def("is_closed", [](LinkHandle& self) { return (*self).is_closed(); })
      .def("struck_deadlines", [](LinkHandle& self) { return (*self).struck_deadlines(); })
      .def(
          "recover_deadline", [](LinkHandle& self, std::uint8_t action) { (*self).recover_deadline(action); },
          nb::arg("action"))
      .def("begin_close",
           [](LinkHandle& self) {
             if (Link* const link = self.get()) link->begin_close();
           })
      .def("close",
           [](LinkHandle& self) {
             if (Link* const link = self.get()) link->close();  // a forked child has nothing to close
           })
      .def("after_fork", &LinkHandle::leave_in_child);
  m.def("end_of_interpreter", &WithoutGil::end_of_interpreter);
  m.def("settle_threads", &WithoutGil::settle);
  m.def("after_fork", &WithoutGil::after_fork);
}

}  // namespace wirebond::engine
