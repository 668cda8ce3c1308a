// Which frames a run of the MCU holds: needed where they leave in another order than they were accepted in, or where
// their sequence number changes their size.
#pragma once

#include <cstddef>
#include <cstdint>
#include <vector>

#include "ledger.hpp"
#include "mix.hpp"
#include "wirebond/stream_deframer.hpp"

namespace soak {

/// Reads runs as a host does on a line without faults. One thread.
class RunReader {
 public:
  /// This run begins with byte `number` of the line, and its last bit leaves at `end`. False: it holds something else
  /// than frames that wait in `sent`.
  template <class Line>
  bool read(const std::uint8_t* bytes, std::size_t size, std::uint64_t number, Time end, Ledger& sent,
            const Line& wire) {
    bool is_known = true;
    std::uint64_t begin = number_;  // of the next frame, with what stands before it
    number_ += size;
    deframer_.feed(bytes, size, std::uint64_t{0}, [&](const wirebond::Frame& frame) {
      const std::uint64_t behind = frame.offset + frame.wire_size;
      is_known = sent.leave_with(mix::mcu_message(frame.message), frame.payload, frame.payload_size,
                                 number + (begin + size - number_), static_cast<std::size_t>(behind - begin),
                                 end - wire.line_time(number_ - behind), mix::from_mcu) &&
                 is_known;
      begin = behind;
    });
    return is_known && begin == number_;
  }

 private:
  using Source = mix::protocol::FromMcu;

  std::vector<std::uint8_t> workspace_ = std::vector<std::uint8_t>(wirebond::workspace_bytes(Source{}));
  wirebond::StreamDeframer<Source, std::uint64_t> deframer_{Source{}, workspace_.data(), ~std::uint64_t{0}};
  std::uint64_t number_ = 0;  ///< of the byte behind the last run, as the deframer counts
};

}  // namespace soak
