// What the engine knows of one protocol: its messages' fields, as tables made from wirebond.protocol.model.
// Format and frames are core's business.
#pragma once

#include <nanobind/nanobind.h>

#include <cstdint>
#include <deque>
#include <memory>
#include <string>
#include <vector>

#include "field_table.hpp"
#include "wirebond/format.hpp"
#include "wirebond/host/runtime_source.hpp"
#include "wirebond/payload_rules.hpp"

namespace wirebond::engine {

namespace nb = nanobind;

/// The rules over one message's payload.
struct PayloadTable {
  std::vector<PayloadConstant> constants;
  std::vector<PayloadCount> counts;

  PayloadRules rules() const {
    return {constants.data(), counts.data(), static_cast<std::uint8_t>(constants.size()),
            static_cast<std::uint8_t>(counts.size())};
  }
};

/// What the frames of one message have.
struct MatchTable {
  std::vector<MatchTest> tests;
  std::vector<std::string> names;  ///< of the field that each test is about

  MatchTests view() const { return {tests.data(), static_cast<std::uint8_t>(tests.size())}; }
};

struct MessageTable {
  std::string name;
  nb::object key;
  nb::object sender;  ///< "host", "mcu" or "both"
  std::size_t min_payload = 0;
  std::size_t max_payload = 0;
  std::vector<FieldTable> fields;
  std::vector<PayloadConstant> constants;  ///< among its fields
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
  RuntimeSource source() const { return RuntimeSource(*tables_); }
  /// What `seal` takes as the id of the message of this index, one that the plan's sender sends.
  std::uint32_t id_of(std::size_t message) const;
  /// What the frames of the message of this index have; null where ids tell all messages of the plan's sender.
  const MatchTable* match_of(std::size_t message) const;
  /// Place of the header field that is the id; -1: no message has several ids.
  int id_place() const { return id_place_; }
  /// What the header fields of all forms mean, by place.
  const std::vector<FieldTable>& header() const { return header_; }

 private:
  FrameFormat format_;
  std::unique_ptr<RuntimeTables> tables_;
  std::vector<MessageRow> rows_;
  std::vector<FieldTable> header_;
  std::deque<PayloadTable> payload_tables_;  ///< what the rows point at
  std::deque<MatchTable>
      match_tables_;  ///< the same; one for each row, where a message needs one or the id is a header field
  int id_place_ = -1;
};

}  // namespace wirebond::engine
