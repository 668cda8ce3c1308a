// A supervised link over a tty: one native thread reads, deframes, timestamps, sends, repeats and reconnects.
#include "link.hpp"

#include <nanobind/stl/shared_ptr.h>
#include <nanobind/stl/string.h>
#include <nanobind/stl/vector.h>
#include <poll.h>
#include <sys/eventfd.h>
#include <time.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <chrono>
#include <cmath>
#include <cstring>

namespace wirebond::engine {

namespace {

constexpr std::uint64_t reopen_interval_us = 100'000;
constexpr std::uint64_t stale_after_us = 1'000'000;
constexpr std::uint64_t drain_on_close_us = 1'000'000;
constexpr std::size_t read_bytes = 4096;

/// CLOCK_MONOTONIC, the clock of Python's time.monotonic().
std::uint64_t monotonic_us() {
  timespec now{};
  ::clock_gettime(CLOCK_MONOTONIC, &now);
  return static_cast<std::uint64_t>(now.tv_sec) * 1'000'000 + static_cast<std::uint64_t>(now.tv_nsec) / 1000;
}

std::uint64_t to_us(double seconds) { return static_cast<std::uint64_t>(std::llround(seconds * 1e6)); }

std::vector<std::uint8_t> bytes_of(const nb::bytes& bytes) {
  const auto* const data = static_cast<const std::uint8_t*>(bytes.data());
  return {data, data + bytes.size()};
}

std::string sentence(const std::string& path, const posix::SerialSettings& settings, const posix::SerialError& error) {
  using Step = posix::SerialError::Step;
  const std::string reason = std::strerror(error.code);
  switch (error.step) {
    case Step::not_a_tty:
      return path + " is not a serial port (" + reason + "); give a tty such as /dev/ttyUSB0, /dev/ttyACM0 or a pty";
    case Step::busy:
      return path + " is in use by another program; close that one, or find it with `fuser " + path + "`";
    case Step::baud:
      return path + " cannot run at " + std::to_string(settings.baud) + " baud (its driver offers " +
             std::to_string(error.actual_baud) + "); choose a rate that the adapter knows";
    case Step::configure:
      return path + " refused the settings of the link (" + reason + "); check baud rate, parity and stop bits";
    case Step::open:
    case Step::none: break;
  }
  if (error.code == EACCES) {
    return "no permission to open " + path +
           "; add your user to the port's group (often `sudo usermod -aG dialout $USER`, then log in again)";
  }
  if (error.code == ENOENT)
    return "there is no port " + path + "; plug it in, or look for its name with `ls /dev/tty*`";
  return "cannot open " + path + ": " + reason;
}

/// `code`: the system's error number; 0 where it gave none.
[[noreturn]] void throw_port_error(const std::string& text, int code, const std::string& path) {
  const nb::object type = nb::module_::import_("wirebond.errors").attr("PortError");
  const nb::object number = code == 0 ? nb::object(nb::none()) : nb::object(nb::int_(code));
  PyErr_SetObject(type.ptr(), type(text, number, path).ptr());
  throw nb::python_error();
}

std::vector<std::array<DeadlineRule, 1>> one_by_one(const std::vector<DeadlineRule>& rules) {
  std::vector<std::array<DeadlineRule, 1>> tables;
  for (const DeadlineRule& rule : rules) tables.push_back({rule});
  return tables;
}

}  // namespace

Link::Link(std::shared_ptr<const ProtocolTable> protocol, std::shared_ptr<const FormatTable> receive, Options options,
           const std::vector<DeadlineRule>& deadlines)
    : protocol_(std::move(protocol)),
      format_(std::move(receive)),
      options_(std::move(options)),
      workspace_(workspace_bytes(format_->source())),
      deframer_(format_->source(), workspace_.data(), to_us(options_.idle_seconds)),
      counts_(protocol_->messages().size(), 0),
      deadline_rules_(one_by_one(deadlines)) {
  posix::SerialError error;
  port_ = posix::open_serial(options_.path, options_.serial, error);
  if (!port_.is_open()) {
    throw_port_error(sentence(options_.path, options_.serial, error), error.code, options_.path);
  }
  wakeup_ = posix::Descriptor(::eventfd(0, EFD_NONBLOCK | EFD_CLOEXEC));
  if (!wakeup_.is_open()) {
    const int code = errno;
    throw_port_error(std::string("the system has no event descriptor left: ") + std::strerror(code), code,
                     options_.path);
  }
  const std::uint64_t now = monotonic_us();
  for (const auto& rule : deadline_rules_) deadlines_.emplace_back(rule, now);
  thread_ = std::thread([this] { run(); });
}

Link::~Link() { close(); }

void Link::close() {
  std::thread thread;
  {
    const std::lock_guard lock(mutex_);
    thread.swap(thread_);  // of two callers one joins
    if (!closing_) {
      closing_ = true;
      close_by_us_ = monotonic_us() + drain_on_close_us;
      repeated_.clear();
    }
  }
  wake();
  arrived_.notify_all();
  if (!thread.joinable()) return;
  const nb::gil_scoped_release release;
  thread.join();
}

void Link::wake() const {
  const std::uint64_t one = 1;
  static_cast<void>(!::write(wakeup_.get(), &one, sizeof one));  // a full counter wakes as well
}

// ---- what programs call ----------------------------------------------------------------------------------------

int Link::send(nb::bytes frame, bool urgent, std::int16_t reply) {
  std::vector<std::uint8_t> bytes = bytes_of(frame);
  const nb::gil_scoped_release release;
  {
    const std::lock_guard lock(mutex_);
    account_.offered += 1;
    if (!port_.is_open() || closing_) {
      account_.refused_down += 1;
      return 1;
    }
    if (!enqueue({std::move(bytes), -1, reply}, urgent)) return 2;
    write_some();
  }
  wake();
  return 0;
}

void Link::repeat(std::size_t message, nb::bytes frame, nb::bytes safe, double period, double hold,
                  std::int16_t reply) {
  std::vector<std::uint8_t> bytes = bytes_of(frame);
  std::vector<std::uint8_t> safe_bytes = bytes_of(safe);
  {
    const std::lock_guard lock(mutex_);
    const std::uint64_t now = monotonic_us();
    auto entry =
        std::find_if(repeated_.begin(), repeated_.end(), [&](const Repeated& r) { return r.message == message; });
    if (entry == repeated_.end()) {
      repeated_.push_back({message, {}, {}, Periodic<std::uint64_t>(to_us(period), now), 0, reply});
      entry = repeated_.end() - 1;
    }
    entry->frame = std::move(bytes);
    entry->safe = std::move(safe_bytes);
    entry->lease_end_us = now + to_us(hold);
  }
  wake();
}

void Link::stop_repeating(std::size_t message) {
  const std::lock_guard lock(mutex_);
  repeated_.erase(
      std::remove_if(repeated_.begin(), repeated_.end(), [&](const Repeated& r) { return r.message == message; }),
      repeated_.end());
}

nb::list Link::receive(double timeout) {
  std::deque<Arrivals> taken;
  {
    const nb::gil_scoped_release release;
    std::unique_lock lock(mutex_);
    const auto wait = std::chrono::duration<double>(std::clamp(timeout, 0.0, 3600.0));
    arrived_.wait_for(lock, wait, [&] { return !arrivals_.empty() || thread_done_; });
    taken.swap(arrivals_);
    waiting_messages_ = 0;
  }
  nb::list out;
  for (const Arrivals& arrivals : taken) out.extend(to_list(arrivals.batch, arrivals.events));
  return out;
}

nb::dict Link::stats() {
  const std::lock_guard lock(mutex_);
  nb::dict send;
  send["offered"] = account_.offered;
  send["accepted"] = account_.accepted;
  send["refused_down"] = account_.refused_down;
  send["refused_full"] = account_.refused_full;
  send["sent"] = account_.sent;
  send["sent_bytes"] = account_.sent_bytes;
  send["queued"] = queue_.size();
  send["replaced"] = account_.replaced;
  send["expired"] = account_.expired;
  send["aborted"] = account_.aborted;
  nb::dict out = account_dict(deframer_.account(), deframer_.bytes(), deframer_.pending(), *protocol_, counts_);
  out["send"] = send;
  out["dropped_messages"] = dropped_messages_;
  out["reconnects"] = reconnects_;
  return out;
}

std::string Link::state() {
  const std::lock_guard lock(mutex_);
  if (!port_.is_open()) return "down";
  return last_frame_us_ != 0 && monotonic_us() - last_frame_us_ < stale_after_us ? "up" : "stale";
}

std::vector<std::uint8_t> Link::struck_deadlines() {
  const std::lock_guard lock(mutex_);
  std::vector<std::uint8_t> out;
  for (std::size_t i = 0; i < deadlines_.size(); ++i) {
    const std::uint8_t action = deadline_rules_[i][0].action;
    if (deadlines_[i].struck(action) && std::find(out.begin(), out.end(), action) == out.end()) out.push_back(action);
  }
  return out;
}

void Link::recover_deadline(std::uint8_t action) {
  const std::lock_guard lock(mutex_);
  for (auto& deadline : deadlines_) deadline.recover(action, monotonic_us());
}

// ---- the thread ------------------------------------------------------------------------------------------------

void Link::run() {
  std::unique_lock lock(mutex_);
  for (;;) {
    const std::uint64_t now = monotonic_us();
    if (closing_ && (!port_.is_open() || queue_.empty() || now >= close_by_us_)) break;
    pollfd watched[2] = {{wakeup_.get(), POLLIN, 0}, {-1, 0, 0}};
    if (port_.is_open()) {
      watched[1].fd = port_.get();
      watched[1].events = static_cast<short>(POLLIN | (queue_.empty() ? 0 : POLLOUT));
    }
    const int wait = wait_ms(now);
    lock.unlock();
    ::poll(watched, 2, wait);
    lock.lock();
    std::uint64_t ignored;
    static_cast<void>(!::read(wakeup_.get(), &ignored, sizeof ignored));
    if (port_.is_open()) {
      read_some();
    } else {
      try_reopen(monotonic_us());
    }
    const std::uint64_t later = monotonic_us();
    run_deadlines(later);
    run_repeated(later);
    if (port_.is_open()) write_some();
  }
  go_down();
  thread_done_ = true;
  arrived_.notify_all();
}

int Link::wait_ms(std::uint64_t now_us) const {
  std::uint64_t wake_us = now_us + 500'000;
  const auto by = [&](std::uint64_t when) { wake_us = std::min(wake_us, std::max(when, now_us)); };
  if (!port_.is_open()) by(next_open_us_);
  if (deframer_.pending() != 0) by(last_byte_us_ + deframer_.idle_us());
  for (const Repeated& entry : repeated_) by(std::min(entry.rhythm.next_us(), entry.lease_end_us));
  if (!deadlines_.empty()) by(now_us + 10'000);
  return static_cast<int>((wake_us - now_us + 999) / 1000);
}

void Link::read_some() {
  std::uint8_t chunk[read_bytes];
  const std::uint64_t began_us = monotonic_us();
  const ssize_t got = ::read(port_.get(), chunk, sizeof chunk);
  Arrivals arrivals;
  const auto sink = [&](const Frame& frame) { take(frame, began_us, arrivals); };
  if (got > 0) {
    last_byte_us_ = monotonic_us();
    deframer_.feed(chunk, static_cast<std::size_t>(got), last_byte_us_, sink);
  } else if (got < 0 && (errno == EAGAIN || errno == EINTR)) {
    if (errno == EAGAIN) deframer_.idle(began_us, sink);
  } else {  // 0 is a hang-up; EIO, ENXIO and others a device that went away
    deframer_.give_up(sink);
    go_down();
  }
  publish(std::move(arrivals));
}

void Link::take(const Frame& frame, std::uint64_t now_us, Arrivals& arrivals) {
  if (arrivals.batch == nullptr) {
    arrivals.batch = std::make_shared<Batch>();
    arrivals.batch->protocol = protocol_;
    arrivals.batch->format = format_;
  }
  last_frame_us_ = now_us;
  if (frame.message >= 0) {
    ++counts_[static_cast<std::size_t>(frame.message)];
    for (auto& deadline : deadlines_) deadline.seen(frame.message, now_us);
  }
  arrivals.events.push_back(record(frame, static_cast<double>(now_us) * 1e-6, *arrivals.batch));
}

void Link::publish(Arrivals&& arrivals) {
  if (arrivals.events.empty()) return;
  waiting_messages_ += arrivals.events.size();
  arrivals_.push_back(std::move(arrivals));
  while (waiting_messages_ > max_waiting_messages && arrivals_.size() > 1) {  // nobody reads: the newest matter more
    waiting_messages_ -= arrivals_.front().events.size();
    dropped_messages_ += arrivals_.front().events.size();
    arrivals_.pop_front();
  }
  arrived_.notify_all();
}

bool Link::enqueue(Outgoing outgoing, bool urgent) {
  const std::size_t size = outgoing.bytes.size();
  if (outgoing.repeated >= 0) {  // an older value of the message that has not begun to leave is worth nothing now
    for (std::size_t i = written_of_first_ != 0 ? 1 : 0; i < queue_.size(); ++i) {
      if (queue_[i].repeated != outgoing.repeated) continue;
      queued_bytes_ += size;
      queued_bytes_ -= queue_[i].bytes.size();
      queue_[i] = std::move(outgoing);
      account_.accepted += 1;
      account_.replaced += 1;
      return true;
    }
  }
  if (!urgent && queued_bytes_ + size > max_queued_bytes) {
    account_.refused_full += 1;
    return false;
  }
  account_.accepted += 1;
  queued_bytes_ += size;
  if (urgent) {  // behind the frame that is leaving already, before all others
    queue_.insert(queue_.begin() + (written_of_first_ != 0 ? 1 : 0), std::move(outgoing));
  } else {
    queue_.push_back(std::move(outgoing));
  }
  return true;
}

void Link::write_some() {
  while (!queue_.empty()) {
    const std::vector<std::uint8_t>& first = queue_.front().bytes;
    // Before its first byte leaves: no answer can come earlier. Messages without a reply change nothing.
    if (written_of_first_ == 0 && queue_.front().reply >= 0) deframer_.expect(queue_.front().reply);
    const ssize_t done = ::write(port_.get(), first.data() + written_of_first_, first.size() - written_of_first_);
    if (done < 0) {
      if (errno != EAGAIN && errno != EINTR) go_down();
      return;
    }
    written_of_first_ += static_cast<std::size_t>(done);
    account_.sent_bytes += static_cast<std::uint64_t>(done);
    if (written_of_first_ < first.size()) return;
    queued_bytes_ -= first.size();
    written_of_first_ = 0;
    account_.sent += 1;
    queue_.pop_front();
  }
}

void Link::run_repeated(std::uint64_t now_us) {
  for (std::size_t i = 0; i < repeated_.size();) {
    Repeated& entry = repeated_[i];
    const bool over = now_us >= entry.lease_end_us;
    if (over || entry.rhythm.due(now_us)) {
      std::vector<std::uint8_t> bytes = over ? entry.safe : entry.frame;
      if (!bytes.empty()) {
        account_.offered += 1;
        if (!port_.is_open()) {
          account_.refused_down += 1;
        } else {
          static_cast<void>(enqueue({std::move(bytes), static_cast<int>(entry.message), entry.reply}, false));
        }
      }
    }
    if (over) {
      repeated_.erase(repeated_.begin() + static_cast<std::ptrdiff_t>(i));
    } else {
      ++i;
    }
  }
}

void Link::run_deadlines(std::uint64_t now_us) {
  for (auto& deadline : deadlines_) {
    deadline.poll(now_us, [](std::uint8_t) {});  // struck_deadlines() tells
  }
}

void Link::go_down() {
  port_.reset();
  deframer_.expect(-1);  // what was asked is not answered any more
  for (std::size_t i = 0; i < queue_.size(); ++i) {
    (i == 0 && written_of_first_ != 0 ? account_.aborted : account_.expired) += 1;
  }
  queue_.clear();
  queued_bytes_ = 0;
  written_of_first_ = 0;
  next_open_us_ = monotonic_us() + reopen_interval_us;
}

void Link::try_reopen(std::uint64_t now_us) {
  if (closing_ || now_us < next_open_us_) return;
  next_open_us_ = now_us + reopen_interval_us;
  posix::SerialError error;
  port_ = posix::open_serial(options_.path, options_.serial, error);
  if (port_.is_open()) reconnects_ += 1;
}

// ---- binding ---------------------------------------------------------------------------------------------------

void bind_link(nb::module_& m) {
  nb::class_<Link>(m, "Link")
      .def(
          "__init__",
          [](Link* self, std::shared_ptr<const ProtocolTable> protocol, std::shared_ptr<const FormatTable> receive,
             const std::string& path, std::uint32_t baud, unsigned data_bits, const std::string& parity,
             unsigned stop_bits, double idle_seconds, nb::list deadlines) {
            Link::Options options;
            options.path = path;
            options.idle_seconds = idle_seconds;
            options.serial.baud = baud;
            options.serial.data_bits = static_cast<std::uint8_t>(data_bits);
            options.serial.parity = parity == "even"  ? posix::Parity::even
                                    : parity == "odd" ? posix::Parity::odd
                                                      : posix::Parity::none;
            options.serial.stop_bits = static_cast<std::uint8_t>(stop_bits);
            std::vector<DeadlineRule> rules;
            for (nb::handle rule : deadlines) {
              rules.push_back({nb::cast<std::int16_t>(rule[0]), nb::cast<std::uint32_t>(rule[1]),
                               nb::cast<std::uint8_t>(rule[2]),
                               nb::cast<bool>(rule[3]) ? Recover::explicit_call : Recover::next_message});
            }
            new (self) Link(std::move(protocol), std::move(receive), std::move(options), rules);
          },
          nb::arg("protocol"), nb::arg("receive"), nb::arg("path"), nb::arg("baud"), nb::arg("data_bits"),
          nb::arg("parity"), nb::arg("stop_bits"), nb::arg("idle_seconds"), nb::arg("deadlines"))
      .def("send", &Link::send, nb::arg("frame"), nb::arg("urgent"), nb::arg("reply"))
      .def("repeat", &Link::repeat, nb::arg("message"), nb::arg("frame"), nb::arg("safe"), nb::arg("period"),
           nb::arg("hold"), nb::arg("reply"))
      .def("stop_repeating", &Link::stop_repeating, nb::arg("message"))
      .def("receive", &Link::receive, nb::arg("timeout"))
      .def("stats", &Link::stats)
      .def("state", &Link::state)
      .def("struck_deadlines", &Link::struck_deadlines)
      .def("recover_deadline", &Link::recover_deadline, nb::arg("action"))
      .def("close", &Link::close);
}

}  // namespace wirebond::engine
