// A frame format with its messages, as data, and where those of the protocol files are to be had.
#pragma once

#include <cstddef>
#include <vector>

#include "wirebond/format.hpp"
#include "wirebond/host/runtime_source.hpp"

namespace fuzz {

struct Described {
  wirebond::FrameFormat format;
  std::vector<wirebond::MessageRow> rows;  ///< in the order that `MessageRow` asks for
};

/// One for each protocol file and sender, in a fixed order. Defined in a source file that emit.py writes.
std::vector<Described> real_formats();

}  // namespace fuzz
