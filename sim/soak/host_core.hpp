// The host's link core with the memory that the engine gives it, and the format read at run time.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <memory>
#include <vector>

#include "mix.hpp"
#include "wirebond/host/link.hpp"

namespace soak {

class HostCore {
 public:
  static constexpr std::size_t queue_bytes = 65'536;  ///< these two as the engine has them
  static constexpr std::size_t queue_frames = 16'384;

  /// `latency_us`: what the port may hold back.
  HostCore(const wirebond::Pacing& pacing, std::uint64_t latency_us, std::uint64_t now_us)
      : rows_(mix::rows_from_mcu()),
        tables_(format_, rows_.data(), rows_.size(), wirebond::CrcMethod::automatic, mix::matches, mix::matches_late),
        source_(tables_),
        workspace_(wirebond::workspace_bytes(source_)),
        bytes_(queue_bytes),
        frames_(new wirebond::QueuedFrame[queue_frames + mix::protocol::message_count]),
        leases_(mix::protocol::message_count),
        leaving_(mix::protocol::AtHost::max_sent_bytes),
        next_numbers_(mix::protocol::message_count),
        scratch_(wirebond::FrameNumbers::scratch_bytes(sent_format_)),
        link_(source_, memory(), settings(pacing, latency_us), now_us) {}

  wirebond::HostLink& link() { return link_; }
  const wirebond::HostLink& link() const { return link_; }

 private:
  wirebond::HostLink::Memory memory() {
    wirebond::HostLink::Memory memory;
    memory.workspace = workspace_.data();
    memory.outbox.bytes = bytes_.data();
    memory.outbox.byte_capacity = bytes_.size();
    memory.outbox.frames = frames_.get();
    memory.outbox.frame_capacity = queue_frames + leases_.size();
    memory.outbox.leases = leases_.data();
    memory.outbox.lease_count = leases_.size();
    memory.outbox.message_count = leases_.size();
    memory.outbox.leaving = leaving_.data();
    memory.outbox.leaving_capacity = leaving_.size();
    memory.outbox.numbers = mix::host_numbers ? &numbers_ : nullptr;
    return memory;
  }
  static wirebond::HostLink::Settings settings(const wirebond::Pacing& pacing, std::uint64_t latency_us) {
    wirebond::HostLink::Settings settings;
    settings.pacing = pacing;
    settings.idle_us = mix::protocol::idle_us + latency_us;
    settings.max_age_us = std::uint64_t{mix::protocol::max_age_ms} * 1000;
    return settings;
  }

  const wirebond::FrameFormat format_ = wirebond::widened(mix::protocol::FromMcu{}.format());
  std::vector<wirebond::MessageRow> rows_;
  wirebond::RuntimeTables tables_;
  wirebond::RuntimeSource source_;
  std::vector<std::uint8_t> workspace_;
  std::vector<std::uint8_t> bytes_;
  std::unique_ptr<wirebond::QueuedFrame[]> frames_;
  std::vector<wirebond::Lease> leases_;
  std::vector<std::uint8_t> leaving_;
  const wirebond::FrameFormat sent_format_ = wirebond::widened(mix::protocol::FromHost{}.format());
  std::vector<wirebond::MessageRow> sent_rows_ = mix::rows_from_host();
  wirebond::RuntimeTables sent_tables_{sent_format_, sent_rows_.data(), sent_rows_.size()};
  std::vector<std::uint64_t> next_numbers_;
  std::vector<std::uint8_t> scratch_;
  wirebond::FrameNumbers numbers_{wirebond::RuntimeSource(sent_tables_), {next_numbers_.data(), scratch_.data()}};
  wirebond::HostLink link_;
};

}  // namespace soak
