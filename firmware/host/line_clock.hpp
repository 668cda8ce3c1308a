// A clock that stops while the line does. No descriptor, no body.
#pragma once

#include <cstdint>

namespace host {

/// The problem: a UART takes its bytes in any case; a pty waits for its reader for as long as that takes, and this
/// machine schedules the port's thread when it likes. The link would abort bytes that do not leave in time, as if DMA
/// hung.
///
/// The answer: this clock stops while frames wait and none leaves, so lateness loses nothing. Not for firmwares with
/// deadlines: those strike for a peer that has gone, too.
template <class Link>
class LineClock {
 public:
  explicit LineClock(const Link& link) : link_(link) {}

  /// Advance by a millisecond. Returns false, without advancing, if frames wait and none has left since the last call.
  bool advance() {
    const auto account = link_.send_account();
    const bool stands = account.queued != 0 && account.sent == sent_;
    sent_ = account.sent;
    if (!stands) now_us_ += 1000;
    return !stands;
  }

  std::uint32_t now_us() const { return now_us_; }

 private:
  const Link& link_;
  std::uint32_t sent_ = 0;
  std::uint32_t now_us_ = 0;
};

}  // namespace host
