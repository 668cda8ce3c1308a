// A host's line that echoes: own frames are kept until they are heard or given up. Bytes and times: no frame, no port.
#pragma once

#include <cstddef>
#include <cstdint>

#include "wirebond/echo.hpp"

namespace wirebond {

/// `Echo` with times, and with counts that do not wrap. Time is in microseconds. One thread at a time.
class HostEcho {
 public:
  static constexpr std::uint64_t never = ~std::uint64_t{0};

  /// `memory`: the caller's, a power of two bytes, large enough for the largest frame. A frame is given up when nothing
  /// of it was heard for `timeout_us`: longer than a frame takes, and longer than the port may hold bytes back.
  HostEcho(std::uint8_t* memory, std::size_t size, std::uint64_t timeout_us)
      : echo_(memory, size), timeout_us_(timeout_us) {}

  /// Expect a frame that is about to leave. Returns false if the memory is full: give up first.
  bool sent(const std::uint8_t* frame, std::size_t size, std::uint64_t now_us) {
    if (!echo_.waits()) since_us_ = now_us;
    if (!echo_.keep(frame, size)) return false;
    echo_.sent();
    return true;
  }

  /// Take received bytes; calls `pass(bytes, size)` for those of others.
  template <class Pass>
  void hear(const std::uint8_t* bytes, std::size_t size, std::uint64_t now_us, Pass&& pass) {
    const Echo::Count before = echo_.progress();
    echo_.hear(bytes, size, pass);
    if (echo_.progress() != before) since_us_ = now_us;
    count();
  }

  /// When part of an expected frame was last heard, or when it was sent.
  std::uint64_t since_us() const { return since_us_; }
  /// When `give_up` is due; `never`: nothing is expected.
  std::uint64_t due_us() const { return echo_.waits() ? since_us_ + timeout_us_ : never; }

  /// Give up the frames that were not heard, a collision each, and pass on the bytes held back.
  template <class Pass>
  void give_up(Pass&& pass) {
    echo_.give_up(pass);
    count();
  }

  /// Expect nothing any more: the port is closed.
  void forget() {
    echo_.forget();
    count();
  }

  /// Check whether bytes are held back because they may be own ones.
  bool holds() const { return echo_.held() != 0; }
  std::uint64_t echoed() const { return echoed_; }          ///< own bytes heard
  std::uint64_t collisions() const { return collisions_; }  ///< frames not heard as they were sent

 private:
  void count() {
    echoed_ += static_cast<Echo::Count>(echo_.echoed() - counted_echoed_);
    collisions_ += static_cast<Echo::Count>(echo_.collisions() - counted_collisions_);
    counted_echoed_ = echo_.echoed();
    counted_collisions_ = echo_.collisions();
  }

  Echo echo_;
  std::uint64_t timeout_us_;
  std::uint64_t since_us_ = 0;  ///< since when nothing of an expected frame was heard
  std::uint64_t echoed_ = 0;
  std::uint64_t collisions_ = 0;
  Echo::Count counted_echoed_ = 0;
  Echo::Count counted_collisions_ = 0;
};

}  // namespace wirebond
