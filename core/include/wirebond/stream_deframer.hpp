// A deframer for bytes that come in chunks: carries the unsettled tail from call to call, and knows when to give it up.
#pragma once

#include <cstddef>
#include <cstdint>
#include <cstring>

#include "wirebond/deframer.hpp"

namespace wirebond {

/// Chunks of at most this many bytes are joined with what was carried; larger ones are looked at where they lie, but
/// for the seam. A microcontroller joins seams only: memory is dear there, and frames are handed out in place.
template <class Source>
constexpr std::size_t joined_chunk = Source::is_constant ? 0 : 512;

/// Memory that a StreamDeframer asks for: bytes carried from call to call, and room to unstuff one frame.
template <class Source>
WIREBOND_INLINE constexpr std::size_t workspace_bytes(const Source& source) {
  const FrameFormat& format = source.format();
  const std::size_t scratch = format.stuffing == Stuffing::none ? 0 : max_wire_bytes(format);
  return 2 * max_wire_bytes(format) + 2 * joined_chunk<Source> + scratch;
}

namespace detail {

/// Where in its memory a StreamDeframer carries bytes. A constant source joins seams only, and these at the front.
template <class Source, bool IsFolded = folds<Source>(0)>
class CarryPlace {
 public:
  explicit CarryPlace(const Source&) {}
  static constexpr std::size_t capacity() { return 2 * max_wire_bytes(Source{}.format()); }
  static constexpr std::size_t begin() { return 0; }
  void begin_at(std::size_t) {}
};
template <class Source>
class CarryPlace<Source, false> {
 public:
  explicit CarryPlace(const Source& source)
      : capacity_(2 * max_wire_bytes(source.format()) + 2 * joined_chunk<Source>) {}
  std::size_t capacity() const { return capacity_; }
  std::size_t begin() const { return begin_; }
  void begin_at(std::size_t begin) { begin_ = begin; }

 private:
  std::size_t capacity_;
  std::size_t begin_ = 0;
};

}  // namespace detail

/// Chunks in, frames out. Never allocates.
/// One thread or interrupt at a time. `Counter` also carries time, in microseconds, and may wrap.
template <class Source, class Counter = std::uint32_t, class Account = ByteAccount<Counter>>
class StreamDeframer : private detail::CarryPlace<Source> {
 public:
  /// `workspace`: workspace_bytes(source) bytes that outlive this object. `idle_us`: the silence after which an
  /// incomplete candidate is given up.
  StreamDeframer(const Source& source, std::uint8_t* workspace, Counter idle_us)
      : detail::CarryPlace<Source>(source),
        buffer_(workspace),
        idle_us_(idle_us),
        deframer_(source, workspace + capacity()) {}

  /// Bytes that were read at `now_us`. Work per byte is bounded whatever they are.
  template <class Sink>
  void feed(const std::uint8_t* bytes, std::size_t size, Counter now_us, Sink&& sink) {
    if (size == 0) return;
    // Where silence ends a frame, what came before this pause is one.
    if (ends_by_silence()) idle(now_us, sink);
    last_byte_us_ = now_us;
    if (size <= joined_chunk<Source>) {
      feed_joined(bytes, size, sink);
    } else {
      feed_in_place(bytes, size, sink);
    }
  }

  /// A request has gone out: of messages that share an id, its reply `index` is meant from here on, until the next
  /// call. -1: none of them. No effect on other ids. Where silence ends a frame, take what came before (`idle`) first.
  void expect(std::int16_t index) { deframer_.expect(index); }

  /// A read that began at `now_us` found nothing. Gives up an incomplete candidate when the silence has lasted
  /// `idle_us`; its bytes are rescanned, which may free frames behind a false start.
  template <class Sink>
  void idle(Counter now_us, Sink&& sink) {
    if (is_silent(now_us)) give_up(sink);
  }

  /// Has the silence before a read that began at `now_us` and found nothing lasted `idle_us`?
  bool is_silent(Counter now_us) const { return static_cast<Counter>(now_us - last_byte_us_) >= idle_us_; }

  /// No byte will ever follow (end of a capture, port closed): settle everything.
  template <class Sink>
  void give_up(Sink&& sink) {
    if (carried_ == 0 && !ends_by_silence()) return;
    deframer_.consume(buffer_ + begin(), carried_, true, sink);
    begin_at(0);
    carried_ = 0;
  }

  bool owes_nothing() const { return deframer_.owes_nothing(); }  ///< see Deframer
  const Account& account() const { return deframer_.account(); }
  Counter bytes() const { return deframer_.settled() + static_cast<Counter>(carried_); }  ///< all that were fed
  std::size_t pending() const { return carried_; }                                        ///< of these, not settled yet
  Counter idle_us() const { return idle_us_; }

 private:
  using detail::CarryPlace<Source>::begin;
  using detail::CarryPlace<Source>::begin_at;
  using detail::CarryPlace<Source>::capacity;

  WIREBOND_INLINE bool ends_by_silence() const {
    if constexpr (Source::is_constant) {
      return deframer_.source().format().framing == Framing::silence;
    } else {
      return deframer_.source().ends_by_silence();
    }
  }

  template <class Sink>
  WIREBOND_INLINE void feed_joined(const std::uint8_t* bytes, std::size_t size, Sink& sink) {
    if (capacity() - begin() - carried_ < size) settle_down();  // then there is room: less than one frame is carried
    std::uint8_t* const window = buffer_ + begin();
    std::memcpy(window + carried_, bytes, size);
    const std::size_t available = carried_ + size;
    const std::size_t done = deframer_.consume(window, available, false, sink);
    carried_ = available - done;
    begin_at(carried_ == 0 ? 0 : begin() + done);
  }

  template <class Sink>
  WIREBOND_INLINE void feed_in_place(const std::uint8_t* bytes, std::size_t size, Sink& sink) {
    while (size != 0) {
      if (carried_ == 0) {
        const std::size_t done = deframer_.consume(bytes, size, false, sink);
        begin_at(0);
        carried_ = size - done;  // less than one frame
        if (carried_ != 0) std::memcpy(buffer_, bytes + done, carried_);
        return;
      }
      if (begin() != 0) settle_down();
      const std::size_t needed = deframer_.needed();  // no more than that: what follows is handed out where it lies
      const std::size_t room = needed > carried_ && needed <= capacity() ? needed - carried_ : capacity() - carried_;
      const std::size_t taken = size < room ? size : room;
      std::memcpy(buffer_ + carried_, bytes, taken);
      const std::size_t done = deframer_.consume(buffer_, carried_ + taken, false, sink);
      if (done >= carried_) {  // past the seam: go on in the caller's bytes
        bytes += done - carried_;
        size -= done - carried_;
        carried_ = 0;
      } else {
        bytes += taken;
        size -= taken;
        carried_ += taken - done;
        if (done != 0)
          std::memmove(buffer_, buffer_ + done, carried_);  // else a byte at a time would move a frame each
      }
    }
  }

  /// Move what is carried to the buffer's front.
  void settle_down() {
    std::memmove(buffer_, buffer_ + begin(), carried_);
    begin_at(0);
  }

  std::uint8_t* buffer_;
  std::size_t carried_ = 0;  ///< bytes that are not settled yet
  Counter idle_us_;
  Counter last_byte_us_ = 0;
  Deframer<Source, Counter, Account> deframer_;
};

}  // namespace wirebond
