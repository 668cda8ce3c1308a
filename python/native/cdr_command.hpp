// Converts bytes (CDR) of a ROS 2 topic to the frame of a command, with a plan made once from the mapping.
#pragma once

#include <nanobind/nanobind.h>

#include <cstddef>
#include <cstdint>
#include <memory>
#include <string>
#include <utility>
#include <vector>

#include "wirebond/engine/header.hpp"
#include "wirebond/engine/protocol.hpp"

namespace wirebond::engine {

namespace nb = nanobind;

/// Makes the frame if everything is in order: whole bytes, finite values within their ranges, a message that can be
/// encoded. All else is left to Python, which clamps, refuses, counts and reports why.
class CdrCommand {
 public:
  /// `plan`: a wirebond.ros2.mapping.unpacking.UnpackPlan. `bounds`: minimum and maximum of each number of the message,
  /// by field. Returns null if the protocol has no such message. With the GIL.
  static std::unique_ptr<CdrCommand> make(std::shared_ptr<const ProtocolTable> protocol,
                                          std::shared_ptr<const FormatTable> format, nb::handle plan, nb::dict bounds);

  /// Return the wire bytes for each of these messages from `first` on, up to one that is left to Python. The bytes come
  /// from any program in the network. About 1 µs each. Any thread, with the GIL.
  nb::list frames(nb::list messages, std::size_t first) const;

 private:
  enum class Times : std::uint8_t { one, array, sequence };

  /// One field of the topic; see the plan's Part.
  struct Part {
    Times times = Times::one;
    char code = 0;  ///< of a number; 's': a text; 0: a message
    std::uint32_t count = 0;
    int slot = -1;
    std::vector<Part> inside;
    std::vector<std::pair<std::uint32_t, Part>> picked;
  };
  struct Value {
    nb::object name;
    std::size_t slot = 0;
    bool is_linear = false;
    double scale = 1;
    double offset = 0;
    bool has_bounds = false;
    double least = 0;
    double greatest = 0;
  };
  class Walk;

  static Part read_part(nb::handle part);
  /// Returns an invalid object if the message is left to Python.
  nb::object frame(nb::bytes data) const;
  static nb::object fitting(const Value& value, const nb::object& found);

  std::shared_ptr<const ProtocolTable> protocol_;
  std::shared_ptr<const FormatTable> format_;
  GivenHeader header_;
  std::size_t message_ = 0;
  std::vector<Part> parts_;
  std::size_t slots_ = 0;
  std::vector<Value> values_;
  nb::dict constants_;
};

}  // namespace wirebond::engine
