// The memory that DMA writes and reads, reserved by a firmware for one link.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>

#include "wirebond/mcu/outbox.hpp"
#include "wirebond/mcu/own_frames.hpp"
#include "wirebond/mcu/sent_numbers.hpp"

namespace wirebond {

/// `Protocol`: an end of a generated header. Sizes are powers of two. `ReceiveBytes`: at least twice the bytes that
/// come between two polls; `SendBytes`: at least two of the largest frames, and more if senders are pre-empted
/// (docs/firmware.md). Place it where the UART's DMA can reach it: `Link` asks its port, and stays down otherwise.
template <class Protocol, std::size_t ReceiveBytes, std::size_t SendBytes,
          std::size_t SendFrames = default_frames(SendBytes), class AtomicsPolicy = DefaultAtomics>
struct Buffers {
  static_assert(ReceiveBytes >= 16 && (ReceiveBytes & (ReceiveBytes - 1)) == 0, "ReceiveBytes: a power of two");

  struct Config : OutboxConfig {
    using Atomics = AtomicsPolicy;
    using Latest = typename Protocol::Latest;
    static constexpr std::size_t ring_bytes = SendBytes;
    static constexpr std::size_t ring_frames = SendFrames;
    static constexpr std::size_t urgent_bytes = Protocol::urgent_bytes;
    static constexpr std::size_t urgent_frames = urgent_bytes == 0 ? 0 : 4;
    static constexpr bool tells_message =
        SentNumbers<typename Protocol::Sends>::has_messages || detail::Mistakable<typename Protocol::Mistakable>::any;
  };

  alignas(4) std::array<std::uint8_t, ReceiveBytes> receive;
  alignas(4) std::array<std::uint8_t, Outbox<Config>::memory_bytes> send;
};

}  // namespace wirebond
