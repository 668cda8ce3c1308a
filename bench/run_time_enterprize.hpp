// The enterprize format as a value that the compiler cannot see through, as if it had been read from its file.
#pragma once

#include <cstdint>
#include <vector>

#include "enterprize.hpp"
#include "wirebond/host/runtime_source.hpp"

namespace bench {

class RunTimeEnterprize {
 public:
  explicit RunTimeEnterprize(wirebond::CrcMethod method = wirebond::CrcMethod::automatic)
      : format_(wirebond::widened(enterprize::FromMcu{}.format())),
        rows_(known()),
        tables_(*hidden(), rows_.data(), rows_.size(), method) {}

  wirebond::RuntimeSource source() const { return wirebond::RuntimeSource(tables_); }

 private:
  static std::vector<wirebond::MessageRow> known() {
    std::vector<wirebond::MessageRow> rows;
    for (std::uint32_t id = 0; id < 256; ++id) {
      const wirebond::MessageShape shape = enterprize::FromMcu{}.message(id);
      if (shape.known()) rows.push_back({id, shape});
    }
    return rows;
  }

  const wirebond::FrameFormat* hidden() const {
    const wirebond::FrameFormat* volatile pointer = &format_;
    return pointer;
  }

  wirebond::FrameFormat format_;
  std::vector<wirebond::MessageRow> rows_;
  wirebond::RuntimeTables tables_;
};

}  // namespace bench
