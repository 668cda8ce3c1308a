// A line on which an end receives what it sends: separates its own bytes from those of others. Bytes in, bytes of
// others out: no frame, no port, no clock.
#pragma once

#include <atomic>
#include <cstddef>
#include <cstdint>

#include "wirebond/bytes.hpp"
#include "wirebond/load_store.hpp"

namespace wirebond {

/// The problem: on the two wires of RS-485, or on one wire for both directions, an end receives its own bytes, mixed
/// with those of others. Dropping as many bytes as were sent would drop another sender's: bytes that came before the
/// echo and were not read yet, or bytes in its place because there was no echo.
///
/// The answer: each piece that the end sends is kept here until it is heard. Received bytes are compared with it, and
/// all that is not a whole own piece is passed on, in its order. So no byte of another sender is lost.
///
/// A piece that is not heard as it was sent is a collision: another end sent at the same time, a byte was damaged, or
/// the line does not echo. A collision is counted when a later piece is heard, or when the caller gives up.
///
/// The memory holds the pieces, each after two bytes with its size. One context sends (`keep`, `sent`, `refused`),
/// another hears; the sender may interrupt the hearer. Neither waits. A byte is compared with each piece that is not
/// heard yet and, where a match fails, so are the bytes held back for it. While no piece is expected, bytes are passed
/// on untouched.
class Echo {
 public:
  using Count = std::uint32_t;

  static constexpr std::size_t piece_overhead = 2;

  /// `size`: a power of two. The memory must outlive this object. A piece has at most 65535 bytes.
  Echo(std::uint8_t* memory, std::size_t size) : memory_(memory), mask_(static_cast<Count>(size - 1)) {}
  Echo(const Echo&) = delete;
  Echo& operator=(const Echo&) = delete;

  // ---- the sending context

  /// Keep a piece that is about to leave; then call `sent` or `refused`. Returns false if the memory is full because
  /// too many pieces were not heard yet: send this one later.
  bool keep(const std::uint8_t* bytes, std::size_t size) {
    const Count begin = kept_until_;
    const Count used = begin - begin_.load(std::memory_order_acquire);  // pairs with `free_until`
    if (size + piece_overhead > mask_ + 1 - used) return false;
    put(begin, static_cast<std::uint8_t>(size));
    put(begin + 1, static_cast<std::uint8_t>(size >> 8));
    for (std::size_t i = 0; i < size; ++i) put(byte_of(begin, static_cast<Count>(i)), bytes[i]);
    kept_until_ = byte_of(begin, static_cast<Count>(size));
    return true;
  }

  /// Expect the piece that the port took. Call it before any of its bytes can be heard.
  void sent() { end_.store(kept_until_, std::memory_order_release); }  // pairs with `hear`
  /// Forget the piece that the port did not take.
  void refused() { kept_until_ = end_.load(std::memory_order_relaxed); }

  // ---- the hearing context

  /// Take received bytes and call `pass(bytes, size)` for those of others. The last ones may be held back until the
  /// next call, while they look like the beginning of an own piece.
  template <class Pass>
  void hear(const std::uint8_t* bytes, std::size_t size, Pass&& pass) {
    const Count end = end_.load(std::memory_order_acquire);  // pairs with `sent`
    std::size_t passed = 0;
    for (std::size_t i = 0; i < size; ++i) {
      if (matched_ == 0 && first_ == end) break;
      if (matched_ != 0 && at(byte_of(piece_, matched_)) == bytes[i]) {
        if (++matched_ == size_of(piece_)) finish(piece_);
        passed = i + 1;
        continue;
      }
      const bool held_before = matched_ != 0;
      if (!held_before && !begins_with(bytes[i], end)) continue;
      if (!held_before && passed != i) pass(bytes + passed, i - passed);
      passed = match_again(bytes[i], end, pass) ? i : i + 1;
    }
    if (passed != size) pass(bytes + passed, size - passed);
    free_until(first_);
  }

  /// Give up the pieces that were not heard: each counts as a collision. Pass on the bytes that were held back.
  template <class Pass>
  void give_up(Pass&& pass) {
    const Count end = end_.load(std::memory_order_acquire);  // pairs with `sent`
    pass_held(0, matched_, pass);
    matched_ = 0;
    collisions_ += pieces_between(first_, end);
    first_ = end;
    free_until(end);
  }

  /// Expect nothing any more, because the port is closed. Counts no collision.
  void forget() {
    echoed_ += matched_;
    matched_ = 0;
    first_ = end_.load(std::memory_order_acquire);  // pairs with `sent`
    free_until(first_);
  }

  /// Check whether a piece was not heard yet.
  bool waits() const { return first_ != end_.load(std::memory_order_relaxed); }
  std::size_t held() const { return matched_; }          ///< bytes that may begin an own piece
  Count progress() const { return echoed_ + matched_; }  ///< changes while an own piece is heard
  Count echoed() const { return echoed_; }               ///< own bytes heard, modulo 2^32
  Count collisions() const { return collisions_; }       ///< pieces not heard as they were sent, modulo 2^32

 private:
  std::uint8_t at(Count place) const { return memory_[place & mask_]; }
  void put(Count place, std::uint8_t byte) { memory_[place & mask_] = byte; }
  Count size_of(Count piece) const { return static_cast<Count>(at(piece) | at(piece + 1) << 8); }
  static Count byte_of(Count piece, Count i) { return piece + static_cast<Count>(piece_overhead) + i; }
  Count after(Count piece) const { return byte_of(piece, size_of(piece)); }

  /// Called only at the end of a call: until then, held bytes are still read from pieces that are already finished.
  void free_until(Count place) { begin_.store(place, std::memory_order_release); }  // pairs with `keep`

  Count pieces_between(Count from, Count to) const {
    Count pieces = 0;
    for (; from != to; from = after(from)) ++pieces;
    return pieces;
  }

  bool begins_with(std::uint8_t byte, Count end) const {
    for (Count piece = first_; piece != end; piece = after(piece)) {
      if (at(byte_of(piece, 0)) == byte) return true;
    }
    return false;
  }

  void finish(Count piece) {
    collisions_ += pieces_between(first_, piece);
    echoed_ += size_of(piece);
    first_ = after(piece);
    matched_ = 0;
  }

  template <class Pass>
  void pass_held(Count from, Count to, Pass& pass) const {
    if (from >= to) return;
    const Count begin = byte_of(piece_, from) & mask_;
    const Count to_wrap = mask_ + 1 - begin;
    const Count size = to - from;
    pass(memory_ + begin, size < to_wrap ? size : to_wrap);
    if (size > to_wrap) pass(memory_, size - to_wrap);
  }

  /// Find the piece that the held bytes and `byte` after them match, once they no longer match the piece they were
  /// compared with; a match may begin at any of them. Returns true if `byte` belongs to no piece: the caller passes it
  /// on.
  template <class Pass>
  WIREBOND_NOINLINE bool match_again(std::uint8_t byte, Count end, Pass& pass) {
    const Count held = matched_;
    const Count held_in = piece_;
    const auto heard = [&](Count i) { return i == held ? byte : at(byte_of(held_in, i)); };
    Count passed = 0;
    Count from = 0;
    Count piece = held == 0 ? first_ : after(held_in);
    while (from <= held) {
      if (piece == end) {
        ++from;
        piece = first_;
        continue;
      }
      const Count left = held + 1 - from;
      const Count size = size_of(piece);
      Count equal = 0;
      while (equal < left && equal < size && heard(from + equal) == at(byte_of(piece, equal))) ++equal;
      if (equal != left && equal != size) {
        piece = after(piece);
        continue;
      }
      pass_held(passed, from, pass);
      if (equal != size) {
        piece_ = piece;
        matched_ = equal;
        return false;
      }
      finish(piece);
      passed = from = from + size;
      piece = first_;
    }
    pass_held(passed, held, pass);
    matched_ = 0;
    return passed <= held;
  }

  std::uint8_t* memory_;
  Count mask_;
  Count kept_until_ = 0;       ///< written by the sender
  LoadStore<Count> end_{0};    ///< end of the expected pieces; written by the sender
  LoadStore<Count> begin_{0};  ///< start of the memory in use; written by the hearer
  Count first_ = 0;            ///< the first piece not heard yet; `begin_` follows it
  Count piece_ = 0;            ///< the piece being heard, while `matched_` is not 0
  Count matched_ = 0;          ///< how many of its bytes were heard
  Count echoed_ = 0;
  Count collisions_ = 0;
};

}  // namespace wirebond
