// A port over an open descriptor, for firmware that runs on a desk: one thread replaces the UART's interrupt.
#pragma once

#include <poll.h>
#include <sys/eventfd.h>
#include <unistd.h>

#include <atomic>
#include <cerrno>
#include <cstddef>
#include <cstdint>
#include <thread>

#include "wirebond/posix/descriptor.hpp"

namespace wirebond::posix {

/// Over a tty, a pty or a socket. Unlike an interrupt, the thread runs in parallel with the one that calls `poll`: a
/// program that works here also works on one core. As on a UART, nothing slows the other side down: a ring that is not
/// read in time is lapped.
class Port {
 public:
  /// `fd` is non-blocking and must outlive this object.
  explicit Port(int fd) : fd_(fd), wake_(::eventfd(0, EFD_CLOEXEC | EFD_NONBLOCK)) {}
  ~Port() { stop(); }
  Port(const Port&) = delete;
  Port& operator=(const Port&) = delete;

  /// Start the thread; it calls the events of `link`, which must outlive it or `stop`. Returns false if the system has
  /// no descriptor left. Throws std::system_error if it has no thread left.
  template <class Link>
  bool start(Link& link) {
    if (!wake_.is_open()) return false;
    ends_.store(false, std::memory_order_relaxed);
    thread_ = std::thread([this, &link] { serve(link); });
    return true;
  }

  /// End the thread. A run that is being sent is aborted.
  void stop() {
    ends_.store(true, std::memory_order_relaxed);
    pend();
    if (thread_.joinable()) thread_.join();
  }

  /// Return the errno that ended the thread: EIO if the other side is gone. 0: it works.
  int error() const { return error_.load(std::memory_order_relaxed); }

  // ---- the port; `start_receive` by the thread, and before its first success by another

  bool start_receive(std::uint8_t* ring, std::size_t size) {
    receiving_.store(false, std::memory_order_relaxed);
    ring_ = ring;
    size_ = size;
    place_.store(0, std::memory_order_release);         // pairs with `receive_position`
    receiving_.store(true, std::memory_order_release);  // pairs with `serve`
    wake();
    return true;
  }

  bool receiving() const { return receiving_.load(std::memory_order_relaxed); }

  /// Any thread.
  std::size_t receive_position() const { return place_.load(std::memory_order_acquire); }  // pairs with `receive`

  bool start_transmit(const std::uint8_t* bytes, std::size_t size) {
    if (left_ != 0) return false;
    next_ = bytes;
    left_ = size;
    return true;
  }

  void stop_transmit() { left_ = 0; }

  /// Any thread, any signal handler.
  void pend() {
    pended_.store(true, std::memory_order_release);  // pairs with `serve`
    wake();
  }

  bool reaches(const void*, std::size_t) const { return true; }

  static constexpr bool is_unpaced = true;       ///< a pty has no baud rate
  static constexpr bool tells_every_lap = true;  ///< there is no DMA that could lap unseen

 private:
  void wake() {
    const std::uint64_t one = 1;
    while (::write(wake_.get(), &one, sizeof one) < 0 && errno == EINTR) {
    }
  }

  template <class Link>
  void serve(Link& link) {
    while (!ends_.load(std::memory_order_relaxed)) {
      const bool receives = receiving_.load(std::memory_order_acquire);  // pairs with `start_receive`
      const short wanted = static_cast<short>((receives ? POLLIN : 0) | (left_ != 0 ? POLLOUT : 0));
      struct pollfd waiting[] = {{wake_.get(), POLLIN, 0},
                                 {wanted != 0 ? fd_ : -1, wanted, 0}};  // otherwise a hang-up would spin
      if (::poll(waiting, 2, -1) < 0 && errno != EINTR) return give_up(errno);
      std::uint64_t count;
      if (waiting[0].revents != 0 && ::read(wake_.get(), &count, sizeof count) < 0 && errno != EAGAIN) {
        return give_up(errno);
      }
      if (pended_.exchange(false, std::memory_order_acq_rel)) link.on_pended();  // pairs with `pend`
      if (receives && (waiting[1].revents & (POLLIN | POLLHUP | POLLERR)) != 0 && !receive(link)) return;
      if (left_ != 0 && (waiting[1].revents & POLLOUT) != 0 && !transmit(link)) return;
    }
  }

  template <class Link>
  bool receive(Link& link) {
    // At most half the ring, so that every turn of it is noticed.
    const std::size_t place = place_.load(std::memory_order_relaxed);
    const std::size_t room = size_ - place < size_ / 2 ? size_ - place : size_ / 2;
    const ssize_t size = ::read(fd_, ring_ + place, room);
    if (size < 0 && (errno == EAGAIN || errno == EINTR)) return true;
    if (size <= 0) return give_up(size == 0 ? EIO : errno), false;
    const std::size_t next = place + static_cast<std::size_t>(size);
    place_.store(next == size_ ? 0 : next, std::memory_order_release);  // pairs with `receive_position`
    link.on_received();
    return true;
  }

  template <class Link>
  bool transmit(Link& link) {
    const ssize_t size = ::write(fd_, next_, left_);
    if (size < 0 && (errno == EAGAIN || errno == EINTR)) return true;
    if (size < 0) return give_up(errno), false;
    next_ += size;
    left_ -= static_cast<std::size_t>(size);
    if (left_ == 0) link.on_transmitted();
    return true;
  }

  void give_up(int error) { error_.store(error, std::memory_order_relaxed); }

  int fd_;
  Descriptor wake_;
  std::thread thread_;
  std::atomic<bool> ends_{false};
  std::atomic<bool> pended_{false};
  std::atomic<bool> receiving_{false};
  std::atomic<int> error_{0};
  std::uint8_t* ring_ = nullptr;
  std::size_t size_ = 0;
  std::atomic<std::size_t> place_{0};
  const std::uint8_t* next_ = nullptr;  ///< these two are the thread's own
  std::size_t left_ = 0;
};

}  // namespace wirebond::posix
