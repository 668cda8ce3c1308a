// The host at the other end of the simulated line: sends numbered commands, knows which of them came whole into the
// MCU's memory, and reads the MCU's reports. Everything that the tests of Link compare with is worked out here.
#pragma once

#include <doctest/doctest.h>

#include <array>
#include <cstdint>
#include <deque>
#include <vector>

#include "wirebond/fake/line.hpp"
#include "wirebond/format.hpp"
#include "wirebond/mcu/receive_ring.hpp"
#include "wirebond/receiver.hpp"
#include "wirebond/status.hpp"

template <class Wire>
class Peer {
 public:
  using Time = wirebond::fake::Time;
  using Line = wirebond::fake::Line;
  using Fate = wirebond::fake::Fate;

  Peer(Line& to_mcu, Line& from_mcu) : to_mcu_(to_mcu), from_mcu_(from_mcu) {}

  static constexpr std::size_t smallest_frame = Wire::Command::Info::min_payload_bytes + 2;
  static constexpr std::size_t largest_frame = wirebond::max_wire_bytes(typename Wire::FromHost{}.format());

  /// One numbered command.
  void send(Time now) {
    const std::vector<std::uint8_t> frame = next_frame();
    sent_.push_back({to_mcu_.put_count() + frame.size(), frame.size(), number_ - 1});
    to_mcu_.put(frame, now);
  }

  /// The first bytes of a command, `left_out` less than all, as a host leaves it that restarts half-way.
  void send_part(std::size_t left_out, Time now) {
    const std::vector<std::uint8_t> frame = next_frame();
    to_mcu_.put(frame.data(), left_out < frame.size() ? frame.size() - left_out : 1, now);
    sent_.push_back({to_mcu_.put_count(), never_whole, number_ - 1});
  }

  /// Compare what the MCU's handler got with what came whole into its memory: each once, in order. Frames may be
  /// missing only where the ring was lapped. (A frame that lost its first bytes may be completed by equal bytes of an
  /// earlier one that lost its end, and one that lost its end by the next: nobody can tell.) `complete`: nothing is on
  /// its way.
  void check(const std::vector<std::uint32_t>& delivered, const wirebond::ReceiveAccount& ring,
             std::uint32_t line_errors, bool complete) {
    learn();
    if (ring.laps + ring.laps_unknown != laps_) waits_since_ = memory_bytes_;
    laps_ = ring.laps + ring.laps_unknown;
    for (; compared_ < delivered.size(); ++compared_) {
      std::size_t found = next_;
      while (found < came_.size() && came_[found].number != delivered[compared_]) ++found;
      if (found == came_.size()) {  // it came never, or twice, or too late
        ++false_;
        continue;
      }
      for (; next_ < found; ++next_) lost_ += came_[next_].whole;
      completed_ += !came_[next_++].whole;
    }
    for (; complete && next_ < came_.size(); ++next_) lost_ += came_[next_].whole;
    // Of what is left of a frame that lost bytes, one in 65536 passes a check of 16 bits.
    REQUIRE(false_ <= (line_errors + laps_) / 2'000);
    // What completes a frame may be the first byte of another.
    REQUIRE(lost_ <= (ring.lapped + ring.dropped) / smallest_frame + 2 * laps_ + completed_);
    // Nothing holds a frame back for longer than the largest frame takes to come; as long again may pass until the next
    // one shows that this one was overlapped by a completed frame.
    std::size_t waiting = next_;
    while (waiting < came_.size() && !came_[waiting].whole) ++waiting;
    if (waiting == came_.size()) return;
    const std::uint64_t since = came_[waiting].memory_bytes;
    REQUIRE(memory_bytes_ - (since > waits_since_ ? since : waits_since_) <= 2 * largest_frame);
  }

  /// The MCU restarted: what was in its memory is gone, and nobody's fault; it counts from the start.
  void mcu_restarted() {
    learn();
    next_ = came_.size();
    whole_run_ = 0;
    lost_ = completed_ = false_ = laps_ = 0;
  }

  /// Commands that came whole and were written over before they were read.
  std::uint64_t lost() const { return lost_; }
  std::uint64_t completed() const { return completed_; }

  /// Commands that came whole.
  std::uint64_t came() const { return whole_; }
  std::uint32_t sent() const { return number_; }

  /// Read what the MCU sent.
  void receive(Time now) {
    const std::vector<std::uint8_t> bytes = from_mcu_.read(now);
    const auto now_us = static_cast<std::uint32_t>(now / 1000);
    if (bytes.empty()) {
      receiver_.idle(now_us, *this);
    } else {
      receiver_.feed(bytes.data(), bytes.size(), now_us, *this);
    }
  }
  void on(const typename Wire::Report& report) { reports.push_back(Wire::get(report)); }
  std::vector<std::uint32_t> reports;
  const auto& receiver() const { return receiver_; }

 private:
  static constexpr std::size_t never_whole = ~std::size_t{0};

  struct Sent {
    std::uint64_t end;  ///< bytes on the line up to its last one
    std::size_t size;
    std::uint32_t number;
  };
  struct Came {
    std::uint32_t number;
    bool whole;
    std::uint64_t memory_bytes;  ///< that were in the MCU's memory when its last byte was
  };

  std::vector<std::uint8_t> next_frame() {
    typename Wire::Command command{};
    Wire::set(command, number_++);
    std::vector<std::uint8_t> frame(Wire::Command::Info::max_frame_bytes);
    std::size_t size = 0;
    REQUIRE(Wire::encode(command, frame.data(), frame.size(), size) == wirebond::Status::ok);
    frame.resize(size);
    return frame;
  }

  /// Follow the bytes that were settled since the last time.
  void learn() {
    const auto& bytes = to_mcu_.bytes();
    for (std::size_t i = learned_ - to_mcu_.forgotten(); i < bytes.size() && bytes[i].fate != Fate::travelling; ++i) {
      const auto& byte = bytes[i];
      const bool in_memory = byte.fate == Fate::received || byte.fate == Fate::damaged;
      memory_bytes_ += in_memory ? 1u : 0u;
      // A byte with an error may be right all the same; then so is its frame.
      whole_run_ = in_memory && byte.seen == byte.sent ? whole_run_ + 1 : 0;
      ++learned_;
      while (!sent_.empty() && sent_.front().end <= learned_) {
        const bool whole = whole_run_ >= sent_.front().size;
        came_.push_back({sent_.front().number, whole, memory_bytes_});
        whole_ += whole;
        sent_.pop_front();
      }
    }
    to_mcu_.forget();
  }

  Line& to_mcu_;
  Line& from_mcu_;
  std::uint32_t number_ = 0;
  std::deque<Sent> sent_;
  std::uint64_t learned_ = 0;       ///< bytes whose fate was followed
  std::uint64_t whole_run_ = 0;     ///< of these, the last ones that are all in memory and right
  std::uint64_t memory_bytes_ = 0;  ///< of these, in memory
  std::vector<Came> came_;
  std::size_t compared_ = 0;  ///< of what was delivered
  std::size_t next_ = 0;      ///< of `came_`: the next that may be delivered
  std::uint64_t whole_ = 0;
  std::uint64_t lost_ = 0;
  std::uint64_t completed_ = 0;
  std::uint64_t false_ = 0;
  std::uint32_t laps_ = 0;
  std::uint64_t waits_since_ = 0;  ///< `memory_bytes_` at the last lap
  wirebond::Receiver<typename Wire::FromMcu> receiver_;
};
