// A board on the simulated line: UART, memory, handler and Link; the sums of all of them, and resets.
#pragma once

#include <doctest/doctest.h>

#include <cstdint>
#include <cstdlib>
#include <optional>
#include <vector>

#include "peer.hpp"
#include "wirebond/fake/uart.hpp"
#include "wirebond/mcu/link.hpp"
#include "wirebond/mcu/receive_age.hpp"

/// `usual`, or `many` where the environment asks for it by WIREBOND_LONG.
inline std::uint32_t rounds(std::uint32_t usual, std::uint32_t many) {
  return std::getenv("WIREBOND_LONG") != nullptr ? many : usual;
}

/// Gets the commands. Whatever else a handler must have is empty.
template <class Wire>
struct Handler {
  std::vector<std::uint32_t> commands;
  std::vector<wirebond::LinkState> states;

  void on(const typename Wire::Command& command) { commands.push_back(Wire::get(command)); }
  void link_state(wirebond::LinkState state) { states.push_back(state); }
  void stop() {}
};

template <class Wire, std::size_t receive_bytes = 1024, std::size_t send_bytes = 512, class Port = wirebond::fake::Uart>
class Board {
 public:
  using Time = wirebond::fake::Time;
  using Fate = wirebond::fake::Fate;
  using Memory = typename Wire::template Memory<receive_bytes, send_bytes>;
  using Link = typename Wire::template Link<Handler<Wire>, Port, Memory>;

  explicit Board(std::uint64_t seed)
      : draw(seed),
        to_mcu(Wire::baud, Wire::bits_per_byte, seed),
        from_mcu(Wire::baud, Wire::bits_per_byte, seed + 1),
        uart(to_mcu, from_mcu, {}, seed + 2),
        peer(to_mcu, from_mcu),
        clock_start_us_(static_cast<std::uint32_t>(draw.next())) {
    if constexpr (wirebond::detail::HasClock<Port>::value) uart.clock_start_us = clock_start_us_;
    link.emplace(handler, uart, memory);
  }

  /// Let time pass: interrupts come, the line moves; then the main loop polls once.
  void pass(Time time) {
    pass_without_poll(time);
    link->poll(now_us());
  }
  void pass_without_poll(Time time) {
    now += time;
    uart.run(now, *link);
  }
  std::uint32_t now_us() const { return clock_start_us_ + static_cast<std::uint32_t>(now / 1000); }

  /// The MCU restarts: what it had in memory is lost, the line goes on.
  void reset() {
    uart.reset();
    peer.mcu_restarted();
    written_before_ = uart.counts().written;
    link.emplace(handler, uart, memory);
  }

  /// Every byte and every frame is accounted for. Right after a poll.
  void check_sums() {
    REQUIRE(to_mcu.closes());
    REQUIRE(from_mcu.closes());
    const auto& counts = uart.counts();
    REQUIRE(counts.written == to_mcu.count(Fate::received) + to_mcu.count(Fate::damaged));
    REQUIRE(counts.taken == from_mcu.put_count() + counts.broken_off + uart.waiting());
    const wirebond::ReceiveAccount ring = link->receive_account();
    const auto unnoticed = static_cast<std::uint32_t>(counts.written - written_before_) - ring.received;
    REQUIRE((ring.laps_unknown != 0 ? unnoticed % receive_bytes == 0 : unnoticed == 0));
    REQUIRE(ring.received == ring.handed_out + ring.lapped + ring.dropped + static_cast<std::uint32_t>(link->unread()));
    const auto& receiver = link->receiver();
    REQUIRE(receiver.bytes() == ring.handed_out);
    const auto& account = receiver.account();
    std::uint32_t settled = account.frame_bytes + account.fill_bytes;
    for (const std::uint32_t bytes : account.discarded_bytes) settled += bytes;
    REQUIRE(receiver.bytes() == settled + static_cast<std::uint32_t>(receiver.pending()));
    REQUIRE(link->send_account().balances());
  }

  /// All of it, after a poll.
  void check(bool complete = false) {
    check_sums();
    peer.check(handler.commands, link->receive_account(), link->counters().line_errors, complete);
  }

  wirebond::fake::Draw draw;
  wirebond::fake::Line to_mcu;
  wirebond::fake::Line from_mcu;
  Port uart;
  Peer<Wire> peer;
  Handler<Wire> handler;
  Memory memory;
  std::optional<Link> link;
  Time now = 0;

 private:
  std::uint64_t written_before_ = 0;  ///< bytes in the ring before the last reset
  std::uint32_t clock_start_us_;
};
