// A deframer for bytes that come in chunks: carries the unsettled tail from call to call, and decides when to give it
// up.
#pragma once

#include <cstddef>
#include <cstdint>
#include <cstring>

#include "wirebond/deframer.hpp"

namespace wirebond {

/// Chunks of at most this many bytes are joined with the carried ones; larger ones are read in place, except at the
/// seam. A microcontroller joins seams only: memory is scarce there, and frames are delivered in place.
template <class Source>
constexpr std::size_t joined_chunk = Source::is_constant ? 0 : 512;

/// Memory that a StreamDeframer needs: bytes carried from call to call, and space to unstuff one frame.
template <class Source>
WIREBOND_INLINE constexpr std::size_t workspace_bytes(const Source& source) {
  const auto& format = source.format();
  const std::size_t scratch = format.stuffing == Stuffing::none ? 0 : max_wire_bytes(format);
  return 2 * max_wire_bytes(format) + 2 * joined_chunk<Source> + scratch;
}

namespace detail {

/// Where in its memory a StreamDeframer carries bytes. A constant source joins seams only, and carries these at the
/// front.
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

/// Where silence ends a frame: remembers a pause that may have ended one. Empty for other formats.
template <class Counter>
class Pauses {
 public:
  explicit Pauses(Counter pause_us) : pause_us_(pause_us) {}
  Counter pause_us() const { return pause_us_; }
  /// How many of the carried bytes came before a pause whose end was not observed; 0: none.
  std::size_t before_pause() const { return before_pause_; }
  void note_pause(std::size_t before) { before_pause_ = before; }

 private:
  Counter pause_us_;
  std::size_t before_pause_ = 0;
};
template <class Source>
constexpr bool ends_by_silence() {
  if constexpr (folds<Source>(0)) {
    return Source{}.format().framing == Framing::silence;
  } else {
    return true;
  }
}
struct NoPauses {
  template <class Counter>
  explicit NoPauses(Counter) {}
  static constexpr std::size_t before_pause() { return 0; }
  static constexpr std::size_t pause_us() { return 0; }
  void note_pause(std::size_t) {}
};
template <class Source, class Counter>
using PausesOf = std::conditional_t<ends_by_silence<Source>(), Pauses<Counter>, NoPauses>;

}  // namespace detail

/// Chunks in, frames out. Never allocates. One thread or interrupt at a time. `Counter` also carries time, in
/// microseconds, and may wrap.
template <class Source, class Counter = std::uint32_t, class Account = ByteAccount<Counter>>
class StreamDeframer : private detail::CarryPlace<Source>, private detail::PausesOf<Source, Counter> {
  using Pauses = detail::PausesOf<Source, Counter>;
  static constexpr bool may_end_by_silence = detail::ends_by_silence<Source>();

 public:
  /// `workspace`: workspace_bytes(source) bytes that outlive this object. `idle_us`: silence after which an incomplete
  /// candidate is given up.
  StreamDeframer(const Source& source, std::uint8_t* workspace, Counter idle_us)
      : StreamDeframer(source, workspace, idle_us, idle_us) {}

  /// For a port that may hold bytes back, where silence ends a frame: after a pause of `pause_us` the bytes are a frame
  /// if they form a whole one; an incomplete one is kept until `idle_us`.
  StreamDeframer(const Source& source, std::uint8_t* workspace, Counter idle_us, Counter pause_us)
      : detail::CarryPlace<Source>(source),
        Pauses(pause_us),
        buffer_(workspace),
        idle_us_(idle_us),
        deframer_(source, workspace + capacity()) {}

  /// Take bytes that were read at `now_us`, and came then. Work per byte is bounded for any input.
  template <class Sink>
  void feed(const std::uint8_t* bytes, std::size_t size, Counter now_us, Sink&& sink) {
    feed(bytes, size, now_us, now_us, sink);
  }

  /// Take bytes that were read at `now_us` and came at `came_us` or later: the last read before found nothing.
  template <class Sink>
  void feed(const std::uint8_t* bytes, std::size_t size, Counter came_us, Counter now_us, Sink&& sink) {
    if (size == 0) return;
    if constexpr (may_end_by_silence) {
      if (ends_by_silence()) {
        pause(came_us, now_us, sink);
        // Together with the bytes before the pause this is too long for a frame.
        constexpr auto longest = max_frame_bytes<detail::FormatOf<Source>>;
        if (this->before_pause() != 0 && carried_ + size > detail::of_format<longest>(deframer_.source())) {
          drop_before_pause(sink);
        }
      }
    }
    last_byte_us_ = now_us;
    if (size <= joined_chunk<Source>) {
      feed_joined(bytes, size, sink);
    } else {
      feed_in_place(bytes, size, sink);
    }
  }

  /// Expect the reply `index` from now on, where several messages share its id, until the next call. -1: none of them.
  /// No effect on other ids. Call it when the request leaves. Where silence ends a frame, settle earlier bytes (`idle`)
  /// first.
  void expect(std::int16_t index) { deframer_.expect(index); }

  /// Note that a read that began at `now_us` found nothing. Gives up an incomplete candidate once the silence has
  /// lasted `idle_us`; its bytes are rescanned, which may deliver frames after a false start.
  template <class Sink>
  void idle(Counter now_us, Sink&& sink) {
    if constexpr (may_end_by_silence) {
      if (ends_by_silence()) return pause(now_us, now_us, sink);
    }
    if (is_silent(now_us)) give_up(sink);
  }

  /// Check whether the silence before a read that began at `now_us` and found nothing has lasted `idle_us`.
  bool is_silent(Counter now_us) const { return static_cast<Counter>(now_us - last_byte_us_) >= idle_us_; }

  /// Settle everything, because no byte will follow (end of a capture, port closed).
  template <class Sink>
  void give_up(Sink&& sink) {
    if (carried_ == 0 && !ends_by_silence()) return;
    if constexpr (may_end_by_silence) {
      if (this->before_pause() != 0 && !holds_frame(0)) drop_before_pause(sink);
    }
    this->note_pause(0);
    deframer_.consume(buffer_ + begin(), carried_, true, sink);
    begin_at(0);
    carried_ = 0;
  }

  bool owes_nothing() const { return deframer_.owes_nothing(); }  ///< see Deframer
  const Account& account() const { return deframer_.account(); }
  Counter bytes() const { return deframer_.settled() + static_cast<Counter>(carried_); }  ///< all that were fed
  std::size_t pending() const { return carried_; }                                        ///< of these, not settled yet
  Counter idle_us() const { return idle_us_; }

  /// Note that the bytes fed last came at `when_us` at the latest, according to an event of the port.
  void last_came_at(Counter when_us) { last_byte_us_ = when_us; }

  /// Return when `idle` should be called after a read that ended at `last_us`.
  Counter look_at(Counter last_us, Counter now_us) const {
    const bool may_be_whole = ends_by_silence() && static_cast<Counter>(now_us - last_us) < this->pause_us();
    return last_us + (may_be_whole ? static_cast<Counter>(this->pause_us()) : idle_us_);
  }

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

  /// Where silence ends a frame: note that the line was silent until `came_us` at least, and until `now_us` at most.
  ///
  /// The problem: a silence may be real, or the program read late, or the port held bytes back.
  ///
  /// The answer: a silence observed to its end (`came_us`) ends the frame in any case. One that is only likely ends it
  /// if the bytes form a whole frame; otherwise its place is kept, because the bytes after it may be a frame without
  /// those before.
  template <class Sink>
  void pause(Counter came_us, Counter now_us, Sink& sink) {
    const Counter silence_us = static_cast<Counter>(now_us - last_byte_us_);
    const bool is_watched =
        static_cast<Counter>(came_us - last_byte_us_) <= silence_us;  // otherwise it came before the last
    if (is_watched && is_silent(came_us)) return give_up(sink);
    if (silence_us < this->pause_us()) return;
    if (this->before_pause() == carried_ && carried_ != 0) return;  // checked before
    if (carried_ == 0 || holds_frame(0) || (this->before_pause() != 0 && holds_frame(this->before_pause()))) {
      return give_up(sink);
    }
    this->note_pause(carried_);
  }

  /// Check whether the carried bytes from this place on are one frame.
  bool holds_frame(std::size_t from) { return deframer_.is_block_frame(buffer_ + begin() + from, carried_ - from); }

  template <class Sink>
  void drop_before_pause(Sink& sink) {
    const std::size_t before = this->before_pause();
    this->note_pause(0);
    deframer_.consume(buffer_ + begin(), before, true, sink);
    carried_ -= before;
    std::memmove(buffer_, buffer_ + begin() + before, carried_);
    begin_at(0);
  }

  template <class Sink>
  WIREBOND_INLINE void feed_joined(const std::uint8_t* bytes, std::size_t size, Sink& sink) {
    if (capacity() - begin() - carried_ < size) settle_down();  // then it fits: less than one frame is carried
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
      const std::size_t needed = deframer_.needed();  // no more than that: the rest is delivered in place
      const std::size_t room = needed > carried_ && needed <= capacity() ? needed - carried_ : capacity() - carried_;
      const std::size_t taken = size < room ? size : room;
      std::memcpy(buffer_ + carried_, bytes, taken);
      const std::size_t done = deframer_.consume(buffer_, carried_ + taken, false, sink);
      if (done >= carried_) {  // past the seam: continue in the caller's bytes
        bytes += done - carried_;
        size -= done - carried_;
        carried_ = 0;
      } else {
        bytes += taken;
        size -= taken;
        carried_ += taken - done;
        if (done != 0)
          std::memmove(buffer_, buffer_ + done, carried_);  // otherwise single bytes would move a frame each time
      }
    }
  }

  /// Move the carried bytes to the buffer's front.
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
