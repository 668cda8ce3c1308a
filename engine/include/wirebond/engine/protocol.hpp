// The engine's tables of one protocol: its messages' fields and its frame format, read from what
// wirebond.protocol.tables makes. Format and frames belong to core.
#pragma once

#include <cstddef>
#include <cstdint>
#include <deque>
#include <memory>
#include <string>
#include <vector>

#include "wirebond/engine/field_table.hpp"
#include "wirebond/engine/node.hpp"
#include "wirebond/format.hpp"
#include "wirebond/host/runtime_source.hpp"
#include "wirebond/payload_rules.hpp"

namespace wirebond::engine {

/// The rules over one message's payload.
struct PayloadTable {
  std::vector<PayloadConstant> constants;
  std::vector<PayloadCount> counts;
  std::uint16_t most_beside = 0;

  PayloadRules rules() const {
    return {constants.data(), counts.data(), static_cast<std::uint8_t>(constants.size()),
            static_cast<std::uint8_t>(counts.size()), most_beside};
  }
};

/// Tests that the frames of one message pass.
struct MatchTable {
  std::vector<MatchTest> tests;
  std::vector<std::string> names;  ///< of the field that each test uses

  MatchTests view() const { return {tests.data(), static_cast<std::uint8_t>(tests.size())}; }
};

struct MessageTable {
  std::string name;
  std::string sender;  ///< "host", "mcu" or "both"
  std::size_t min_payload = 0;
  std::size_t max_payload = 0;
  std::vector<FieldTable> fields;
  std::vector<PayloadConstant> constants;  ///< among its fields
  std::shared_ptr<const void> kept;        ///< see FieldTable::kept
};

/// Does not change once it is shared.
class ProtocolTable {
 public:
  /// `protocol`: see `protocol_table` in wirebond.protocol.tables.
  explicit ProtocolTable(const Node& protocol);

  const std::string& name() const { return name_; }
  const std::vector<MessageTable>& messages() const { return messages_; }
  /// For a language that keeps something for messages and fields, before the table is shared.
  std::vector<MessageTable>& messages() { return messages_; }
  /// Return the index of the message of this name; -1 if there is none.
  int find(const std::string& name) const;

 private:
  std::string name_;
  std::vector<MessageTable> messages_;
};

/// A frame format from a plan, with everything that RuntimeSource points to. Does not change once it is shared.
class FormatTable {
 public:
  /// `plan`: see `format_table` in wirebond.protocol.tables.
  explicit FormatTable(const Node& plan);
  FormatTable(const FormatTable&) = delete;
  FormatTable& operator=(const FormatTable&) = delete;

  const FrameFormat& format() const { return format_; }
  RuntimeSource source() const { return RuntimeSource(*tables_); }
  /// Return the id for `seal` of the message of this index, which the plan's sender sends.
  std::uint32_t id_of(std::size_t message) const;
  /// Return the tests of the message of this index; null if ids identify all messages of the plan's sender.
  const MatchTable* match_of(std::size_t message) const;
  /// Return the index of the header field that is the id; -1: no message has several ids.
  int id_place() const { return id_place_; }
  /// Return the meaning of the header fields of all forms, by index.
  const std::vector<FieldTable>& header() const { return header_; }
  std::vector<FieldTable>& header() { return header_; }

 private:
  FrameFormat format_;
  std::unique_ptr<RuntimeTables> tables_;
  std::vector<MessageRow> rows_;
  std::vector<FieldTable> header_;
  std::deque<PayloadTable> payload_tables_;  ///< the rows point to them
  std::deque<MatchTable>
      match_tables_;  ///< the rows point to them; one for each row, if a message needs one or the id is a header field
  int id_place_ = -1;
};

}  // namespace wirebond::engine
