// A format that is read at run time: any protocol file, no code generation.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>

#include "wirebond/format.hpp"
#include "wirebond/host/fast_crc.hpp"
#include "wirebond/host/fast_path.hpp"
#include "wirebond/match.hpp"
#include "wirebond/payload_rules.hpp"

namespace wirebond {

/// One row of the message table. The table is sorted by id; of one id, rows that are `only_expected` come first.
struct MessageRow {
  std::uint32_t id = 0;
  MessageShape shape{};
  bool only_expected = false;  ///< shares its id, and counts only while it is expected
  PayloadRules rules{};        ///< points to tables that the caller keeps
  MatchTests tests{};          ///< points to tables that the caller keeps; none if ids identify all messages
};

/// Tables computed once for a format. They point to the format and the rows: the caller keeps those alive. Immutable
/// after construction: any thread.
class RuntimeTables {
 public:
  /// `matches`: the rows' tests identify the messages, not their ids; `matches_late`: also by bytes that are not before
  /// the payload.
  RuntimeTables(const FrameFormat& format, const MessageRow* rows, std::size_t row_count,
                CrcMethod method = CrcMethod::automatic, bool matches = false, bool matches_late = false)
      : format_(&format),
        start_(one_start(format)),
        rows_(rows),
        row_count_(row_count),
        matches_(matches),
        matches_late_(matches_late) {
    for (std::size_t i = 0; i < format.algorithm_count; ++i) {
      const CheckAlgorithm& a = format.algorithms[i];
      if (a.kind == CheckKind::crc) crcs_[i] = FastCrc(a, method);
      begins_[i] = check_begin(a);
      ends_plainly_[i] = detail::finishes_plainly(a) && !detail::reflects_end(a) && a.unit == 1;
    }
    for (std::size_t i = 0; i < row_count; ++i) {
      has_expected_ = has_expected_ || rows[i].only_expected;
      has_rules_ = has_rules_ || rows[i].rules.constant_count != 0 || rows[i].rules.count_count != 0;
      if (rows[i].id < low_ids_.size()) low_ids_[rows[i].id] = rows[i].shape;
    }
    // The fast path identifies messages by their id alone, and reads no payload.
    if (!has_expected_ && !has_rules_ && !matches_) fast_path_ = FastPath(format, crcs_);
  }

  RuntimeTables(const RuntimeTables&) = delete;  // the fast path points into them
  RuntimeTables& operator=(const RuntimeTables&) = delete;

  const FrameFormat& format() const { return *format_; }
  const FastPath& fast_path() const { return fast_path_; }
  int start() const { return start_; }

  /// Return the message of this id, where no id is shared.
  const MessageShape& message(std::uint32_t id) const {
    if (id < low_ids_.size()) return low_ids_[id];
    const std::size_t row = first_row(id);
    return row < row_count_ && rows_[row].id == id ? rows_[row].shape : unknown_;
  }

  /// Return the message of this id while the message `expected` is expected (-1: none).
  const MessageShape& message(std::uint32_t id, std::int16_t expected) const {
    if (!has_expected_) return message(id);
    for (std::size_t row = first_row(id); row < row_count_ && rows_[row].id == id; ++row) {
      if (!rows_[row].only_expected || rows_[row].shape.index == expected) return rows_[row].shape;
    }
    return unknown_;
  }

  bool matches() const { return matches_; }
  bool matches_late() const { return matches_late_; }

  /// Return the message whose tests hold, while the message `expected` is expected. O(rows).
  template <class Asked>
  MessageShape match(const Asked& asked, std::int16_t expected) const {
    const auto find = [&](bool is_expected) -> const MessageRow* {
      for (std::size_t row = 0; row < row_count_; ++row) {
        if (rows_[row].only_expected != is_expected || (is_expected && rows_[row].shape.index != expected)) continue;
        if (detail::all_hold(rows_[row].tests, asked)) return &rows_[row];
      }
      return nullptr;
    };
    const MessageRow* found = has_expected_ ? find(true) : nullptr;
    if (found == nullptr) found = find(false);
    return found == nullptr ? unknown_ : found->shape;
  }

  /// Return the rules over the payload of the message `index`. O(rows), if any message has some.
  PayloadRules payload_rules(std::int16_t index) const {
    for (std::size_t row = 0; has_rules_ && row < row_count_; ++row) {
      if (rows_[row].shape.index == index) return rows_[row].rules;
    }
    return {};
  }

  std::uint64_t check_begin_of(unsigned index) const { return begins_[index]; }

  std::uint64_t check_update(unsigned index, std::uint64_t reg, const std::uint8_t* bytes, std::size_t size) const {
    const CheckAlgorithm& a = format_->algorithms[index];
    if (a.kind != CheckKind::crc) return sum_update(a, reg, bytes, size);
    const FastCrc& crc = crcs_[index];
    if (a.unit == 1) return crc.update(reg, bytes, size);
    return detail::by_words(a, reg, bytes, size, [&](std::uint32_t value, std::uint32_t word) {
      return static_cast<std::uint32_t>(crc.update(value, detail::ordered(a, word).at, a.unit));
    });
  }

  std::uint64_t check_end_of(unsigned index, std::uint64_t reg) const {
    const CheckAlgorithm& a = format_->algorithms[index];
    return ends_plainly_[index] ? reg ^ a.xor_out : check_end(a, reg);
  }

 private:
  std::size_t first_row(std::uint32_t id) const {
    std::size_t low = 0;
    std::size_t high = row_count_;
    while (low < high) {
      const std::size_t middle = low + (high - low) / 2;
      if (rows_[middle].id < id) {
        low = middle + 1;
      } else {
        high = middle;
      }
    }
    return low;
  }

  const FrameFormat* format_;
  int start_;
  const MessageRow* rows_;
  std::size_t row_count_;
  bool has_expected_ = false;
  bool has_rules_ = false;
  bool matches_ = false;
  bool matches_late_ = false;
  std::array<std::uint64_t, max_algorithms> begins_{};
  std::array<bool, max_algorithms> ends_plainly_{};
  MessageShape unknown_{};
  std::array<MessageShape, 256> low_ids_{};
  std::array<FastCrc, max_algorithms> crcs_{};
  FastPath fast_path_{};
};

/// A source that points to tables; the caller keeps them alive. Copies are cheap.
class RuntimeSource {
 public:
  static constexpr bool is_constant = false;
  using FastPath = wirebond::FastPath;

  explicit RuntimeSource(const RuntimeTables& tables)
      : format_(&tables.format()),
        tables_(&tables),
        ends_by_silence_(format_->framing == Framing::silence),
        matches_(tables.matches()) {}

  const FrameFormat& format() const { return *format_; }
  bool ends_by_silence() const { return ends_by_silence_; }
  const FastPath& fast_path() const { return tables_->fast_path(); }
  int start() const { return tables_->start(); }
  MessageShape message(std::uint32_t id) const { return tables_->message(id, expected_); }
  /// For the fast path, which does not apply if an id is shared.
  const MessageShape& message_of(std::uint32_t id) const { return tables_->message(id); }
  bool matches() const { return matches_; }
  bool matches_late() const { return tables_->matches_late(); }
  template <class Asked>
  MessageShape match(const Asked& asked) const {
    return tables_->match(asked, expected_);
  }
  PayloadRules payload_rules(std::int16_t index) const { return tables_->payload_rules(index); }
  void expect(std::int16_t index) { expected_ = index; }
  std::uint64_t check_begin_of(unsigned algorithm) const { return tables_->check_begin_of(algorithm); }
  std::uint64_t check_update(unsigned algorithm, std::uint64_t reg, const std::uint8_t* bytes, std::size_t size) const {
    return tables_->check_update(algorithm, reg, bytes, size);
  }
  std::uint64_t check_end_of(unsigned algorithm, std::uint64_t reg) const {
    return tables_->check_end_of(algorithm, reg);
  }

 private:
  const FrameFormat* format_;
  const RuntimeTables* tables_;
  bool ends_by_silence_;
  bool matches_;
  std::int16_t expected_ = -1;
};

}  // namespace wirebond
