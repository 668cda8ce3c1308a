// What both links counted, compared with what was seen from outside.
#pragma once

#include <cstddef>
#include <cstdint>

#include "ledger.hpp"
#include "wirebond/host/link.hpp"
#include "wirebond/sim/wire.hpp"

namespace soak {

inline std::uint64_t difference(std::uint64_t a, std::uint64_t b) { return a > b ? a - b : b - a; }
/// Modulo 2^32, as an MCU counts.
inline std::uint64_t difference_32(std::uint64_t a, std::uint32_t b) {
  return difference(static_cast<std::uint32_t>(a), b);
}

/// Frames that passed their checks and broke a rule of a field or of a deadline, or are for another address: no handler
/// of the MCU got them.
template <class McuLink>
std::uint32_t refused_by_rules(const McuLink& mcu) {
  const auto counters = mcu.counters();
  return mcu.receiver().violations().rejected + counters.late + counters.held_back + counters.foreign;
}

/// How many frames and bytes the accounts of both ends and what was seen from outside differ by.
template <class McuLink>
std::uint64_t unaccounted(const Ledger& to_mcu, const Ledger& to_host, const wirebond::HostLink& host,
                          const McuLink& mcu, const wirebond::sim::WireCounts& to_mcu_wire,
                          const wirebond::sim::WireCounts& to_host_wire) {
  std::uint64_t sum = 0;
  for (const Ledger* ledger : {&to_mcu, &to_host}) {
    const Fates& fates = ledger->fates;
    sum += difference(fates.accepted, fates.left + fates.expired + fates.replaced + ledger->waiting());
    sum += difference(fates.left, fates.delivered + fates.lost_to_faults + fates.lost_to_false + fates.lost_intact +
                                      ledger->travelling());
    sum += difference(ledger->latency.total(), fates.delivered);
  }
  const auto at_host = host.outbox().account();
  sum += difference(at_host.offered, to_mcu.fates.offered) + difference(at_host.accepted, to_mcu.fates.accepted);
  sum += difference(at_host.sent, to_mcu.fates.left) + difference(at_host.queued, to_mcu.waiting());
  sum += difference(at_host.expired, to_mcu.fates.expired) + difference(at_host.replaced, to_mcu.fates.replaced);
  sum += difference(at_host.sent_bytes, to_mcu_wire.put) + at_host.aborted + at_host.overruled;
  sum += at_host.balances() ? 0 : 1;
  const auto at_mcu = mcu.send_account();
  sum += difference_32(to_host.fates.offered, at_mcu.offered) + difference_32(to_host.fates.accepted, at_mcu.accepted);
  sum += difference_32(to_host.fates.left, at_mcu.sent) + difference_32(to_host.waiting(), at_mcu.queued);
  sum += difference_32(to_host.fates.expired, at_mcu.expired) + difference_32(to_host.fates.replaced, at_mcu.replaced);
  sum += at_mcu.balances() ? 0 : 1;

  const auto& found = host.deframer();
  sum += difference(found.account().frames, to_host.fates.delivered + to_host.fates.false_frames);
  sum += difference(found.bytes(), found.account().settled() + found.pending());
  sum += difference(found.bytes(), to_host_wire.handed_over);
  const auto& received = mcu.receiver();
  const auto ring = mcu.receive_account();
  sum += difference_32(to_mcu.fates.delivered + to_mcu.fates.false_frames + refused_by_rules(mcu),
                       received.account().frames);
  sum += difference_32(to_mcu_wire.handed_over, ring.received);
  sum += difference_32(ring.received,
                       ring.handed_out + ring.lapped + ring.dropped + static_cast<std::uint32_t>(mcu.unread()));
  sum += difference_32(received.account().settled() + static_cast<std::uint32_t>(received.pending()), ring.handed_out);
  sum += (to_mcu_wire.closes() ? 0 : 1) + (to_host_wire.closes() ? 0 : 1);
  return sum;
}

}  // namespace soak
