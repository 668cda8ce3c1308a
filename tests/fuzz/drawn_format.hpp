// A frame format drawn from a fuzzer's bytes, valid by the rules of the loader of protocol files. No stream, no frame.
#pragma once

#include <fuzzer/FuzzedDataProvider.h>

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <vector>

#include "described.hpp"

namespace fuzz {

/// Draws the parts of a frame as a protocol file lists them and lowers them to offsets, as
/// wirebond.protocol.plan does. Every byte sequence gives a format; the same bytes give the same one.
class FormatDrawer {
 public:
  explicit FormatDrawer(FuzzedDataProvider& input) : input_(input) {}

  Described draw() {
    draw_envelope();
    draw_parts();
    draw_conditions();
    draw_checks();
    draw_sizes();
    for (std::size_t magic = 0; magic < magics_.size(); ++magic) {
      for (unsigned truths = 0; truths < 1u << conditions_.size(); ++truths) lower(magic, truths);
    }
    draw_messages();
    return out_;
  }

 private:
  enum class Kind { magic, constant, length, id, field, reserved, bits, payload, check };
  enum class Role { length, id, field, constant, reserved };

  struct Run {  // bits that mean something together
    Role role;
    unsigned shift;
    unsigned width;
    std::uint32_t value;
  };

  struct Part {
    Kind kind;
    std::size_t size;
    wirebond::ByteOrder order = wirebond::ByteOrder::little;
    std::vector<std::uint8_t> value{};
    std::vector<Run> runs{};
    int condition = -1;  // there only when this condition holds
    std::size_t first = 0, last = 0;
    wirebond::CheckRule check{};
  };

  struct Condition {  // a bit of a header field
    std::size_t part;
    std::size_t run;
    unsigned bit;
  };

  unsigned number(unsigned low, unsigned high) { return input_.ConsumeIntegralInRange(low, high); }
  bool chance(unsigned of) { return number(0, of - 1) == of - 1; }
  std::uint8_t byte() { return input_.ConsumeIntegral<std::uint8_t>(); }
  wirebond::ByteOrder order() { return input_.ConsumeBool() ? wirebond::ByteOrder::big : wirebond::ByteOrder::little; }
  std::vector<std::uint8_t> some_bytes(unsigned least, unsigned most) {
    std::vector<std::uint8_t> bytes(number(least, most));
    for (std::uint8_t& one : bytes) one = byte();
    return bytes;
  }

  // ---- what stands around the parts

  void draw_envelope() {
    wirebond::FrameFormat& format = out_.format;
    static constexpr unsigned kinds = 9;
    const unsigned kind = number(0, kinds - 1);
    format.sends_opening = input_.ConsumeBool();
    if (kind <= 2) return;  // most formats of the field are found by their start
    if (kind == 3) {
      format.framing = wirebond::Framing::silence;
      return;
    }
    format.framing = wirebond::Framing::delimited;
    wirebond::EscapeRule& rule = format.escapes;
    if (kind == 4) {
      format.stuffing = wirebond::Stuffing::cobs;
    } else if (kind == 5) {
      format.stuffing = wirebond::Stuffing::escape;
      format.closing = {1, 0xC0};
      rule = {0xDB, 0, 2, {0xC0, 0xDB}, {0xDC, 0xDD}};
    } else if (kind == 6) {
      format.stuffing = wirebond::Stuffing::escape;
      format.closing = {1, 0x7E};
      rule = {0x7D, 0x20, 2, {0x7E, 0x7D}, {0x5E, 0x5D}};
    } else {
      format.closing = {1, byte()};
      const wirebond::Mark opening{1, byte()};
      if (format.sends_opening && opening.first != format.closing.first) format.framing = wirebond::Framing::bracketed;
      format.opening = format.framing == wirebond::Framing::bracketed ? opening : format.closing;
      if (kind == 7) draw_escapes();
      return;
    }
    format.opening = format.closing;
  }

  void draw_escapes() {
    wirebond::FrameFormat& format = out_.format;
    wirebond::EscapeRule rule;
    rule.escape = byte();
    rule.exclusive_or = byte();
    std::vector<std::uint8_t> plain = {format.closing.first, format.opening.first, rule.escape};
    for (const std::uint8_t also : some_bytes(0, 3)) plain.push_back(also);
    bool frees = rule.exclusive_or != 0 && rule.escape != format.closing.first && rule.escape != format.opening.first;
    for (const std::uint8_t one : plain) {
      const auto code = static_cast<std::uint8_t>(one ^ rule.exclusive_or);
      frees = frees && code != format.closing.first && code != format.opening.first;
      if (std::find(rule.plain.begin(), rule.plain.begin() + rule.count, one) != rule.plain.begin() + rule.count) {
        continue;
      }
      rule.plain[rule.count] = one;
      rule.code[rule.count++] = code;
    }
    if (!frees) return;  // a rule that puts a delimiter on the line: nothing is stuffed then
    format.stuffing = wirebond::Stuffing::escape;
    format.escapes = rule;
  }

  // ---- parts, in wire order

  void draw_parts() {
    const bool by_start = out_.format.framing == wirebond::Framing::by_start;
    const bool may_rest = !by_start;
    const unsigned rule = number(0, may_rest ? 5 : 2);
    rule_ = rule == 0   ? wirebond::PayloadSize::by_length
            : rule == 1 ? wirebond::PayloadSize::by_id
            : rule == 2 ? wirebond::PayloadSize::fixed
                        : wirebond::PayloadSize::rest;
    std::vector<Part> head;
    const bool by_id = rule_ == wirebond::PayloadSize::by_id;
    const unsigned id_place = by_id ? number(0, 1) : number(0, 3);  // a part, in bits, behind the payload, absent
    const bool length_in_bits = input_.ConsumeBool();
    if (rule_ == wirebond::PayloadSize::by_length && !length_in_bits)
      head.push_back({Kind::length, number(1, 4), order()});
    if (id_place == 0) head.push_back({Kind::id, number(1, 4), order()});
    if (chance(3)) add_constant(head, number(1, 2));
    if (chance(3)) head.push_back({Kind::reserved, number(1, 3)});
    if (chance(3)) head.push_back({Kind::field, number(1, 8), order()});
    const bool bits_length = rule_ == wirebond::PayloadSize::by_length && length_in_bits;
    if (bits_length || id_place == 1 || chance(3)) head.push_back(draw_bits(bits_length, id_place == 1));
    if (by_start || chance(3)) {
      magics_.push_back(some_bytes(1, 4));
      if (chance(3)) {
        std::vector<std::uint8_t> other = magics_[0];
        for (std::uint8_t& one : other) one = byte();
        if (other != magics_[0]) magics_.push_back(other);
      }
      parts_.push_back({Kind::magic, magics_[0].size()});
    } else {
      magics_.emplace_back();
    }
    while (!head.empty()) {
      const std::size_t next = number(0, static_cast<unsigned>(head.size() - 1));
      parts_.push_back(head[next]);
      head.erase(head.begin() + static_cast<std::ptrdiff_t>(next));
    }
    header_check_ = chance(3);
    payload_ = parts_.size();
    parts_.push_back({Kind::payload, 0});
    id_late_ = id_place == 2;
    if (id_late_) parts_.push_back({Kind::id, number(1, 4), order()});
    if (chance(4)) parts_.push_back({Kind::reserved, number(1, 2)});
    if (chance(4)) parts_.push_back({Kind::field, number(1, 8), order()});
    trailing_checks_ = number(by_start ? 1 : 0, 2);
    if (chance(3)) tail_ = some_bytes(1, 2);
  }

  void add_constant(std::vector<Part>& to, unsigned size) {
    Part part{Kind::constant, size};
    for (unsigned i = 0; i < size; ++i) part.value.push_back(byte());
    to.push_back(part);
  }

  Part draw_bits(bool with_length, bool with_id) {
    Part part{Kind::bits, number(1, 4), order()};
    unsigned left = static_cast<unsigned>(8 * part.size);
    unsigned shift = 0;
    const auto take = [&](Role role, unsigned most) {
      const unsigned width = number(1, most);
      const std::uint32_t mask = static_cast<std::uint32_t>(wirebond::detail::mask_of(width));
      part.runs.push_back({role, shift, width, input_.ConsumeIntegral<std::uint32_t>() & mask});
      shift += width;
      left -= width;
    };
    if (with_length) take(Role::length, with_id ? left - 1 : left);
    if (with_id) take(Role::id, left);
    if (left > 0 && chance(2)) take(Role::field, left);
    if (left > 0 && chance(2)) take(Role::constant, left);
    if (left > 0) part.runs.push_back({Role::reserved, shift, left, 0});
    return part;
  }

  // ---- parts that are there only when a header bit says so

  void draw_conditions() {
    for (std::size_t i = 0; i < payload_ && conditions_.empty(); ++i) {
      const Part part = parts_[i];  // a copy: parts are put in
      if (part.kind == Kind::field && chance(2)) {
        add_conditional_parts(i, 0, static_cast<unsigned>(8 * part.size));
        break;
      }
      for (std::size_t run = 0; run < part.runs.size() && conditions_.empty(); ++run) {
        if (part.runs[run].role == Role::field && chance(2)) add_conditional_parts(i, run, part.runs[run].width);
      }
    }
  }

  void add_conditional_parts(std::size_t part, std::size_t run, unsigned width) {
    const unsigned count = number(1, magics_.size() == 1 ? 2 : 1);
    for (unsigned i = 0; i < count; ++i) {
      const unsigned bit = number(0, width - 1);
      if (!conditions_.empty() && conditions_[0].bit == bit) continue;
      Part optional{input_.ConsumeBool() ? Kind::reserved : Kind::field, number(1, 8), order()};
      optional.condition = static_cast<int>(conditions_.size());
      conditions_.push_back({part, run, bit});
      const bool behind = chance(4);
      parts_.insert(behind ? parts_.end() : parts_.begin() + static_cast<std::ptrdiff_t>(payload_), optional);
      payload_ += behind ? 0 : 1;
    }
  }

  // ---- checks

  void draw_checks() {
    if (header_check_) {
      const std::size_t at = payload_;
      if (at != 0) {
        insert_check(at, number(0, static_cast<unsigned>(at - 1)), at - 1);
        ++payload_;
      }
    }
    for (unsigned i = 0; i < trailing_checks_; ++i) {
      const std::size_t at = parts_.size();
      const std::size_t first = chance(2) ? 0 : number(0, static_cast<unsigned>(payload_));
      insert_check(at, first, chance(2) ? at - 1 : payload_);
      if (conditions_.size() == 1 && chance(4)) parts_.back().condition = 0;
    }
    if (!tail_.empty()) {
      parts_.push_back({Kind::constant, tail_.size()});
      parts_.back().value = tail_;
    }
  }

  void insert_check(std::size_t at, std::size_t first, std::size_t last) {
    Part part{Kind::check, 0, order()};
    const wirebond::CheckAlgorithm algorithm = draw_algorithm();
    wirebond::CheckRule& rule = part.check;
    rule.algorithm = out_.format.algorithm_count;
    out_.format.algorithms[out_.format.algorithm_count++] = algorithm;
    rule.bytes = algorithm.width_bits / 8;
    if (rule.bytes == 2 && chance(4)) {
      rule.bytes = 1;
      rule.shift = chance(2) ? 8 : 0;
    }
    rule.seeded = (at != payload_ || !id_late_) && chance(6);  // a check of the header needs the id before it
    seeded_ = seeded_ || rule.seeded;
    rule.as_hex = chance(6);
    rule.order = part.order;
    part.size = rule.as_hex ? 2u * rule.bytes : rule.bytes;
    part.first = first;
    part.last = last;
    parts_.insert(parts_.begin() + static_cast<std::ptrdiff_t>(at), part);
  }

  wirebond::CheckAlgorithm draw_algorithm() {
    wirebond::CheckAlgorithm algorithm;
    algorithm.kind = static_cast<wirebond::CheckKind>(number(0, 3));
    static constexpr std::uint8_t widths[] = {8, 16, 24, 32, 64};
    const bool is_crc = algorithm.kind == wirebond::CheckKind::crc;
    algorithm.width_bits = widths[number(0, is_crc ? 4 : 3)];
    const std::uint64_t mask = wirebond::detail::mask_of(algorithm.width_bits);
    algorithm.xor_out = input_.ConsumeIntegral<std::uint64_t>() & mask;
    if (is_crc) {
      algorithm.poly = (input_.ConsumeIntegral<std::uint64_t>() & mask) | 1u;
      algorithm.init = input_.ConsumeIntegral<std::uint64_t>() & mask;
      algorithm.reflect_in = input_.ConsumeBool();
      algorithm.reflect_out = input_.ConsumeBool();
      return algorithm;
    }
    // Of sums and the like there are those of the loader's catalogue.
    algorithm.xor_out = chance(2) ? mask : 0;
    if (algorithm.kind == wirebond::CheckKind::exclusive_or) algorithm.width_bits = 8;
    if (algorithm.kind == wirebond::CheckKind::sum && algorithm.width_bits == 24) algorithm.width_bits = 32;
    if (algorithm.kind == wirebond::CheckKind::sum) algorithm.negate = chance(4);
    if (algorithm.kind == wirebond::CheckKind::fletcher) {
      algorithm.width_bits = 16;
      algorithm.xor_out = 0;
      algorithm.modulus = chance(2) ? 255 : 256;
    }
    return algorithm;
  }

  // ---- how long a payload may be

  void draw_sizes() {
    out_.format.max_payload = static_cast<std::uint16_t>(chance(8) ? number(0, 3000) : number(0, 80));
    trims_ = (rule_ == wirebond::PayloadSize::by_length || rule_ == wirebond::PayloadSize::rest) && chance(6);
    if (rule_ != wirebond::PayloadSize::by_length) return;
    counts_ = number(0, 3);
    static constexpr std::uint8_t units[] = {1, 1, 1, 2, 4};
    length_unit_ = trims_ ? std::uint8_t{1} : units[number(0, 4)];
    length_offset_ = static_cast<int>(number(0, 4));
    length_bits_ = 0;
    for (const Part& part : parts_) {
      if (part.kind == Kind::length) length_bits_ = static_cast<unsigned>(8 * part.size);
      for (const Run& run : part.runs) length_bits_ = run.role == Role::length ? run.width : length_bits_;
    }
    const std::int64_t longest = static_cast<std::int64_t>(wirebond::detail::mask_of(length_bits_)) * length_unit_ -
                                 beside(parts_) - length_offset_;
    if (longest < 0) {  // the loader refuses it: count the payload alone
      counts_ = 0;
      length_offset_ = 0;
    }
    const std::int64_t most = static_cast<std::int64_t>(wirebond::detail::mask_of(length_bits_)) * length_unit_ -
                              beside(parts_) - length_offset_;
    if (out_.format.max_payload > most) out_.format.max_payload = static_cast<std::uint16_t>(most);
  }

  /// Bytes that the length counts beside the payload.
  std::int64_t beside(const std::vector<Part>& parts) const {
    std::size_t all = 0;
    std::size_t behind = 0;
    std::size_t own = 0;
    bool passed = false;
    for (const Part& part : parts) {
      all += part.size;
      if (passed) behind += part.size;
      const bool holds =
          part.kind == Kind::length ||
          std::any_of(part.runs.begin(), part.runs.end(), [](const Run& run) { return run.role == Role::length; });
      if (holds) {
        own = part.size;
        passed = true;
      }
    }
    return static_cast<std::int64_t>(counts_ == 0 ? 0 : counts_ == 1 ? behind : counts_ == 2 ? own + behind : all);
  }

  // ---- one form of the frame to offsets

  void lower(std::size_t magic, unsigned truths) {
    std::vector<Part> parts;
    std::vector<std::size_t> place(parts_.size() + 1, 0);  // of a part of the file, among those that are there
    for (std::size_t i = 0; i < parts_.size(); ++i) {
      place[i] = parts.size();
      const Part& part = parts_[i];
      if (part.condition < 0 || (truths >> part.condition & 1u) != 0) parts.push_back(part);
    }
    place[parts_.size()] = parts.size();
    const std::size_t payload = place[payload_];
    std::vector<std::int32_t> starts(parts.size() + 1, 0);
    for (std::size_t i = 0; i < parts.size(); ++i) starts[i + 1] = starts[i] + static_cast<std::int32_t>(parts[i].size);
    const std::int32_t end = starts[parts.size()];
    const auto start_of = [&](std::size_t i) -> wirebond::Position {
      if (i <= payload) return {static_cast<std::int16_t>(starts[i]), false};
      return {static_cast<std::int16_t>(starts[i] - end), true};
    };
    const auto end_of = [&](std::size_t i) -> wirebond::Position {  // behind part i - 1
      if (i <= payload) return {static_cast<std::int16_t>(starts[i]), false};
      return {static_cast<std::int16_t>(starts[i] - end), true};
    };

    wirebond::Form form;
    form.prefix = static_cast<std::uint16_t>(starts[payload]);
    form.suffix = static_cast<std::uint16_t>(end - starts[payload]);
    form.payload_size = rule_;
    form.fixed_payload = rule_ == wirebond::PayloadSize::fixed ? out_.format.max_payload : std::uint16_t{0};
    form.trims_zeros = trims_;
    std::vector<wirebond::Constant> before;
    std::vector<wirebond::Constant> after;
    for (std::size_t i = 0; i < parts.size(); ++i) {
      const Part& part = parts[i];
      const wirebond::Position at = start_of(i);
      std::vector<wirebond::Constant>& constants = i < payload ? before : after;
      const auto size = static_cast<std::uint8_t>(part.size);
      const wirebond::Number whole{at, size, part.order, 0, wirebond::detail::mask_of(8u * size)};
      const std::vector<std::uint8_t>& value = part.kind == Kind::magic ? magics_[magic] : part.value;
      for (std::size_t j = 0; j < value.size(); ++j) {
        constants.push_back(
            {{static_cast<std::int16_t>(at.offset + static_cast<int>(j)), at.from_end}, 0xFF, value[j]});
      }
      if (part.kind == Kind::length) form.length = whole;
      if (part.kind == Kind::id) form.id = whole;
      if (part.kind == Kind::field) add_header(form, whole, 0);
      for (const Run& run : part.runs) {
        const wirebond::Number bits{at, size, part.order, static_cast<std::uint8_t>(run.shift),
                                    wirebond::detail::mask_of(run.width)};
        if (run.role == Role::length) form.length = bits;
        if (run.role == Role::id) form.id = bits;
        if (run.role == Role::field) add_header(form, bits, run.value);
        if (run.role == Role::constant) add_bits(constants, bits, run.value);
      }
    }
    if (form.length.present()) {
      form.length_unit = length_unit_;
      form.length_bias = static_cast<std::int32_t>(-beside(parts) - length_offset_);
    }
    for (std::size_t i = 0; i < conditions_.size(); ++i) {
      const Condition& condition = conditions_[i];
      const std::size_t part = place[condition.part];
      const Part& holder = parts[part];
      const unsigned shift = holder.runs.empty() ? 0 : holder.runs[condition.run].shift;
      const wirebond::Number bit{start_of(part), static_cast<std::uint8_t>(holder.size), holder.order,
                                 static_cast<std::uint8_t>(shift + condition.bit), 1};
      add_bits(before, bit, truths >> i & 1u);
    }
    std::stable_sort(before.begin(), before.end(),
                     [](const auto& one, const auto& other) { return one.at.offset < other.at.offset; });
    form.prefix_constants = static_cast<std::uint8_t>(before.size());
    before.insert(before.end(), after.begin(), after.end());
    form.constant_count = static_cast<std::uint8_t>(before.size());
    std::copy(before.begin(), before.end(), form.constants.begin());

    for (const bool late : {false, true}) {
      for (std::size_t i = 0; i < parts.size(); ++i) {
        const Part& part = parts[i];
        if (part.kind != Kind::check) continue;
        const std::size_t first = place[part.first];
        const std::size_t behind = place[part.last + 1];
        if ((i < payload && behind <= payload) == late) continue;
        wirebond::CheckRule rule = part.check;
        rule.from = start_of(first);
        rule.to = end_of(behind);
        rule.at = start_of(i);
        for (std::size_t j = 0; j < form.check_count; ++j) {
          const wirebond::CheckRule& earlier = form.checks[j];
          const bool same = earlier.algorithm == rule.algorithm && earlier.from.offset == rule.from.offset &&
                            earlier.from.from_end == rule.from.from_end;
          const bool inside = !earlier.to.from_end && (rule.to.from_end || earlier.to.offset <= rule.to.offset);
          if (same && inside) rule.continues = static_cast<std::int8_t>(j);
        }
        form.checks[form.check_count++] = rule;
        if (!late) ++form.header_checks;
      }
    }
    out_.format.forms[forms_++] = form;
    out_.format.form_count = static_cast<std::uint8_t>(forms_);
  }

  static void add_header(wirebond::Form& form, const wirebond::Number& number, std::uint64_t value) {
    const std::uint8_t place = form.header_count;  // these forms have no list in common: each counts its own
    form.header[form.header_count++] = {number, value, place};
  }

  static void add_bits(std::vector<wirebond::Constant>& to, const wirebond::Number& number, std::uint32_t value) {
    const std::uint64_t mask = number.mask << number.shift;
    const std::uint64_t bits = static_cast<std::uint64_t>(value) << number.shift;
    for (unsigned i = 0; i < number.bytes; ++i) {
      const unsigned place = 8 * (number.order == wirebond::ByteOrder::little ? i : number.bytes - 1u - i);
      const auto byte_mask = static_cast<std::uint8_t>(mask >> place);
      if (byte_mask == 0) continue;
      const wirebond::Position at{static_cast<std::int16_t>(number.at.offset + static_cast<int>(i)),
                                  number.at.from_end};
      to.push_back({at, byte_mask, static_cast<std::uint8_t>(bits >> place & byte_mask)});
    }
  }

  // ---- messages

  void draw_messages() {
    wirebond::FrameFormat& format = out_.format;
    const wirebond::Number& id = format.forms[0].id;
    const bool by_id = rule_ == wirebond::PayloadSize::by_id;
    format.deliver_unknown = input_.ConsumeBool() && !by_id && !seeded_;
    const unsigned count = id.present() ? number(1, 4) : 1;
    const unsigned unit = format.forms[0].length_unit;
    for (unsigned i = 0; i < count; ++i) {
      wirebond::MessageRow row;
      row.id = id.present() ? static_cast<std::uint32_t>(input_.ConsumeIntegral<std::uint32_t>() & id.mask) : 0;
      const bool taken = std::any_of(out_.rows.begin(), out_.rows.end(), [&](const auto& r) { return r.id == row.id; });
      if (taken) continue;
      const unsigned most = number(0, format.max_payload);
      const unsigned least = by_id || trims_ || unit > 1 ? most : number(0, most);
      row.shape = {static_cast<std::int16_t>(i), static_cast<std::uint16_t>(least), static_cast<std::uint16_t>(most),
                   seeded_ ? byte() : std::uint8_t{0}};
      out_.rows.push_back(row);
    }
    std::sort(out_.rows.begin(), out_.rows.end(), [](const auto& one, const auto& other) { return one.id < other.id; });
  }

  FuzzedDataProvider& input_;
  Described out_{};
  std::vector<Part> parts_;
  std::size_t payload_ = 0;
  std::vector<std::vector<std::uint8_t>> magics_;
  std::vector<std::uint8_t> tail_;
  std::vector<Condition> conditions_;
  wirebond::PayloadSize rule_ = wirebond::PayloadSize::fixed;
  bool header_check_ = false;
  bool id_late_ = false;
  unsigned trailing_checks_ = 0;
  bool seeded_ = false;
  bool trims_ = false;
  unsigned counts_ = 0;
  std::uint8_t length_unit_ = 1;
  unsigned length_bits_ = 0;
  int length_offset_ = 0;
  std::size_t forms_ = 0;
};

}  // namespace fuzz
