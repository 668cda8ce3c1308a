// The result of a soak as one line of JSON, piece by piece.
#pragma once

#include <cinttypes>
#include <cstddef>
#include <cstdint>
#include <cstdio>
#include <utility>

#include "accounts.hpp"
#include "ledger.hpp"
#include "wirebond/host/link.hpp"
#include "wirebond/mcu/link.hpp"
#include "wirebond/sim/wire.hpp"

namespace soak {

struct Direction {
  const Ledger& ledger;
  const wirebond::sim::WireCounts& wire;
  double line_use;
  Time wait_bound;  ///< `never`: it is not known when a frame has left, or others may overtake it for ever
};

inline void print_head(double line_seconds, double seconds, std::uint64_t unaccounted, double host_cpu_seconds) {
  std::printf("{\"result\": {\"virtual_seconds\": %.6f, \"seconds\": %.6f, \"speedup\": %.2f, \"unaccounted\": %" PRIu64
              ", \"host_cpu_seconds\": %.6f, ",
              line_seconds, seconds, line_seconds / seconds, unaccounted, host_cpu_seconds);
}

inline void print_work(std::uint64_t polls, std::uint64_t runs, std::uint64_t events) {
  std::printf("\"mcu_work\": {\"polls\": %" PRIu64 ", \"runs\": %" PRIu64 ", \"receive_events\": %" PRIu64 "}, ", polls,
              runs, events);
}

/// By cause, in the order of the engine.
template <class Account>
void print_discards(const Account& account) {
  std::printf("\"discarded_bytes\": [");
  for (std::size_t i = 0; i < wirebond::cause_count; ++i) {
    std::printf("%s%" PRIu64, i == 0 ? "" : ", ", static_cast<std::uint64_t>(account.discarded_bytes[i]));
  }
  std::printf("], ");
}

/// All but what the links know. `no_room`: refused because the queue was full; `other`: for another reason.
inline void print_direction(const Direction& direction, std::uint64_t no_room, std::uint64_t other) {
  const Ledger& ledger = direction.ledger;
  const Fates& fates = ledger.fates;
  const wirebond::sim::WireCounts& counts = direction.wire;
  std::printf("\"line_use\": %.6f, \"offered\": %" PRIu64 ", \"accepted\": %" PRIu64
              ", \"refused_queue_full\": %" PRIu64 ", \"refused_otherwise\": %" PRIu64 ", \"sent\": %" PRIu64
              ", \"queued\": %" PRIu64 ", \"expired\": %" PRIu64 ", \"replaced\": %" PRIu64 ", \"delivered\": %" PRIu64
              ", \"lost_to_faults\": %" PRIu64 ", \"lost_to_false\": %" PRIu64 ", \"lost_intact\": %" PRIu64
              ", \"false_frames\": %" PRIu64 ", ",
              direction.line_use, fates.offered, fates.accepted, no_room, other, fates.left, ledger.waiting(),
              fates.expired, fates.replaced, fates.delivered, fates.lost_to_faults, fates.lost_to_false,
              fates.lost_intact, fates.false_frames);
  std::printf("\"bytes\": %" PRIu64 ", \"bit_errors\": %" PRIu64 ", \"burst_bytes\": %" PRIu64
              ", \"dropped_bytes\": %" PRIu64 ", \"inserted_bytes\": %" PRIu64 ", \"splits\": %" PRIu64
              ", \"unplugged_bytes\": %" PRIu64 ", ",
              counts.put, counts.bit_errors, counts.burst_bytes, counts.dropped, counts.inserted, counts.splits,
              counts.unplugged);
  if (direction.wait_bound == wirebond::sim::never) {
    std::printf("\"longest_wait_us\": null, \"wait_bound_us\": null, ");
  } else {
    std::printf("\"longest_wait_us\": %.3f, \"wait_bound_us\": %.3f, ", static_cast<double>(ledger.longest_wait) * 1e-3,
                static_cast<double>(direction.wait_bound) * 1e-3);
  }
  std::printf("\"latency_us\": {");
  for (const auto& [text, share] : {std::pair{"p50", 0.5}, {"p90", 0.9}, {"p99", 0.99}, {"p99.9", 0.999}}) {
    std::printf("\"%s\": %.3f, ", text, static_cast<double>(ledger.latency.percentile(share)) * 1e-3);
  }
  std::printf("\"max\": %.3f}, \"latency_curve\": [", static_cast<double>(ledger.latency.most()) * 1e-3);
  constexpr int points = 100;
  for (int i = 0; i <= points; ++i) {
    const double share = static_cast<double>(i) / points;
    std::printf("%s[%.4f, %.3f]", i == 0 ? "" : ", ", share,
                static_cast<double>(ledger.latency.percentile(share)) * 1e-3);
  }
  std::printf("], ");
}

template <class McuLink>
void print_to_mcu(const Direction& direction, const wirebond::HostLink& host, const McuLink& mcu) {
  const auto account = host.outbox().account();
  std::printf("\"to_mcu\": {");
  print_direction(direction, account.refused_full, account.refused_down + account.refused_stopped);
  print_discards(mcu.receiver().account());
  std::printf("\"lapped_bytes\": %u, \"refused_by_rules\": %u}, ", mcu.receive_account().lapped, refused_by_rules(mcu));
}

/// The last piece.
template <class McuLink>
void print_to_host(const Direction& direction, const wirebond::HostLink& host, const McuLink& mcu) {
  const auto account = mcu.send_account();
  const std::uint64_t full = account.refused(wirebond::Refusal::full) + account.refused(wirebond::Refusal::held);
  std::printf("\"to_host\": {");
  print_direction(direction, full, account.refused() - full);
  print_discards(host.deframer().account());
  std::printf("\"lapped_bytes\": 0, \"refused_by_rules\": 0}}}\n");
  std::fflush(stdout);
}

}  // namespace soak
