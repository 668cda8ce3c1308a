// The good case of a run-time format, without branches for rare parts: confirms that a candidate holds, or answers
// nothing. The rules, and the reason why a candidate fails, are in examine.hpp; both must give the same answers.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>

#include "wirebond/examine.hpp"
#include "wirebond/format.hpp"
#include "wirebond/host/fast_crc.hpp"
#include "wirebond/placed_number.hpp"

namespace wirebond {

/// A form with all that can be computed before a byte comes. Immutable after construction: any thread.
///
/// Applies if the first eight bytes hold the head's constants, its id, its length and its check if it has one, and if a
/// check ends the frame. Checks must be CRCs directly after their range in their own bit order: then the register that
/// has run over such a range and its check is the same for all ranges, for any initial value (the CRC's residue). So a
/// check is one comparison, and one that continues the header's begins after it, with that residue.
class FastPath {
 public:
  FastPath() = default;

  FastPath(const FrameFormat& format, const std::array<FastCrc, max_algorithms>& crcs) {
    const Form& form = format.forms[0];
    const bool applies = format.form_count == 1 && form.exclusion_count == 0 && format.framing != Framing::sized &&
                         read_head(format, form) && read_checks(format, form, crcs);
    least_ = !applies ? SIZE_MAX : outside_ > sizeof(std::uint64_t) ? outside_ : sizeof(std::uint64_t);
    if (applies && format.framing == Framing::by_start) {
      least_by_start_ = form.prefix > sizeof(std::uint32_t) ? form.prefix : sizeof(std::uint32_t);
    }
    seals_ = applies && format.framing == Framing::by_start && form.payload_size == PayloadSize::by_length &&
             form.length_unit == 1 && form.header_count == 0 && !has_late_constants_ && form.prefix <= 8 &&
             form.suffix == form.checks[form.check_count - 1u].bytes;
    if (seals_ && form.prefix < 8) behind_prefix_ = ~std::uint64_t{0} << (8 * form.prefix);
    if (applies && form.prefix_constants == 1 && constant_bits_ == 0xFF) waiting_ = form.prefix;
  }

  /// How many bytes are needed for an answer; more than any window has if the fast path does not apply.
  std::size_t least() const { return least_; }
  /// How many bytes the head of a frame found by its start needs.
  std::size_t least_by_start() const { return least_by_start_; }

  /// Check whether so few bytes can only wait: fewer than the prefix, whose only constant is their first byte.
  WIREBOND_INLINE bool waits(const std::uint8_t* candidate, std::size_t available) const {
    return available < waiting_ && *candidate == static_cast<std::uint8_t>(constants_);
  }

  /// The decoded head of a candidate.
  struct Head {
    const MessageShape* shape = nullptr;
    std::uint32_t id = 0;
    std::size_t payload = 0;  ///< size of the payload
    std::size_t size = 0;     ///< size of the whole frame
  };

  /// Check whether examine_head would accept the head, and fill `head` then. `available` is at least least(), or
  /// least_by_start(); `whole`: the frame has `available` bytes.
  template <class Source>
  WIREBOND_INLINE bool head_holds(const Source& source, const std::uint8_t* candidate, std::size_t available,
                                  bool whole, Head& head) const {
    const std::uint64_t first = available >= 8 ? load<std::uint64_t>(candidate) : short_word(candidate, available);
    if ((first & constant_bits_) != constants_) return false;
    const std::uint64_t word = swaps_ ? __builtin_bswap64(first) : first;
    head.id = static_cast<std::uint32_t>(id_.of(word));
    head.shape = &source.message_of(head.id);
    const auto units = static_cast<std::int64_t>(length_.of(word));
    head.payload = static_cast<std::size_t>(units * length_unit_ + length_bias_);
    if (is_special_ && !special_size_holds(available, head)) return false;
    if (head.payload > max_payload_) return false;  // also where the length is too small
    head.size = head.payload + outside_;
    if (whole && head.size != available) return false;
    if (header_check_ != nullptr && header_check_->update_word(first << header_shift_) != header_residue_) return false;
    return true;
  }

  /// Check whether examine_rest would accept the frame, after head_holds accepted its head; fills `frame` then.
  WIREBOND_INLINE bool rest_holds(const std::uint8_t* candidate, const Head& head, Frame& frame) const {
    const std::size_t size = head.size;
    if (has_late_constants_) {
      for (std::size_t i = form_->prefix_constants; i < form_->constant_count; ++i) {
        const Constant& constant = form_->constants[i];
        if ((candidate[constant.at.in(size)] & constant.mask) != constant.value) return false;
      }
    }
    if (frame_check_->update(frame_begin_, candidate + frame_from_, size - frame_outside_) != frame_residue_)
      return false;
    detail::fill(frame, *form_, 0, candidate, *head.shape, head.id, head.payload, size, false);
    return true;
  }

  /// Finish the frame of `payload` bytes at buffer + prefix as `seal` would, in the format's first form with default
  /// header fields. Returns 0 if `seal` itself must make or refuse it.
  WIREBOND_INLINE std::size_t seal(std::uint8_t* buffer, std::size_t capacity, std::uint32_t id,
                                   std::size_t payload) const {
    const std::size_t size = payload + outside_;
    if (!seals_ || payload > max_payload_ || size < sizeof(std::uint64_t) || size > capacity) return 0;
    if (id > id_.mask) return 0;
    const std::int64_t units = static_cast<std::int64_t>(payload) - length_bias_;
    if (units < 0) return 0;
    const std::uint64_t numbers = (static_cast<std::uint64_t>(id) << id_.shift) |
                                  ((static_cast<std::uint64_t>(units) & length_.mask) << length_.shift);
    const std::uint64_t payload_bits = load<std::uint64_t>(buffer) & behind_prefix_;
    store(buffer, payload_bits | constants_ | (swaps_ ? __builtin_bswap64(numbers) : numbers));
    if (header_check_ != nullptr) {
      write_check(*header_check_, header_begin_, buffer, 0, form_->checks[0].at.in(0), header_xor_out_,
                  form_->checks[0]);
    }
    const CheckRule& rule = form_->checks[form_->check_count - 1u];
    write_check(*frame_check_, frame_begin_, buffer, frame_from_, rule.at.in(size), frame_xor_out_, rule);
    return size;
  }

 private:
  /// Load the first 4 to 7 bytes, followed by zeros, as if they were eight in memory.
  WIREBOND_INLINE static std::uint64_t short_word(const std::uint8_t* bytes, std::size_t size) {
    const std::size_t behind = size - sizeof(std::uint32_t);
    return load<std::uint32_t>(bytes) | std::uint64_t{load<std::uint32_t>(bytes + behind)} << (8 * behind);
  }

  /// For payloads whose size is not in the length, and messages that must be known.
  bool special_size_holds(std::size_t available, Head& head) const {
    if (payload_size_ == PayloadSize::by_id && !head.shape->known()) return false;
    if (payload_size_ == PayloadSize::by_id) head.payload = head.shape->max_payload;
    if (payload_size_ == PayloadSize::rest) head.payload = available - outside_;
    return deliver_unknown_ || detail::fits(*form_, *head.shape, head.payload);
  }

  WIREBOND_INLINE static void write_check(const FastCrc& crc, std::uint64_t begin, std::uint8_t* frame,
                                          std::size_t from, std::size_t to, std::uint64_t xor_out,
                                          const CheckRule& rule) {
    const std::uint64_t value = crc.update(begin, frame + from, to - from) ^ xor_out;
    if (rule.bytes == 2) {
      const auto half = static_cast<std::uint16_t>(value);
      store(frame + to, rule.order == ByteOrder::little ? half : __builtin_bswap16(half));
    } else {
      store_bytes(frame + to, value, rule.bytes, rule.order);
    }
  }

  /// (first eight bytes, in the numbers' order) >> shift, masked.
  struct WordNumber {
    std::uint8_t shift = 0;
    std::uint32_t mask = 0;  ///< 0: there is no such number

    WIREBOND_INLINE std::uint64_t of(std::uint64_t word) const { return (word >> shift) & mask; }
  };

  /// Both numbers are read from the same word: if they have several bytes, their byte order must be the same.
  bool read_numbers(const Form& form) {
    const Number& id = form.id;
    const Number& length = form.length;
    if (id.bytes > 1 && length.bytes > 1 && id.order != length.order) return false;
    swaps_ = (id.bytes > 1 && id.order == ByteOrder::big) || (length.bytes > 1 && length.order == ByteOrder::big);
    return read_number(id, id_) && read_number(length, length_);
  }

  bool read_number(const Number& number, WordNumber& out) const {
    if (!number.present()) return true;
    const int end = number.at.offset + number.bytes;
    if (number.at.from_end || end > 8) return false;
    out.shift = static_cast<std::uint8_t>(number.shift + 8 * (swaps_ ? 8 - end : number.at.offset));
    out.mask = static_cast<std::uint32_t>(number.mask & (detail::mask_of(8u * number.bytes) >> number.shift));
    return true;
  }

  /// What a form and its checks can say. A new member does not compile here until it is listed: then the fast path must
  /// know it (`read_head`, `leaves_residue`) or not apply, as must `is_unlisted_form`.
  static void all_members(const Form& form, const CheckRule& rule, const CheckAlgorithm& algorithm) {
    [[maybe_unused]] const auto& [prefix, suffix, prefix_constants, constant_count, header_checks, check_count,
                                  payload_size, length_unit, length_bias, fixed_payload, payload_unit, payload_rest,
                                  trims_zeros, header_count, first_exclusion, exclusion_count, length, id, id_mask,
                                  id_value, constants, checks, header] = form;
    [[maybe_unused]] const auto& [index, from, to, at, bytes, order, shift, seeded, as_hex, on_wire, continues,
                                  more_count, more, run, covers_run] = rule;
    [[maybe_unused]] const auto& [kind, width_bits, reflect_in, reflect_out, poly, init, xor_out, modulus, negate, unit,
                                  unit_is_little, odd_tail, end_around, plus, keep, bcd, avoided_count, avoided_plus,
                                  avoided] = algorithm;
  }

  bool read_head(const FrameFormat& format, const Form& form) {
    if (form.trims_zeros || (form.id.present() && !detail::id_comes_early(form))) return false;
    if (!read_numbers(form)) return false;
    for (std::size_t i = 0; i < form.prefix_constants; ++i) {
      const Constant& constant = form.constants[i];
      if (constant.at.offset >= 8) return false;
      const unsigned shift = 8u * static_cast<unsigned>(constant.at.offset);
      constant_bits_ |= static_cast<std::uint64_t>(constant.mask) << shift;
      constants_ |= static_cast<std::uint64_t>(constant.value) << shift;
    }
    form_ = &form;
    payload_size_ = form.payload_size;
    length_unit_ = form.length_unit;
    length_bias_ = form.payload_size == PayloadSize::fixed ? form.fixed_payload : form.length_bias;
    if (form.payload_size != PayloadSize::by_length) length_ = {};
    const bool is_bounded = form.payload_size == PayloadSize::by_length || form.payload_size == PayloadSize::rest;
    max_payload_ = is_bounded ? format.max_payload : SIZE_MAX;
    outside_ = static_cast<std::size_t>(form.prefix) + form.suffix;
    deliver_unknown_ = format.deliver_unknown;
    is_special_ =
        !deliver_unknown_ || form.payload_size == PayloadSize::by_id || form.payload_size == PayloadSize::rest;
    has_late_constants_ = form.constant_count != form.prefix_constants;
    return true;
  }

  bool read_checks(const FrameFormat& format, const Form& form, const std::array<FastCrc, max_algorithms>& crcs) {
    const bool has_header_check = form.header_checks == 1;
    if (form.header_checks > 1 || form.check_count != form.header_checks + 1) return false;
    for (std::size_t i = 0; i < form.check_count; ++i) {
      if (!leaves_residue(format, form.checks[i])) return false;
    }
    const CheckRule& check = form.checks[form.header_checks];
    const CheckAlgorithm& algorithm = format.algorithms[check.algorithm];
    if (!check.at.from_end) return false;
    frame_check_ = &crcs[check.algorithm];
    frame_begin_ = check_begin(algorithm);
    frame_xor_out_ = algorithm.xor_out & detail::mask_of(algorithm.width_bits);
    frame_residue_ = residue_of(algorithm, *frame_check_);
    frame_from_ = static_cast<std::size_t>(check.from.offset);
    if (has_header_check) {
      const CheckRule& earlier = form.checks[0];
      const CheckAlgorithm& of_header = format.algorithms[earlier.algorithm];
      const std::size_t end = static_cast<std::size_t>(earlier.at.offset) + earlier.bytes;
      if (earlier.at.from_end || earlier.from.offset != 0 || end > 8 || of_header.width_bits > 32) return false;
      header_check_ = &crcs[earlier.algorithm];
      header_shift_ = static_cast<unsigned>(8 * (8 - end));
      header_begin_ = check_begin(of_header);
      header_xor_out_ = of_header.xor_out & detail::mask_of(of_header.width_bits);
      const std::uint64_t residue = residue_of(of_header, *header_check_);
      header_residue_ = header_check_->word_residue(check_begin(of_header), residue, end);
      if (check.continues == 0) {
        frame_begin_ = residue;
        frame_from_ = end;
      }
    }
    frame_outside_ = frame_from_ + static_cast<std::size_t>(-check.at.offset) - check.bytes;
    return true;
  }

  static bool leaves_residue(const FrameFormat& format, const CheckRule& rule) {
    const CheckAlgorithm& a = format.algorithms[rule.algorithm];
    const bool runs_on = rule.at.from_end == rule.to.from_end && rule.at.offset == rule.to.offset &&
                         8u * rule.bytes == a.width_bits && rule.shift == 0 && !rule.seeded && !rule.as_hex &&
                         !rule.on_wire && rule.more_count == 0 && !rule.run.present();
    const bool ordered = a.width_bits == 8 || (rule.order == ByteOrder::little) == a.reflect_in;
    return a.kind == CheckKind::crc && detail::finishes_plainly(a) && a.unit == 1 && a.reflect_in == a.reflect_out &&
           runs_on && ordered && !rule.from.from_end;
  }

  /// Compute the residue. It is the same for any range; the empty one is the shortest.
  static std::uint64_t residue_of(const CheckAlgorithm& a, const FastCrc& crc) {
    std::uint8_t check[8];
    const unsigned bytes = a.width_bits / 8u;
    store_bytes(check, check_end(a, check_begin(a)), bytes, a.reflect_in ? ByteOrder::little : ByteOrder::big);
    return crc.update(check_begin(a), check, bytes);
  }

  const Form* form_ = nullptr;
  std::uint64_t constant_bits_ = 0;
  std::uint64_t constants_ = 0;
  bool swaps_ = false;  ///< the numbers are big-endian
  WordNumber id_{};
  WordNumber length_{};
  PayloadSize payload_size_ = PayloadSize::fixed;
  bool deliver_unknown_ = false;
  bool has_late_constants_ = false;
  bool is_special_ = false;  ///< special_size_holds must be called
  std::int64_t length_unit_ = 1;
  std::int64_t length_bias_ = 0;  ///< a fixed size, where there is no length
  std::size_t max_payload_ = 0;
  std::size_t outside_ = 0;
  std::size_t least_ = SIZE_MAX;
  std::size_t least_by_start_ = SIZE_MAX;
  bool seals_ = false;
  std::uint64_t behind_prefix_ = 0;  ///< mask of the payload's bytes among the first eight
  std::uint64_t header_begin_ = 0;
  std::uint64_t header_xor_out_ = 0;
  std::uint64_t frame_xor_out_ = 0;
  std::size_t waiting_ = 0;                ///< size of the prefix if `waits` may answer true
  const FastCrc* header_check_ = nullptr;  ///< null: there is none
  std::uint64_t header_residue_ = 0;
  unsigned header_shift_ = 0;
  const FastCrc* frame_check_ = nullptr;
  std::uint64_t frame_begin_ = 0;
  std::uint64_t frame_residue_ = 0;
  std::size_t frame_from_ = 0;
  std::size_t frame_outside_ = 0;  ///< bytes of the frame that the check does not cover
};

}  // namespace wirebond
