// Opens ttys: any baud rate, raw, low latency. Linux only; nothing here waits.
#pragma once

// termios2 supports any baud rate (BOTHER); <termios.h> would clash with these kernel headers.
#include <asm/ioctls.h>
#include <asm/termbits.h>
#include <fcntl.h>
#include <linux/serial.h>
#include <sys/file.h>
#include <sys/ioctl.h>

#include <cerrno>
#include <cstdint>
#include <string>

#include "wirebond/posix/descriptor.hpp"

namespace wirebond::posix {

enum class Parity : std::uint8_t { none, even, odd };

struct SerialSettings {
  std::uint32_t baud = 115200;  ///< bits per second
  std::uint8_t data_bits = 8;   ///< 5 to 8
  Parity parity = Parity::none;
  std::uint8_t stop_bits = 1;  ///< 1 or 2
};

/// The failed step and errno, for a sentence to the user.
struct SerialError {
  enum class Step : std::uint8_t { none, open, not_a_tty, busy, configure, baud } step = Step::none;
  int code = 0;
  std::uint32_t actual_baud = 0;  ///< step baud: the rate that the driver would use instead
};

/// A driver's reaction to the low-latency flag.
enum class LowLatency : std::uint8_t {
  not_offered,  ///< it has no such flags, as a pty
  refused,      ///< it refuses the flag, or accepts but does not keep it
  accepted,
};

/// Settings of an open tty, read back from its driver.
struct SerialReport {
  SerialSettings actual;
  bool is_exclusive = false;  ///< no other program that uses the lock has it open
  LowLatency low_latency = LowLatency::not_offered;
};

/// Read back the driver's settings; values that it does not report stay unchanged in `actual`.
inline void read_back(const struct termios2& tio, SerialSettings& actual) {
  constexpr std::uint8_t bits[] = {5, 6, 7, 8};
  if (tio.c_ospeed != 0) actual.baud = tio.c_ospeed;
  actual.data_bits = bits[(tio.c_cflag & CSIZE) / CS6];
  actual.stop_bits = (tio.c_cflag & CSTOPB) != 0 ? 2 : 1;
  actual.parity = (tio.c_cflag & PARENB) == 0 ? Parity::none : (tio.c_cflag & PARODD) != 0 ? Parity::odd : Parity::even;
}

/// Request low latency: the driver delivers bytes as they come. Nothing else depends on the answer.
inline LowLatency ask_for_low_latency(int fd) {
  struct serial_struct serial {};
  if (::ioctl(fd, TIOCGSERIAL, &serial) != 0) return LowLatency::not_offered;
  serial.flags |= ASYNC_LOW_LATENCY;
  if (::ioctl(fd, TIOCSSERIAL, &serial) != 0) return LowLatency::refused;
  struct serial_struct now {};
  const bool keeps = ::ioctl(fd, TIOCGSERIAL, &now) == 0 && (static_cast<unsigned>(now.flags) & ASYNC_LOW_LATENCY) != 0;
  return keeps ? LowLatency::accepted : LowLatency::refused;
}

/// Make the tty raw and set speed and format. Returns false and fills `error` on failure. `actual`: the resulting
/// settings.
inline bool configure_serial(int fd, const SerialSettings& settings, SerialError& error,
                             SerialSettings* actual = nullptr) {
  struct termios2 tio {};
  if (::ioctl(fd, TCGETS2, &tio) != 0) {
    error = {errno == ENOTTY ? SerialError::Step::not_a_tty : SerialError::Step::configure, errno, 0};
    return false;
  }
  constexpr tcflag_t sizes[] = {CS5, CS6, CS7, CS8};
  tio.c_iflag = 0;
  tio.c_oflag = 0;
  tio.c_lflag = 0;
  tio.c_cflag = CREAD | CLOCAL | BOTHER | (BOTHER << IBSHIFT) | sizes[(settings.data_bits - 5) & 3];
  if (settings.stop_bits == 2) tio.c_cflag |= CSTOPB;
  if (settings.parity != Parity::none) tio.c_cflag |= PARENB;
  if (settings.parity == Parity::odd) tio.c_cflag |= PARODD;
  tio.c_ispeed = settings.baud;
  tio.c_ospeed = settings.baud;
  tio.c_cc[VMIN] = 1;
  tio.c_cc[VTIME] = 0;
  if (::ioctl(fd, TCSETS2, &tio) != 0) {
    error = {SerialError::Step::configure, errno, 0};
    return false;
  }
  // A UART's divider rounds; beyond 3 % the other end would not understand (half the tolerance of 8N1 sampling).
  struct termios2 now {};
  if (::ioctl(fd, TCGETS2, &now) == 0 && now.c_ospeed != 0) {
    const std::uint64_t wanted = settings.baud;
    const std::uint64_t got = now.c_ospeed;
    const std::uint64_t difference = wanted > got ? wanted - got : got - wanted;
    if (difference * 100 > wanted * 3) {
      error = {SerialError::Step::baud, 0, static_cast<std::uint32_t>(got)};
      return false;
    }
    if (actual != nullptr) read_back(now, *actual);
  }
  return true;
}

/// The settings of an open tty. They are the device's: any program that opens it, such as `stty`, can change them.
class KeptSettings {
 public:
  /// Remember those of now.
  explicit KeptSettings(int fd) { is_known_ = ::ioctl(fd, TCGETS2, &settings_) == 0; }

  /// Put them back if another program has changed them. Returns whether one had.
  bool restore(int fd) const {
    struct termios2 now {};
    if (!is_known_ || ::ioctl(fd, TCGETS2, &now) != 0 || is_same(now, settings_)) return false;
    return ::ioctl(fd, TCSETS2, &settings_) == 0;
  }

 private:
  static bool is_same(const struct termios2& a, const struct termios2& b) {
    return a.c_iflag == b.c_iflag && a.c_oflag == b.c_oflag && a.c_lflag == b.c_lflag && a.c_cflag == b.c_cflag &&
           a.c_ispeed == b.c_ispeed && a.c_ospeed == b.c_ospeed;
  }

  struct termios2 settings_ {};
  bool is_known_ = false;
};

/// Open `path` as a raw, exclusive, non-blocking tty. Bytes that came before are dropped: they are stale. Adapters that
/// support it get the low-latency flag (FTDI: 1 ms instead of 16). Returns an empty Descriptor and `error` on failure.
/// `report`, if given: the driver's actual settings.
inline Descriptor open_serial(const std::string& path, const SerialSettings& settings, SerialError& error,
                              SerialReport* report = nullptr) {
  SerialReport unused;
  SerialReport& made = report != nullptr ? *report : unused;
  made = {settings, false, LowLatency::not_offered};
  Descriptor fd(::open(path.c_str(), O_RDWR | O_NOCTTY | O_NONBLOCK | O_CLOEXEC));
  if (!fd.is_open()) {
    error = {errno == EBUSY ? SerialError::Step::busy : SerialError::Step::open, errno, 0};
    return {};
  }
  if (!configure_serial(fd.get(), settings, error, &made.actual)) return {};
  // A lock rather than TIOCEXCL: it ends with its holder, even on a pty that stays open, and applies to root too.
  if (::flock(fd.get(), LOCK_EX | LOCK_NB) != 0) {
    error = {SerialError::Step::busy, errno, 0};
    return {};
  }
  made.is_exclusive = true;
  made.low_latency = ask_for_low_latency(fd.get());
  static_cast<void>(::ioctl(fd.get(), TCFLSH, TCIFLUSH));
  return fd;
}

/// Close what `open_serial` returned, so that it can be opened again at once. A process that was just forked has a copy
/// of the descriptor until it runs another program, and with it the lock.
inline void close_serial(Descriptor& fd) {
  if (fd.is_open()) static_cast<void>(::flock(fd.get(), LOCK_UN));
  fd.reset();
}

}  // namespace wirebond::posix
