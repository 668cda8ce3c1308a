// Finds out for whom a received frame is, at the host: its own address, and the addresses that its requests went to. No
// port, no time.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>

#include "wirebond/examine.hpp"
#include "wirebond/format.hpp"
#include "wirebond/placed_number.hpp"

namespace wirebond {

/// Read the header field `place` of the format's list. Returns false if the frame's form does not have it.
inline bool header_value(const FrameFormat& format, const Frame& frame, int place, std::uint64_t& value) {
  const Form& form = format.forms[frame.form];
  for (std::size_t i = 0; i < form.header_count; ++i) {
    if (form.header[i].place != place) continue;
    value = detail::read_wide(form.header[i].number, frame.bytes, frame.size);
    return true;
  }
  return false;
}

/// Decides which intact frames are for others. They count as delivered frames in every account, but reach no handler.
///
/// Where frames name their receiver: those for another address that is not a broadcast. Where an MCU answers with its
/// own address: replies from an address that no request asked. A frame without the address concerns everyone.
/// Independent of time. One thread at a time.
class HostAddressing {
 public:
  /// Rules from the protocol. Places are indexes in the format's list of header fields; -1: none.
  struct Rules {
    int receiver_place = -1;       ///< the receiver's address
    int sender_place = -1;         ///< the sender's address; compared only where the MCU answers with its own address
    std::uint64_t own = 0;         ///< the initial own address
    std::uint8_t broadcasts = 0;   ///< how many of `broadcast` are used
    bool only_last_asked = false;  ///< only its request identifies a reply, so earlier requests no longer count
    std::array<std::uint64_t, 4> broadcast{};
  };

  HostAddressing() = default;
  HostAddressing(const FrameFormat& format, const Rules& rules) : format_(&format), rules_(rules) {}

  std::uint64_t address() const { return rules_.own; }
  void set_address(std::uint64_t address) { rules_.own = address; }
  /// Treat no frame as foreign, or return to the rules.
  void listen_to_all(bool all) { all_ = all; }

  bool is_broadcast(std::uint64_t address) const {
    for (std::size_t i = 0; i < rules_.broadcasts; ++i) {
      if (rules_.broadcast[i] == address) return true;
    }
    return false;
  }

  /// Note that a request leaves for this address; `reply` answers it. The last `remembered` addresses asked are kept.
  void asks(std::int16_t reply, std::uint64_t address) {
    if (rules_.sender_place < 0) return;
    if (rules_.only_last_asked) count_ = 0;
    std::size_t old = 0;
    while (old < count_ && (asked_[old].reply != reply || asked_[old].address != address)) ++old;
    if (old == remembered) old = 0;
    if (old < count_) {  // it becomes the newest, or makes space
      --count_;
      for (std::size_t i = old; i < count_; ++i) asked_[i] = asked_[i + 1];
    }
    asked_[count_++] = {reply, address};
  }
  /// Forget all requests: they are no longer answered.
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

  const FrameFormat* format_ = nullptr;  ///< of received frames; null: all frames are for this end
  Rules rules_{};
  bool all_ = false;
  std::size_t count_ = 0;
  std::array<Asked, remembered> asked_{};
};

}  // namespace wirebond
