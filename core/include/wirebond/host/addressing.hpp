// For whom a received frame is, at the host: its own address, and the addresses that its requests asked. No port, no
// time.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>

#include "wirebond/examine.hpp"
#include "wirebond/format.hpp"
#include "wirebond/placed_number.hpp"

namespace wirebond {

/// The number of the header field at `place` of the format's list. False: the frame's form does not have it.
inline bool header_value(const FrameFormat& format, const Frame& frame, int place, std::uint64_t& value) {
  const Form& form = format.forms[frame.form];
  for (std::size_t i = 0; i < form.header_count; ++i) {
    if (form.header[i].place != place) continue;
    value = detail::read_wide(form.header[i].number, frame.bytes, frame.size);
    return true;
  }
  return false;
}

/// Which intact frames are not for this end. They are delivered frames in every account, and reach no handler.
///
/// Where frames name their receiver: those for another address that is no broadcast. Where an MCU answers with its own
/// address: replies from an address that no request asked. A frame without the address concerns everybody.
/// Times play no part. One thread at a time.
class HostAddressing {
 public:
  /// What the protocol says. Places are those of the header fields in the format's list; -1: there is none.
  struct Rules {
    int receiver_place = -1;       ///< says for whom a frame is
    int sender_place = -1;         ///< says who sent it; compared only where the MCU answers with its own address
    std::uint64_t own = 0;         ///< the own address at first
    std::uint8_t broadcasts = 0;   ///< this many of `broadcast`
    bool only_last_asked = false;  ///< only its request tells what a reply is, so that an earlier one is over
    std::array<std::uint64_t, 4> broadcast{};
  };

  HostAddressing() = default;
  HostAddressing(const FrameFormat& format, const Rules& rules) : format_(&format), rules_(rules) {}

  std::uint64_t address() const { return rules_.own; }
  void set_address(std::uint64_t address) { rules_.own = address; }
  /// Nothing is foreign any more, or is again.
  void listen_to_all(bool all) { all_ = all; }

  bool is_broadcast(std::uint64_t address) const {
    for (std::size_t i = 0; i < rules_.broadcasts; ++i) {
      if (rules_.broadcast[i] == address) return true;
    }
    return false;
  }

  /// A request leaves for this address; `reply` answers it. Of the last `remembered` addresses asked, none is
  /// forgotten.
  void asks(std::int16_t reply, std::uint64_t address) {
    if (rules_.sender_place < 0) return;
    if (rules_.only_last_asked) count_ = 0;
    std::size_t old = 0;
    while (old < count_ && (asked_[old].reply != reply || asked_[old].address != address)) ++old;
    if (old == remembered) old = 0;
    if (old < count_) {  // it becomes the newest, or makes room
      --count_;
      for (std::size_t i = old; i < count_; ++i) asked_[i] = asked_[i + 1];
    }
    asked_[count_++] = {reply, address};
  }
  /// What was asked is not answered any more.
  void forget() { count_ = 0; }

  bool is_foreign(const Frame& frame) const {
    if (all_ || format_ == nullptr) return false;
    std::uint64_t value = 0;
    if (rules_.receiver_place >= 0 && header_value(*format_, frame, rules_.receiver_place, value)) {
      return value != rules_.own && !is_broadcast(value);
    }
    if (rules_.sender_place < 0 || !header_value(*format_, frame, rules_.sender_place, value)) return false;
    bool was_asked = false;
    for (std::size_t i = 0; i < count_; ++i) {
      if (asked_[i].reply != frame.message) continue;
      if (asked_[i].address == value || is_broadcast(asked_[i].address)) return false;
      was_asked = true;
    }
    return was_asked;
  }

  static constexpr std::size_t remembered = 32;

 private:
  struct Asked {
    std::int16_t reply = -1;
    std::uint64_t address = 0;
  };

  const FrameFormat* format_ = nullptr;  ///< of the frames that are received; null: all are its own
  Rules rules_{};
  bool all_ = false;
  std::size_t count_ = 0;
  std::array<Asked, remembered> asked_{};
};

}  // namespace wirebond
