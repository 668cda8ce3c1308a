// A deframer for bytes that come in chunks: carries the unsettled tail from call to call, and knows when to give it up.
#pragma once

#include <cstddef>
#include <cstdint>
#include <cstring>

#include "wirebond/deframer.hpp"

namespace wirebond {

/// Chunks in, frames out. Never allocates; what begins in one chunk and ends in another is joined in the workspace,
/// other frames are handed out where the chunk holds them.
/// One thread or interrupt at a time. `Counter` also carries time, in microseconds, and may wrap.
template <class Source, class Counter = std::uint32_t>
class StreamDeframer {
 public:
  /// `workspace`: workspace_bytes(format) bytes that outlive this object. `idle_us`: the silence after which an
  /// incomplete candidate is given up.
  StreamDeframer(const Source& source, std::uint8_t* workspace, Counter idle_us)
      : carry_(workspace),
        capacity_(2 * max_wire_bytes(source.format())),
        idle_us_(idle_us),
        deframer_(source, workspace + 2 * max_wire_bytes(source.format())) {}

  /// Bytes that were read at `now_us`. Work per byte is bounded whatever they are.
  template <class Sink>
  void feed(const std::uint8_t* bytes, std::size_t size, Counter now_us, Sink&& sink) {
    if (size == 0) return;
    fed_ += static_cast<Counter>(size);
    last_byte_us_ = now_us;
    while (size != 0) {
      if (carried_ == 0) {
        const std::size_t done = deframer_.consume(bytes, size, false, sink);
        carried_ = size - done;
        std::memcpy(carry_, bytes + done, carried_);  // less than one frame
        return;
      }
      const std::size_t room = capacity_ - carried_;
      const std::size_t taken = size < room ? size : room;
      std::memcpy(carry_ + carried_, bytes, taken);
      const std::size_t done = deframer_.consume(carry_, carried_ + taken, false, sink);
      if (done >= carried_) {  // past the seam: go on in the caller's bytes
        bytes += done - carried_;
        size -= done - carried_;
        carried_ = 0;
      } else {
        bytes += taken;
        size -= taken;
        carried_ += taken - done;
        if (done != 0) std::memmove(carry_, carry_ + done, carried_);  // else a byte at a time would move a frame each
      }
    }
  }

  /// A read that began at `now_us` found nothing. Gives up an incomplete candidate when the silence has lasted
  /// `idle_us`; its bytes are rescanned, which may free frames behind a false start.
  template <class Sink>
  void idle(Counter now_us, Sink&& sink) {
    if (carried_ == 0 || static_cast<Counter>(now_us - last_byte_us_) < idle_us_) return;
    give_up(sink);
  }

  /// No byte will ever follow (end of a capture, port closed): settle everything.
  template <class Sink>
  void give_up(Sink&& sink) {
    if (carried_ == 0) return;
    deframer_.consume(carry_, carried_, true, sink);
    carried_ = 0;
  }

  const ByteAccount<Counter>& account() const { return deframer_.account(); }
  Counter bytes() const { return fed_; }            ///< all that were fed
  std::size_t pending() const { return carried_; }  ///< of these, not settled yet
  Counter idle_us() const { return idle_us_; }

 private:
  std::uint8_t* carry_;
  std::size_t capacity_;
  std::size_t carried_ = 0;
  Counter idle_us_;
  Counter last_byte_us_ = 0;
  Counter fed_ = 0;
  Deframer<Source, Counter> deframer_;
};

}  // namespace wirebond
