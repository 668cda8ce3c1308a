// A value of which only the newest waits, repeated while its writer lives or sent once: rhythm, end, bytes. No queue.
#pragma once

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <cstring>

#include "wirebond/deadline.hpp"

namespace wirebond {

/// One message of the host that may be repeated, or of which only the newest frame waits (`keeps_latest`), to one
/// address if frames have them. The caller owns the memory. Time is in microseconds and does not wrap. One thread at a
/// time.
class Lease {
 public:
  Lease() = default;
  /// `every_us`: the message's rhythm; 0: none, so it cannot be repeated. `room`: memory for its largest frame.
  /// `keeps_latest`: also of frames sent once only the newest waits.
  Lease(std::uint64_t every_us, std::uint8_t* room, std::size_t capacity, bool keeps_latest = false)
      : every_us_(every_us), room_(room), capacity_(capacity), keeps_latest_(keeps_latest) {}

  /// Assign this lease to a message and address. Only while it is idle.
  void assign(std::int16_t message, std::uint64_t address, std::uint64_t every_us) {
    message_ = message;
    address_ = address;
    every_us_ = every_us;
  }

  bool can_hold(std::size_t size) const { return size != 0 && size <= capacity_; }
  bool can_repeat(std::size_t size) const { return every_us_ != 0 && can_hold(size); }
  bool keeps_latest() const { return keeps_latest_; }
  bool is_alive() const { return is_alive_; }
  bool is_idle() const { return !is_alive_ && !waits; }
  bool is_of(std::int16_t message, std::uint64_t address) const {
    return !is_idle() && message_ == message && address_ == address;
  }
  std::int16_t message() const { return message_; }
  std::uint64_t address() const { return address_; }
  std::uint64_t every_us() const { return every_us_; }

  /// Begin or continue to repeat this value, until `end_us`. `takes_number`: each repetition gets its own number.
  void renew(const std::uint8_t* frame, std::size_t size, std::int16_t reply, bool takes_number, std::uint64_t end_us,
             std::uint64_t now_us) {
    hold(frame, size, reply, takes_number, now_us);
    end_us_ = end_us;
    if (!is_alive_) rhythm_ = Periodic<std::uint64_t>(every_us_, now_us);
    is_alive_ = true;
  }
  void end() { is_alive_ = false; }

  /// Store these bytes as the newest.
  void hold(const std::uint8_t* frame, std::size_t size, std::int16_t reply, bool takes_number, std::uint64_t now_us) {
    std::memcpy(room_, frame, size);
    size_ = size;
    reply_ = reply;
    takes_number_ = takes_number;
    held_since_us_ = now_us;
  }
  std::uint64_t held_since_us() const { return held_since_us_; }

  bool is_over(std::uint64_t now_us) const { return is_alive_ && now_us >= end_us_; }
  bool is_due(std::uint64_t now_us) { return is_alive_ && rhythm_.due(now_us); }
  std::uint64_t next_us() const { return std::min(end_us_, rhythm_.next_us()); }

  const std::uint8_t* frame() const { return room_; }
  std::size_t size() const { return size_; }
  std::int16_t reply() const { return reply_; }
  bool takes_number() const { return takes_number_; }

  bool waits = false;  ///< it has a place in the queue

 private:
  std::uint64_t every_us_ = 0;
  std::uint8_t* room_ = nullptr;
  std::size_t capacity_ = 0;
  std::size_t size_ = 0;
  std::uint64_t end_us_ = 0;
  std::uint64_t held_since_us_ = 0;
  std::uint64_t address_ = 0;
  Periodic<std::uint64_t> rhythm_{1, 0};
  std::int16_t message_ = -1;
  std::int16_t reply_ = -1;
  bool takes_number_ = false;
  bool is_alive_ = false;
  bool keeps_latest_ = false;
};

/// One message of the file's `emergency_stop`, with the values that stop; it is also the safe value that ends a lease.
/// Where frames have addresses there is one for each address that the message was sent to.
class SafeValue {
 public:
  SafeValue() = default;
  /// `frame` must outlive this object. `every_us`: how often a stop repeats it, not 0. `is_in_stop`: a stop sends it;
  /// otherwise it only ends leases, because another safe value of its message reaches every address.
  SafeValue(std::int16_t message, std::uint64_t address, const std::uint8_t* frame, std::size_t size,
            std::int16_t reply, std::uint64_t every_us, bool is_in_stop)
      : frame_(frame),
        size_(size),
        every_us_(every_us),
        address_(address),
        message_(message),
        reply_(reply),
        is_in_stop_(is_in_stop) {}

  std::uint64_t address() const { return address_; }
  bool is_in_stop() const { return is_in_stop_; }
  std::int16_t message() const { return message_; }
  const std::uint8_t* frame() const { return frame_; }
  std::size_t size() const { return size_; }
  std::int16_t reply() const { return reply_; }

  /// Note that a stop was sent at `now_us`; the next one is due after `every`.
  void begin_repeating(std::uint64_t now_us) { rhythm_ = Periodic<std::uint64_t>(every_us_, now_us + every_us_); }
  bool is_due(std::uint64_t now_us) { return rhythm_.due(now_us); }
  std::uint64_t next_us() const { return rhythm_.next_us(); }

  bool waits = false;  ///< it leaves before all that is queued
  bool moved = false;  ///< its message was accepted for this address after this value was last offered

 private:
  const std::uint8_t* frame_ = nullptr;
  std::size_t size_ = 0;
  std::uint64_t every_us_ = 1;
  std::uint64_t address_ = 0;
  Periodic<std::uint64_t> rhythm_{1, 0};
  std::int16_t message_ = -1;
  std::int16_t reply_ = -1;
  bool is_in_stop_ = true;
};

}  // namespace wirebond
