// Converts a received message to the bytes (CDR) of a ROS 2 topic, with a plan made once from the mapping. No DDS.
#pragma once

#include <nanobind/nanobind.h>

#include <cstddef>
#include <cstdint>
#include <memory>
#include <string>
#include <utility>
#include <vector>

#include "decoder.hpp"

namespace wirebond::engine {

/// Copies the topic's message with all its constants, and inserts the stamp and the changing values. If the result
/// could differ from the mapping's filler, it gives none: then Python fills the message, or reports why not.
class CdrPacker {
 public:
  /// `plan`: a wirebond.ros2.mapping.packing.PackPlan. Returns null if a value has no fixed place in the payload. With
  /// the GIL.
  static std::unique_ptr<CdrPacker> make(std::shared_ptr<const ProtocolTable> protocol, nb::handle plan);

  /// Return the topic's bytes for each of these messages of the plan, with its stamp in its headers; None: left to
  /// Python. About 0.2 µs and 10 ns per value. Any thread, with the GIL.
  nb::list pack(nb::list messages, nb::list stamps_ns) const;

 private:
  /// One value that changes.
  struct Value {
    const FieldTable* field = nullptr;  ///< field of the protocol
    std::size_t place = 0;              ///< of the field in the payload
    std::size_t index = 0;              ///< of the number, in a field with several
    int flag = -1;                      ///< bit of the flag; -1: the whole number
    std::size_t at = 0;                 ///< position in the topic's bytes
    char code = 0;                      ///< type, as in Python's struct module
    bool is_linear = false;
    double scale = 1;
    double offset = 0;
    bool is_chosen = false;
    std::vector<std::pair<std::uint64_t, std::string>> chosen;  ///< bytes for each number on the wire
  };

  nb::object pack_one(const Message& message, std::int64_t stamp_ns) const;
  static bool find(const std::vector<FieldTable>& fields, nb::handle path, Value& value);
  static bool put(const Value& value, std::uint64_t raw, std::uint8_t* to);

  std::shared_ptr<const ProtocolTable> protocol_;
  std::int16_t message_ = -1;
  std::string data_;
  std::vector<std::size_t> seconds_;      ///< positions of a stamp's seconds
  std::vector<std::size_t> nanoseconds_;  ///< positions of its nanoseconds
  std::vector<Value> values_;
};

/// Return when each of these messages came, or its own stamp if it has one: in nanoseconds, `ahead_ns` later. With the
/// GIL.
nb::list stamps_ns(nb::list messages, std::int64_t ahead_ns);

}  // namespace wirebond::engine
