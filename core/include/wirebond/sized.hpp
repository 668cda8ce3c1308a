// Examines one stuffed candidate that no delimiter ends: its length, among stuffed bytes or before them, gives its end.
// No state, no position in a stream.
#pragma once

#include <cstddef>
#include <cstdint>
#include <cstring>

#include "wirebond/examine.hpp"
#include "wirebond/format.hpp"
#include "wirebond/source.hpp"
#include "wirebond/stuffing.hpp"

namespace wirebond {

namespace detail {

/// Undoes a stuffing from the frame's first byte on, as far as requested.
template <class Source>
class Unstuffer {
 public:
  enum Result { reached, waits, bad };

  static constexpr std::size_t everything = static_cast<std::size_t>(-1);

  /// `from`: the received bytes; `to`: memory for the bytes that will be requested.
  WIREBOND_INLINE Unstuffer(const Source& source, const std::uint8_t* from, std::uint8_t* to)
      : source_(source), from_(from), to_(to) {}

  /// Continue until `count` bytes are written. Those from `stuffed_end` on are sent as they are. `waits`: that needs
  /// more than `available` bytes. `bad`: no sender makes the next byte.
  WIREBOND_INLINE Result run(std::size_t available, std::size_t count, std::size_t stuffed_end) {
    const auto& format = source_.format();
    const EscapeRule& escapes = escapes_of(source_);
    const InsertionRule& insertion = insertion_of(source_);
    for (;;) {
      if (owes_) {
        if (read_ == available) return waits;
        if (from_[read_] != insertion.byte) return bad;
        ++read_;
        owes_ = false;
      }
      if (written_ == count) return reached;
      if (read_ == available) return waits;
      std::uint8_t byte = from_[read_];
      const bool is_stuffed = written_ >= format.plain_front && written_ < stuffed_end;
      if (is_stuffed && format.stuffing == Stuffing::escape) {
        if (is_start(byte)) return bad;
        if (byte == escapes.escape) {
          if (read_ + 1 == available) return waits;
          ++read_;
          if (is_start(from_[read_])) return bad;
          byte = static_cast<std::uint8_t>(from_[read_] ^ escapes.exclusive_or);
        }
      }
      to_[written_++] = byte;
      ++read_;
      if (is_stuffed && format.stuffing == Stuffing::insertion) {
        owes_ = ends_with(insertion, to_ + format.plain_front, written_ - format.plain_front);
      }
    }
  }

  std::size_t read() const { return read_; }
  std::size_t written() const { return written_; }
  bool owes() const { return owes_; }  ///< the written bytes end with the sequence: the inserted byte must follow

 private:
  WIREBOND_INLINE bool is_start(std::uint8_t byte) const {
    const EscapeRule& escapes = escapes_of(source_);
    for (std::size_t i = 0; i < escapes.starts; ++i) {
      if (byte == escapes.plain[i]) return true;
    }
    return false;
  }

  const Source& source_;
  const std::uint8_t* from_;
  std::uint8_t* to_;
  std::size_t read_ = 0;
  std::size_t written_ = 0;
  bool owes_ = false;
};

}  // namespace detail

/// Check whether escapes make a frame longer than its length says.
WIREBOND_INLINE bool grows_by_escapes(const FormatRules& format) {
  return format.framing == Framing::sized && format.stuffing == Stuffing::escape && !format.length_on_wire;
}

/// Examine the bytes at `candidate`, as `examine` does; sizes in the verdict are those on the wire. `scratch`: memory
/// for max_wire_bytes; the frame points into it. If the cause is unknown_message, the frame's size is the one on the
/// wire, or without escapes if the format grows_by_escapes; 0: not known. Any thread or interrupt; takes at most one
/// pass over max_wire_bytes.
template <class Source>
WIREBOND_INLINE Verdict examine_sized(const Source& source, const std::uint8_t* candidate, std::size_t available,
                                      std::uint8_t* scratch, Frame& frame) {
  using Unstuffer = detail::Unstuffer<Source>;
  const auto& format = source.format();
  const std::size_t prefix = format.forms[0].prefix;  // the same for all forms
  const auto more = [](std::size_t size, std::size_t by) {
    return Verdict{Outcome::need_more, Cause::incomplete, size + by};
  };

  // The head: which rules it breaks, and how long the frame is.
  Unstuffer unstuffer(source, candidate, scratch);
  typename Unstuffer::Result result = unstuffer.run(available, prefix, Unstuffer::everything);
  Verdict verdict = examine(source, scratch, unstuffer.written(), nullptr, frame);
  const bool grows = grows_by_escapes(format);  // a copy: the closure below would keep the whole format in flash
  const auto rejected = [&] {
    if (verdict.bytes > 1) verdict.bytes = unstuffer.read();
    if (!grows) frame.size = 0;  // its size on the wire is not known
    return verdict;
  };
  if (verdict.outcome == Outcome::reject) return rejected();
  if (result == Unstuffer::bad) return {Outcome::reject, Cause::bad_stuffing, unstuffer.read() + 1};
  const auto waits = [&](std::size_t wanted) {
    const std::size_t missing = wanted - unstuffer.written();
    return more(available, missing != 0 ? missing : 1);
  };
  if (result == Unstuffer::waits) return waits(prefix);

  // Counts inside the payload give its size one after the other.
  while (verdict.outcome == Outcome::need_more && frame.size == 0) {
    const std::size_t wanted = verdict.bytes;
    result = unstuffer.run(available, wanted, Unstuffer::everything);
    if (result == Unstuffer::bad) return {Outcome::reject, Cause::bad_stuffing, unstuffer.read() + 1};
    if (result == Unstuffer::waits) return waits(wanted);
    verdict = examine(source, scratch, unstuffer.written(), nullptr, frame);
    if (verdict.outcome == Outcome::reject) return rejected();
  }

  std::size_t size = verdict.bytes;
  std::size_t on_wire;
  if (format.length_on_wire) {
    on_wire = size;
    if (available < on_wire) return more(on_wire, 0);
    const std::size_t end = on_wire - format.plain_back;
    if (unstuffer.read() > end) return {Outcome::reject, Cause::length_out_of_range, on_wire};
    result = unstuffer.run(end, Unstuffer::everything, Unstuffer::everything);
    if (result == Unstuffer::bad) return {Outcome::reject, Cause::bad_stuffing, unstuffer.read() + 1};
    if (unstuffer.read() != end || unstuffer.owes()) return {Outcome::reject, Cause::bad_stuffing, on_wire};
    std::memcpy(scratch + unstuffer.written(), candidate + end, format.plain_back);
    size = unstuffer.written() + format.plain_back;
  } else {
    result = unstuffer.run(available, size, size - format.plain_back);
    if (result == Unstuffer::bad) return {Outcome::reject, Cause::bad_stuffing, unstuffer.read() + 1};
    if (result == Unstuffer::waits) return waits(size);
    on_wire = unstuffer.read();
  }

  const detail::Received received{candidate, on_wire};
  verdict = examine(source, scratch, size, &received, frame);
  if (verdict.outcome == Outcome::need_more) verdict = {Outcome::reject, Cause::length_out_of_range, size};
  if (verdict.outcome != Outcome::frame) frame.size = grows ? size : on_wire;
  verdict.bytes = on_wire;
  return verdict;
}

}  // namespace wirebond
