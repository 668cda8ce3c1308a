// A port and a clock for firmware under virtual time: time passes only when the firmware requests it.
#pragma once

#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <cstddef>
#include <cstdint>
#include <cstdlib>
#include <cstring>
#include <string>

namespace wirebond::posix {

/// The firmware states until when it would sleep, and its driver answers with the new time: that one, or an earlier one
/// because bytes came. So nothing depends on this machine's speed, and the same bytes at the same times give the same
/// run.
///
/// The protocol, a line for each message, over two descriptors; numbers are microseconds since the start, bytes hex
/// digits:
///     w UNTIL BYTES   from the firmware: it sleeps until then; these bytes have left since its last line
///     e TIME TEXT     from the firmware: an event, for a person
///     t TIME BYTES    to the firmware: it is TIME, at most UNTIL; these bytes have come
///     l TEXT          to the firmware: a line of its operator; the answer to `w` still follows
///
/// Bytes leave at the line's pace. The driver gets them when their run has left, or when the firmware requests time
/// before that. Interrupts come in `wait`, at their time. One thread.
class Lockstep {
 public:
  /// `bits_per_byte`: including start, parity and stop bits. The descriptors block and must outlive this object.
  Lockstep(int in, int out, std::uint32_t baud, unsigned bits_per_byte)
      : in_(in), out_(out), baud_(baud), bits_per_byte_(bits_per_byte) {}
  Lockstep(const Lockstep&) = delete;
  Lockstep& operator=(const Lockstep&) = delete;

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
    if (run_bytes_ != 0) return false;
    run_ = bytes;
    run_bytes_ = size;
    told_ = 0;
    begun_us_ = now_us_;
    return true;
  }
  void stop_transmit() { run_bytes_ = 0; }
  void pend() { pended_ = true; }
  bool reaches(const void*, std::size_t) const { return true; }
  /// The link stamps received bytes with it.
  std::uint32_t now_us() const { return static_cast<std::uint32_t>(now_us_); }

  static constexpr bool is_unpaced = true;       ///< a simulation may send at any speed
  static constexpr bool tells_every_lap = true;  ///< there is an event for each half of the ring

  // ---- time

  std::uint64_t time_us() const { return now_us_; }

  /// Sleep until then; until it returns, the link's interrupts come, and `obey(line)` is called for each line of the
  /// operator. Returns false if the driver has gone.
  template <class Link, class Obey>
  bool wait(std::uint64_t until_us, Link& link, Obey&& obey) {
    serve(link);
    while (now_us_ < until_us) {
      const std::uint64_t next_us = run_bytes_ == 0 ? until_us : std::min(until_us, end_of(run_bytes_));
      if (!ask(next_us)) return false;
      std::string line;
      while (read_line(line) && line.compare(0, 2, "l ") == 0) obey(line.substr(2));
      if (line.compare(0, 2, "t ") != 0) return false;
      char* rest = nullptr;
      const std::uint64_t told_us = std::strtoull(line.c_str() + 2, &rest, 10);
      now_us_ = std::min(std::max(told_us, now_us_), next_us);
      receive(rest, link);
      serve(link);
    }
    return true;
  }

  /// Report one line to a person.
  void report(const char* text) { write("e " + std::to_string(now_us_) + ' ' + text + '\n'); }

 private:
  /// Return when this many bytes of the run have left.
  std::uint64_t end_of(std::size_t bytes) const {
    return begun_us_ + (std::uint64_t{bytes} * bits_per_byte_ * 1'000'000 + baud_ - 1) / baud_;
  }

  template <class Link>
  void serve(Link& link) {
    while (pended_ || (run_bytes_ != 0 && end_of(run_bytes_) <= now_us_)) {
      if (pended_) {
        pended_ = false;
        link.on_pended();
      } else {
        note_left();
        run_bytes_ = 0;
        link.on_transmitted();
      }
    }
  }

  /// Note the bytes of the run whose last bit has left: the next line reports them.
  void note_left() {
    while (told_ < run_bytes_ && end_of(told_ + 1) <= now_us_) {
      static const char digits[] = "0123456789abcdef";
      left_ += digits[run_[told_] >> 4];
      left_ += digits[run_[told_] & 15];
      ++told_;
    }
  }

  bool ask(std::uint64_t until_us) {
    note_left();
    const bool is_written = write("w " + std::to_string(until_us) + ' ' + left_ + '\n');
    left_.clear();
    return is_written;
  }

  template <class Link>
  void receive(const char* hex, Link& link) {
    if (ring_ == nullptr || hex == nullptr) return;
    while (*hex == ' ') ++hex;
    for (; hex[0] != 0 && hex[1] != 0; hex += 2) {
      const char pair[] = {hex[0], hex[1], 0};
      ring_[place_] = static_cast<std::uint8_t>(std::strtoul(pair, nullptr, 16));
      place_ = place_ + 1 == size_ ? 0 : place_ + 1;
      if (place_ == 0 || place_ == size_ / 2 || hex[2] == 0) link.on_received();
    }
  }

  bool write(const std::string& text) {
    for (std::size_t done = 0; done < text.size();) {
      const ssize_t size = ::write(out_, text.data() + done, text.size() - done);
      if (size < 0 && errno != EINTR) return false;
      done += size < 0 ? 0 : static_cast<std::size_t>(size);
    }
    return true;
  }

  /// Read a line, without its end. Returns false if the driver has gone.
  bool read_line(std::string& line) {
    std::size_t end = 0;
    while ((end = came_.find('\n')) == std::string::npos) {
      char chunk[4096];
      const ssize_t size = ::read(in_, chunk, sizeof chunk);
      if (size < 0 && errno == EINTR) continue;
      if (size <= 0) return line.clear(), false;
      came_.append(chunk, static_cast<std::size_t>(size));
    }
    line = came_.substr(0, end);
    came_.erase(0, end + 1);
    return true;
  }

  int in_;
  int out_;
  std::uint32_t baud_;
  unsigned bits_per_byte_;
  std::uint64_t now_us_ = 0;
  std::uint8_t* ring_ = nullptr;
  std::size_t size_ = 0;
  std::size_t place_ = 0;
  const std::uint8_t* run_ = nullptr;
  std::size_t run_bytes_ = 0;  ///< 0: none is being sent
  std::size_t told_ = 0;       ///< how many of them were noted as left
  std::uint64_t begun_us_ = 0;
  bool pended_ = false;
  std::string left_;  ///< hex digits of bytes that have left and are not reported yet
  std::string came_;
};

}  // namespace wirebond::posix
