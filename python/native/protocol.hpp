// What the engine knows of one protocol: its messages' fields, as tables made from wirebond.protocol.model.
// Format and frames are core's business.
#pragma once

#include <nanobind/nanobind.h>

#include <cstdint>
#include <memory>
#include <string>
#include <utility>
#include <vector>

#include "wirebond/bytes.hpp"
#include "wirebond/format.hpp"
#include "wirebond/runtime_source.hpp"

namespace wirebond::engine {

namespace nb = nanobind;

enum class FieldKind : std::uint8_t { unsigned_integer, signed_integer, floating, boolean, text, bytes };

/// One field. `value = wire * numerator / denominator + offset`: two exact factors instead of one rounded scale,
/// so that 9 * 0.001 is 0.009 and not 0.009000000000000001.
struct FieldTable {
  std::string name;
  nb::object key;  ///< the name, interned
  FieldKind kind = FieldKind::unsigned_integer;
  ByteOrder order = ByteOrder::little;
  std::uint8_t size = 1;  ///< wire bytes of one element; 0: reaches to the payload's end
  bool is_array = false;
  std::uint32_t count = 1;
  std::uint32_t max_size = 0;  ///< of a text or byte string without a fixed size
  std::size_t at = 0;          ///< offset in the payload
  bool scaled = false;
  double numerator = 1;
  double denominator = 1;
  double offset = 0;
  std::string unit;
  bool has_range = false;
  double minimum = 0;
  double maximum = 0;
  bool has_default = false;
  nb::object default_value;
  std::vector<std::pair<nb::object, std::uint64_t>> enumerators;  ///< name, value (two's complement in 64 bits)
  std::vector<std::pair<nb::object, unsigned>> flags;             ///< name, bit
  bool has_flags = false;
  bool has_enum = false;
};

struct MessageTable {
  std::string name;
  nb::object key;
  nb::object sender;  ///< "host", "mcu" or "both"
  std::uint32_t id = 0;
  std::size_t min_payload = 0;
  std::size_t max_payload = 0;
  std::vector<FieldTable> fields;
};

/// Immutable after construction; needs the GIL only where it makes Python objects.
class ProtocolTable {
 public:
  explicit ProtocolTable(nb::handle protocol);

  const std::string& name() const { return name_; }
  const std::vector<MessageTable>& messages() const { return messages_; }
  /// Index of the message of this name; -1 if there is none.
  int find(const std::string& name) const;

 private:
  std::string name_;
  std::vector<MessageTable> messages_;
};

/// A frame format from a wirebond.protocol.plan.Plan, with all that RuntimeSource points at.
class FormatTable {
 public:
  explicit FormatTable(nb::handle plan);
  FormatTable(const FormatTable&) = delete;
  FormatTable& operator=(const FormatTable&) = delete;

  const FrameFormat& format() const { return format_; }
  RuntimeSource source() const { return {format_, *tables_, rows_.data(), rows_.size()}; }
  /// Names of a layout's header fields, in its order.
  const std::vector<nb::object>& header_names(std::size_t layout) const { return header_names_[layout]; }
  std::size_t index_of(const Layout* layout) const { return static_cast<std::size_t>(layout - format_.layouts.data()); }

 private:
  FrameFormat format_;
  std::unique_ptr<CrcTables> tables_;
  std::vector<MessageRow> rows_;
  std::array<std::vector<nb::object>, max_layouts> header_names_;
};

}  // namespace wirebond::engine
