// Recognises an end's own frames among received ones, although the protocol file does not say that the line echoes: its
// TX may be shorted to its RX, or a transceiver hears itself. Marks of frames and times: no port, no queue.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>

#include "wirebond/bytes.hpp"
#include "wirebond/examine.hpp"
#include "wirebond/format.hpp"
#include "wirebond/mcu/atomics.hpp"
#include "wirebond/message_list.hpp"
#include "wirebond/unlisted.hpp"

namespace wirebond::detail {

/// Bytes that may surround a frame of this format, needed to compute its mark. Four bytes by value: a reference to the
/// format would put all of it into flash.
struct Around {
  bool any = false;
  std::uint8_t opens = 0;
  std::uint8_t closes = 0;
  std::uint8_t closes_too = 0;

  bool has(std::uint8_t byte) const { return byte == opens || byte == closes || byte == closes_too; }
};
WIREBOND_INLINE constexpr Around around(const FormatRules& format) {
  if (!has_marks(format)) return {};
  const std::uint8_t last = format.closing.size == 2 ? format.closing.second : format.closing.first;
  return {true, format.opening.first, format.closing.first, last};
}

/// Return a number that is equal for frames with the same bytes. Excludes the delimiters: one may belong to the frame
/// before.
WIREBOND_NOINLINE inline std::uint16_t mark_of(Around around, const std::uint8_t* bytes, std::size_t size) {
  if (around.any) {
    while (size != 0 && around.has(bytes[0])) ++bytes, --size;
    while (size != 0 && around.has(bytes[size - 1])) --size;
  }
  std::uint32_t mark = 0;
  for (std::size_t i = 0; i < size; ++i) mark = mark * 31 + bytes[i];
  return static_cast<std::uint16_t>(mark ^ mark >> 16);
}

/// Remembers the newest frames that left and that this end would mistake for the other end's if they came back. The
/// UART's interrupt notes them as they are given to DMA, `poll` checks received ones. A frame that comes back comes
/// while it leaves, or just after; older ones are forgotten.
template <bool remembers>
class OwnFrames {
 public:
  // ---- the UART's interrupt

  void leaves(std::uint16_t mark) {
    const std::uint8_t count = count_.load(std::memory_order_relaxed);  // only this context writes it
    marks_[count % marks_.size()].store(mark, std::memory_order_relaxed);
    count_.store(static_cast<std::uint8_t>(count + 1), std::memory_order_release);  // pairs with `has`
  }

  // ---- `poll`

  /// Check whether such a frame has left just now.
  bool has(std::uint16_t mark) const {
    const std::uint8_t count = count_.load(std::memory_order_acquire);  // pairs with `leaves`
    const auto since = static_cast<std::uint8_t>(count - forgotten_);
    const std::size_t kept = since < marks_.size() ? since : marks_.size();
    for (std::size_t i = 1; i <= kept; ++i) {
      if (marks_[static_cast<std::uint8_t>(count - i) % marks_.size()].load(std::memory_order_relaxed) == mark) {
        return true;
      }
    }
    return false;
  }

  /// Note that all frames that came by `now_us` were checked. When nothing has left for `keep_us`, older frames are
  /// forgotten.
  void poll(std::uint32_t now_us, bool sends, std::uint32_t keep_us) {
    const std::uint8_t count = count_.load(std::memory_order_relaxed);
    if (sends || count != seen_) {
      seen_ = count;
      since_us_ = now_us;
    } else if (now_us - since_us_ >= keep_us) {
      forgotten_ = count;
    }
  }

 private:
  std::array<LoadStore<std::uint16_t>, 8>
      marks_{};  // number n at place n modulo 8; a power of two, so that it may wrap
  LoadStore<std::uint8_t> count_{0};
  std::uint8_t seen_ = 0;       ///< these three are poll's own
  std::uint8_t forgotten_ = 0;  ///< marks up to this one
  std::uint32_t since_us_ = 0;  ///< the last poll that saw a frame leave
};

/// Counts the frames that came back.
template <bool recognises>
class OwnCount {
 public:
  /// Note that a frame of the other end came.
  void heard_other() { in_row_ = 0; }
  /// Count a frame that this end sent, or that equals one. `has_own_id`: no other end sends frames with this id.
  void heard_own(bool has_own_id) {
    frames_ += 1;
    if (in_row_ != 0xFF) ++in_row_;
    is_sure_ = is_sure_ || has_own_id;
  }
  /// Check whether a frame that equals an own one is certainly an own one.
  bool is_sure() const { return is_sure_; }
  /// Check whether the newest frame is probably an own one. It reaches its handler, because the other end may send the
  /// same bytes, but it is not a sign of the other end.
  bool is_likely() const { return in_row_ >= (is_sure_ ? 1 : when_likely); }

  std::uint32_t frames() const { return frames_; }

  /// Check whether the line echoes. `sent`: frames.
  bool hears_itself(std::uint32_t sent) const {
    return in_row_ >= when_likely || (frames_ >= when_likely && frames_ > sent / 2);
  }

 private:
  /// After this many such frames in a row, without one of the other end, the line probably echoes.
  static constexpr std::uint8_t when_likely = 3;

  std::uint32_t frames_ = 0;
  std::uint8_t in_row_ = 0;  ///< since a frame of the other end, at most 255
  bool is_sure_ = false;     ///< a frame came back that only this end sends
};

/// For ends that cannot recognise own frames, or a file that says that the line echoes: takes no byte, no instruction.
template <>
class OwnCount<false> {
 public:
  static constexpr std::uint32_t frames() { return 0; }
  static constexpr bool is_likely() { return false; }
  static constexpr bool hears_itself(std::uint32_t) { return false; }
};

/// Messages of this end that its receiver would mistake for the other end's: a generated list.
template <class Messages>
struct Mistakable;
template <class... Messages>
struct Mistakable<MessageList<Messages...>> {
  static constexpr bool any = sizeof...(Messages) != 0;
  static constexpr bool has([[maybe_unused]] std::uint8_t message) {
    return ((message == static_cast<std::uint8_t>(Messages::Info::index)) || ...);
  }
};

/// Whether this end can send frames that its own receiver would mistake for the other end's. If the file says that the
/// line echoes, each byte is compared, and no frame needs to be.
template <class Protocol>
inline constexpr bool remembers_own = !Protocol::echoes && Mistakable<typename Protocol::Mistakable>::any;

/// Whether frames that only this end sends come out of its receiver, as unknown ones.
template <class Protocol>
inline constexpr bool sees_own_ids =
    !Protocol::echoes && Protocol::knows_own_ids && typename Protocol::Receives{}.format().deliver_unknown;

/// Check whether `Source` has a message of this id, with any payload.
template <class Source>
constexpr bool knows_id(std::uint32_t id) {
  return Source{}.message(id).known();
}

/// Counters of an MCU's link where the format can have frames of messages that the file does not list. Own ones that
/// come back are excluded.
template <class Sends>
struct UnlistedByteCountsBut : ByteCounts<std::uint32_t> {
  class Count : public UnlistedCount {
   public:
    void failed(std::uint32_t at, std::uint32_t id, std::size_t size, std::size_t plain_front) {
      if (!knows_id<Sends>(id)) UnlistedCount::failed(at, id, size, plain_front);
    }
    void stands(std::uint32_t at, std::uint32_t id, std::size_t size) {
      if (!knows_id<Sends>(id)) UnlistedCount::stands(at, id, size);
    }
  };
  Count unlisted;
};

/// For ends whose frames cannot be mistaken for the other end's: takes no byte, no instruction.
template <>
class OwnFrames<false> {};

}  // namespace wirebond::detail
