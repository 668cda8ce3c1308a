// Time that stands still while the line does. No descriptor, no body.
#pragma once

#include <cstdint>

namespace host {

/// A UART takes its bytes, come what may; a pty waits for its reader, for as long as that likes, and this machine gives
/// the port's thread its turn when it likes. The link would break off what does not leave in time, as of a DMA that
/// hangs. With this clock nothing is lost by anybody's lateness. Not for firmwares with deadlines: they strike for
/// a peer that has gone, too.
template <class Link>
class LineClock {
 public:
  explicit LineClock(const Link& link) : link_(link) {}

  /// A millisecond has passed. False: but not here, for frames wait, and none has left since the last call.
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
