// Gives a host's frames their sequence numbers as they leave: a sealed frame is opened, numbered and closed again.
#pragma once

#include <cstddef>
#include <cstdint>
#include <cstring>

#include "wirebond/host/runtime_source.hpp"
#include "wirebond/numbering.hpp"

namespace wirebond {

/// Numbers begin with 0 when the link is made. One thread at a time.
class FrameNumbers {
 public:
  /// Memory of the caller, which outlives this object. `next` holds one counter, or one for each message of the
  /// protocol if each has its own. `scratch` holds `scratch_bytes(format)` bytes.
  struct Memory {
    std::uint64_t* next = nullptr;
    std::uint8_t* scratch = nullptr;
  };
  static std::size_t scratch_bytes(const FrameFormat& format) { return frame_lead(format) + max_wire_bytes(format); }

  /// `source`: of the frames that this end sends.
  FrameNumbers(const RuntimeSource& source, const Memory& memory) : source_(source), memory_(memory) {}

  /// Write the number of the sealed frame of `size` bytes, and compute its checks and stuffing again; its memory holds
  /// the format's largest frame. Returns its new size. The same number is given until `keep`. O(size).
  std::size_t give(std::uint8_t* frame, std::size_t size, std::int16_t message) {
    const FrameFormat& format = source_.format();
    const std::uint8_t* const inner = frame + opening_bytes(format);
    const std::size_t inner_size = size - delimiter_bytes(format);
    std::uint8_t* const opened = memory_.scratch + frame_lead(format);
    std::size_t opened_size = inner_size;
    if (format.stuffing == Stuffing::none) {
      std::memcpy(opened, inner, inner_size);
    } else {
      const std::ptrdiff_t unstuffed = unstuff(source_, inner, inner_size, opened);
      if (unstuffed < 0) return size;  // not a frame of this format: it leaves unchanged
      opened_size = static_cast<std::size_t>(unstuffed);
    }
    is_given_ = false;
    source_.expect(message);  // its id may be another message's, too
    const std::size_t on_wire = close_numbered(source_, memory_.scratch, opened_size, [&] {
      is_given_ = true;
      return *counter_of(message);
    });
    std::memcpy(frame, memory_.scratch, on_wire);
    return on_wire;
  }

  /// Note that the frame that was numbered last has begun to leave.
  void keep(std::int16_t message) {
    if (is_given_) *counter_of(message) += 1;
    is_given_ = false;
  }

 private:
  std::uint64_t* counter_of(std::int16_t message) {
    return memory_.next + (source_.format().sequence_per_message ? message : 0);
  }

  RuntimeSource source_;
  Memory memory_;
  bool is_given_ = false;  ///< the form of the last frame has a number
};

}  // namespace wirebond
