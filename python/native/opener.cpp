// Opens a tty or a TCP connection, with a sentence for each failure.
#include "opener.hpp"

#include <fcntl.h>
#include <netdb.h>
#include <sys/socket.h>
#include <unistd.h>

#include <cerrno>
#include <cstring>
#include <utility>

#include "pty_number.hpp"
#include "wirebond/posix/tcp.hpp"

namespace wirebond::engine {

namespace {

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
  if (error.code == EISDIR)
    return path + " is a folder, and a serial port is expected; give a tty such as /dev/ttyUSB0, /dev/ttyACM0 or a pty";
  return "cannot open " + path + ": " + reason + "; check its name with `ls -l " + path + "`";
}

class SerialOpener final : public Opener {
 public:
  SerialOpener(std::string path, const posix::SerialSettings& settings, std::string root)
      : path_(std::move(path)), settings_(settings), root_(std::move(root)) {}

  posix::Descriptor open(const std::atomic<bool>&, PortProblem& problem) override {
    posix::Descriptor kept;
    if (!is_ours(kept, problem)) return {};
    posix::SerialError error;
    posix::LatencyTimer timer = posix::latency_timer(path_, root_);  // read before the low-latency flag changes it
    posix::SerialReport report;
    posix::Descriptor port = posix::open_serial(path_, settings_, error, &report);
    if (!port.is_open()) {
      problem = {sentence(path_, settings_, error), error.code};
      return port;
    }
    pty_.remember(path_);
    kept_.emplace(port.get());
    posix::set_latency_timer(timer);
    line_ = LineReport{settings_.baud, report, std::move(timer)};
    return port;
  }

  std::string name() const override { return path_; }

  ssize_t write(int descriptor, const std::uint8_t* bytes, std::size_t size) const override {
    return ::write(descriptor, bytes, size);
  }

  std::string why_gone(int code) const override {
    return path_ + " went away (" + (code == 0 ? "hang-up" : std::strerror(code)) +
           "); plug it in again, or look at the output of `dmesg`";
  }

  std::string path() const override { return path_; }
  std::optional<LineReport> line() const override { return line_; }
  bool restore_settings(int descriptor) const override { return kept_ && kept_->restore(descriptor); }

 private:
  /// Refuse another program's terminal. An open pty keeps its number: without `kept`, another program could get it
  /// between this check and the opening.
  bool is_ours(posix::Descriptor& kept, PortProblem& problem) {
    if (!pty_.is_a_strangers(path_)) {
      if (!pty_.is_known()) return true;
      kept = posix::Descriptor(::open(path_.c_str(), O_RDWR | O_NOCTTY | O_NONBLOCK | O_CLOEXEC));
      if (!kept.is_open()) {
        const posix::SerialError error{posix::SerialError::Step::open, errno};
        problem = {sentence(path_, settings_, error), error.code};
        return false;
      }
      if (!pty_.is_a_strangers(path_)) return true;
    }
    problem = {path_ +
                   " is another program's terminal now, because a pty's number is given away when it ends; "
                   "open the new pty by its own name, or use a link to it that stays (wirebond sim --link NAME)",
               0};
    return false;
  }

  std::string path_;
  posix::SerialSettings settings_;
  PtyNumber pty_;
  std::string root_;
  std::optional<LineReport> line_;
  std::optional<posix::KeptSettings> kept_;  ///< of the port opened last
};

class MovingSerialOpener final : public Opener {
 public:
  MovingSerialOpener(std::string name, Resolve resolve, const posix::SerialSettings& settings, std::string root)
      : name_(std::move(name)), resolve_(std::move(resolve)), settings_(settings), root_(std::move(root)) {}

  std::string name() const override { return name_; }

  posix::Descriptor open(const std::atomic<bool>& cancelled, PortProblem& problem) override {
    const std::string path = resolve_(problem);
    if (path.empty()) return {};
    at_ = serial_opener(path, settings_, root_);
    return at_->open(cancelled, problem);
  }

  ssize_t write(int descriptor, const std::uint8_t* bytes, std::size_t size) const override {
    return ::write(descriptor, bytes, size);
  }

  std::string why_gone(int code) const override { return name_ + ": " + at_->why_gone(code); }

  std::string path() const override { return "/dev/" + name_; }
  bool restore_settings(int descriptor) const override { return at_ != nullptr && at_->restore_settings(descriptor); }
  std::optional<LineReport> line() const override { return at_ == nullptr ? std::nullopt : at_->line(); }

 private:
  std::string name_;
  Resolve resolve_;
  posix::SerialSettings settings_;
  std::string root_;
  std::unique_ptr<Opener> at_;  ///< where it was last found
};

class TcpOpener final : public Opener {
 public:
  TcpOpener(std::string name, std::string host, std::string port)
      : name_(std::move(name)), host_(std::move(host)), port_(std::move(port)) {}

  posix::Descriptor open(const std::atomic<bool>& cancelled, PortProblem& problem) override {
    posix::TcpError error;
    posix::Descriptor port = posix::open_tcp(host_, port_, cancelled, error);
    if (!port.is_open()) problem = problem_of(error);
    return port;
  }

  std::string name() const override { return name_; }

  ssize_t write(int descriptor, const std::uint8_t* bytes, std::size_t size) const override {
    return ::send(descriptor, bytes, size, MSG_NOSIGNAL);
  }

  std::string why_gone(int code) const override {
    if (code == 0) return name_ + " closed the connection; look at the log of its server";
    return "the connection to " + name_ + " broke (" + std::strerror(code) + "); look at the network and the server";
  }

 private:
  PortProblem problem_of(const posix::TcpError& error) const {
    if (error.step == posix::TcpError::Step::name) {
      return {"the name of " + name_ + " cannot be found (" + ::gai_strerror(error.code) +
                  "); check its spelling, or give an address such as 192.168.1.20",
              0};
    }
    switch (error.code) {
      case ECONNREFUSED:
        return {"nothing listens at " + name_ + "; start the server there, or check the port's number", error.code};
      case ETIMEDOUT:
        return {name_ + " does not answer within " + std::to_string(posix::tcp_answer_ms / 1000) +
                    " s; check that it is switched on, its address, and the firewall between",
                error.code};
      default:
        return {"cannot connect to " + name_ + ": " + std::strerror(error.code) + "; check its address and the network",
                error.code};
    }
  }

  std::string name_;
  std::string host_;
  std::string port_;
};

}  // namespace

std::unique_ptr<Opener> serial_opener(std::string path, const posix::SerialSettings& settings, std::string root) {
  return std::make_unique<SerialOpener>(std::move(path), settings, std::move(root));
}

std::unique_ptr<Opener> moving_serial_opener(std::string name, Resolve resolve, const posix::SerialSettings& settings,
                                             std::string root) {
  return std::make_unique<MovingSerialOpener>(std::move(name), std::move(resolve), settings, std::move(root));
}

std::unique_ptr<Opener> tcp_opener(std::string name, std::string host, std::string port) {
  return std::make_unique<TcpOpener>(std::move(name), std::move(host), std::move(port));
}

}  // namespace wirebond::engine
