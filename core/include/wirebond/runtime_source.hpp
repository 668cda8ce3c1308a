// A format that is read at run time: any protocol file, no code generation.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>

#include "wirebond/format.hpp"

namespace wirebond {

/// Byte tables for the format's CRCs, made once when the format is known.
struct CrcTables {
  std::array<std::array<std::uint64_t, 256>, max_algorithms> by_algorithm{};

  explicit CrcTables(const FrameFormat& format) {
    for (std::size_t i = 0; i < format.algorithm_count; ++i) {
      const CheckAlgorithm& a = format.algorithms[i];
      if (a.kind != CheckKind::crc) continue;
      for (unsigned index = 0; index < 256; ++index) {
        by_algorithm[i][index] = detail::crc_table_entry(index, a.width_bits, a.poly, a.reflect_in);
      }
    }
  }
};

/// One row of the message table, sorted by id.
struct MessageRow {
  std::uint32_t id = 0;
  MessageShape shape{};
};

/// Points at a format, its tables and its messages; the caller keeps them alive. Copies are cheap.
class RuntimeSource {
 public:
  static constexpr bool is_constant = false;

  RuntimeSource(const FrameFormat& format, const CrcTables& tables, const MessageRow* rows, std::size_t row_count)
      : format_(&format), tables_(&tables), rows_(rows), row_count_(row_count) {}

  const FrameFormat& format() const { return *format_; }

  MessageShape message(std::uint32_t id) const {
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
    return low < row_count_ && rows_[low].id == id ? rows_[low].shape : MessageShape{};
  }

  std::uint64_t check_update(unsigned index, std::uint64_t reg, const std::uint8_t* bytes, std::size_t size) const {
    const CheckAlgorithm& a = format_->algorithms[index];
    if (a.kind != CheckKind::crc) return sum_update(a, reg, bytes, size);
    const std::array<std::uint64_t, 256>& table = tables_->by_algorithm[index];
    if (a.reflect_in) {
      for (std::size_t i = 0; i < size; ++i) reg = (reg >> 8) ^ table[(reg ^ bytes[i]) & 0xFFu];
      return reg;
    }
    const unsigned top = a.width_bits - 8u;
    for (std::size_t i = 0; i < size; ++i) reg = (reg << 8) ^ table[((reg >> top) ^ bytes[i]) & 0xFFu];
    return reg & detail::mask_of(a.width_bits);
  }

 private:
  const FrameFormat* format_;
  const CrcTables* tables_;
  const MessageRow* rows_;
  std::size_t row_count_;
};

}  // namespace wirebond
