// A UART with DMA on a simulated wire, without faults: a port for links under virtual time.
#pragma once

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <cstring>

#include "wirebond/sim/wire.hpp"

namespace wirebond::sim {

/// Provides the functions that Link needs from a port. Time passes in `run`, by whole runs and not byte by byte, so
/// hours of traffic take seconds. For interrupts in any order, errors and DMA that hangs see ports/fake. One thread.
///
/// The bytes of a run are taken when it starts. Received bytes are put into the ring when `run` reads them, and each
/// half of the ring raises an event, like the half and full events of a DMA; a reader that is too late is lapped.
class DmaUart {
 public:
  /// Receives from `in` and sends on `out`, whose restart gap each run costs. Both must outlive it.
  DmaUart(Wire& in, Wire& out) : in_(in), out_(out) {}

  // ---- the port

  bool start_receive(std::uint8_t* ring, std::size_t size) {
    ring_ = ring;
    size_ = size;
    place_ = 0;
    return true;
  }
  bool receiving() const { return ring_ != nullptr; }
  std::size_t receive_position() const { return place_; }

  bool start_transmit(const std::uint8_t* bytes, std::size_t size) {
    if (completes_at_ != never) return false;
    completes_at_ = out_.put(bytes, size, now_);
    run_ = bytes;
    run_bytes_ = size;
    runs_ += 1;
    return true;
  }
  void stop_transmit() { completes_at_ = never; }
  void pend() { pended_ = true; }
  bool reaches(const void*, std::size_t) const { return true; }

  // ---- time

  /// Return when a run ends; `never`: none is being sent.
  Time next() const { return pended_ ? now_ : completes_at_; }

  /// Set the time, and report all that happened since to the link, as its interrupts would. `left(bytes, size, end)` is
  /// called for each run given to the wire, with the time at which its last bit will have left.
  template <class Link, class Left>
  void run(Time now, Link& link, Left&& left) {
    now_ = now;
    receive(link);
    while (pended_ || completes_at_ <= now_) {
      const std::uint64_t runs = runs_;
      if (completes_at_ <= now_) {
        completes_at_ = never;
        link.on_transmitted();
      } else {
        pended_ = false;
        link.on_pended();
      }
      if (runs_ != runs) left(run_, run_bytes_, completes_at_);
    }
  }

  std::uint64_t runs() const { return runs_; }
  std::uint64_t events() const { return events_; }  ///< half and full

 private:
  template <class Link>
  void receive(Link& link) {
    if (ring_ == nullptr) {  // reception has not started
      in_.read(now_, [](const std::uint8_t*, std::size_t) {});
      return;
    }
    for (;;) {
      const std::size_t half = size_ / 2;
      const std::size_t room = place_ < half ? half - place_ : size_ - place_;
      const std::size_t size = in_.read(
          now_, [this](const std::uint8_t* bytes, std::size_t count) { std::memcpy(ring_ + place_, bytes, count); },
          room);
      place_ = place_ + size == size_ ? 0 : place_ + size;
      if (size < room) return;
      events_ += 1;
      link.on_received();
    }
  }

  Wire& in_;
  Wire& out_;
  Time now_ = 0;
  std::uint8_t* ring_ = nullptr;
  std::size_t size_ = 0;
  std::size_t place_ = 0;
  Time completes_at_ = never;
  const std::uint8_t* run_ = nullptr;
  std::size_t run_bytes_ = 0;
  bool pended_ = false;
  std::uint64_t runs_ = 0;
  std::uint64_t events_ = 0;
};

}  // namespace wirebond::sim
