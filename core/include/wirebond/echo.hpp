// A line on which an end hears what it sends: which received bytes are its own. Bytes in, bytes of others out: no
// frame, no port, no clock.
#pragma once

#include <atomic>
#include <cstddef>
#include <cstdint>

#include "wirebond/bytes.hpp"
#include "wirebond/load_store.hpp"

namespace wirebond {

/// Two wires of RS-485, or one wire for both directions: what an end sends comes back to its own receiver. Each piece
/// that it sends is kept here until it was heard. What comes is compared with it, and whatever is not an own piece from
/// its first to its last byte is passed on, in its order. So no byte of another sender is lost, wherever it stands:
/// before the echo, because it was not read yet, or in its place, because there was no echo.
///
/// A piece that is not heard as it was sent is a collision: another end sent at the same time, a byte was disturbed, or
/// the line does not echo. That is known when a later piece is heard, or when the caller gives up.
///
/// The memory holds the pieces, each behind two bytes with its size. One context sends (`keep` to `refused`), one
/// hears; the sender may interrupt the hearer. Neither waits. A byte is compared with each piece that is not heard yet;
/// where a piece breaks off, again from each of its bytes. While nothing is to be heard, bytes are passed on untouched.
class Echo {
 public:
  using Count = std::uint32_t;

  static constexpr std::size_t piece_overhead = 2;

  /// `size`: a power of two. The memory outlives this object. A piece has 65535 bytes at most.
  Echo(std::uint8_t* memory, std::size_t size) : memory_(memory), mask_(static_cast<Count>(size - 1)) {}
  Echo(const Echo&) = delete;
  Echo& operator=(const Echo&) = delete;

  // ---- who sends

  /// Keep a piece that is about to leave; then call `sent` or `refused`. False: there is no room, because too much was
  /// not heard yet. Send it later.
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

  /// The port took it: it is expected from here on. Before any of its bytes can be heard.
  void sent() { end_.store(kept_until_, std::memory_order_release); }  // pairs with `hear`
  /// The port did not take it.
  void refused() { kept_until_ = end_.load(std::memory_order_relaxed); }

  // ---- who hears

  /// These bytes came. `pass(bytes, size)` is called for those of others; the last of them may be held back until the
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

  /// What has not been heard by now does not come any more: a collision each. What is held back is passed on.
  template <class Pass>
  void give_up(Pass&& pass) {
    const Count end = end_.load(std::memory_order_acquire);  // pairs with `sent`
    pass_held(0, matched_, pass);
    matched_ = 0;
    collisions_ += pieces_between(first_, end);
    first_ = end;
    free_until(end);
  }

  /// The port is away: nothing is expected any more, and nothing was a collision.
  void forget() {
    echoed_ += matched_;
    matched_ = 0;
    first_ = end_.load(std::memory_order_acquire);  // pairs with `sent`
    free_until(first_);
  }

  /// Is there a piece that was not heard yet?
  bool waits() const { return first_ != end_.load(std::memory_order_relaxed); }
  std::size_t held() const { return matched_; }          ///< bytes that may be an own piece's beginning
  Count progress() const { return echoed_ + matched_; }  ///< changes while an own piece is heard
  Count echoed() const { return echoed_; }               ///< own bytes that were heard, modulo 2^32
  Count collisions() const { return collisions_; }       ///< pieces that were not heard as they were sent, modulo 2^32

 private:
  std::uint8_t at(Count place) const { return memory_[place & mask_]; }
  void put(Count place, std::uint8_t byte) { memory_[place & mask_] = byte; }
  Count size_of(Count piece) const { return static_cast<Count>(at(piece) | at(piece + 1) << 8); }
  static Count byte_of(Count piece, Count i) { return piece + static_cast<Count>(piece_overhead) + i; }
  Count after(Count piece) const { return byte_of(piece, size_of(piece)); }

  /// Only at the end of a call: until then held bytes are looked at in pieces that are done with.
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

  /// The held bytes and `byte` behind them are not the piece that they were compared with. Which piece are they, from
  /// which of them on? True: `byte` is of no piece, and the caller passes it on.
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
  Count kept_until_ = 0;       ///< by who sends
  LoadStore<Count> end_{0};    ///< of the pieces that are expected; by who sends
  LoadStore<Count> begin_{0};  ///< of the room that is in use; by who hears
  Count first_ = 0;            ///< the first piece that was not heard; `begin_` follows
  Count piece_ = 0;            ///< the one that is being heard, where `matched_` is not 0
  Count matched_ = 0;          ///< of its bytes
  Count echoed_ = 0;
  Count collisions_ = 0;
};

}  // namespace wirebond
