// Between a generated C API of links and wirebond::Link: adapts C's port and parameters to the core, and the core's
// counters to C. For generated .cpp files only.
#pragma once

#include <cstddef>
#include <cstdint>
#include <string_view>

#include "wirebond/mcu/c_api.h"
#include "wirebond/mcu/c_api.hpp"
#include "wirebond/mcu/grant.hpp"
#include "wirebond/mcu/line_errors.hpp"
#include "wirebond/mcu/link.hpp"
#include "wirebond/mcu/send_account.hpp"
#include "wirebond/mcu/services.hpp"
#include "wirebond/mcu/why.hpp"

namespace wirebond::c {

static_assert(static_cast<int>(LinkState::down) == WIREBOND_STATE_DOWN);
static_assert(static_cast<int>(LinkState::stale) == WIREBOND_STATE_STALE);
static_assert(static_cast<int>(LinkState::up) == WIREBOND_STATE_UP);
static_assert(static_cast<int>(Peer::unknown) == WIREBOND_PEER_UNKNOWN);
static_assert(static_cast<int>(Peer::same) == WIREBOND_PEER_SAME);
static_assert(static_cast<int>(Peer::different) == WIREBOND_PEER_DIFFERENT);
static_assert(static_cast<int>(Level::debug) == WIREBOND_LEVEL_DEBUG);
static_assert(static_cast<int>(Level::info) == WIREBOND_LEVEL_INFO);
static_assert(static_cast<int>(Level::warning) == WIREBOND_LEVEL_WARNING);
static_assert(static_cast<int>(Level::error) == WIREBOND_LEVEL_ERROR);
static_assert(static_cast<int>(Refusal::none) == WIREBOND_REFUSED_NONE);
static_assert(static_cast<int>(Refusal::full) == WIREBOND_REFUSED_FULL);
static_assert(static_cast<int>(Refusal::held) == WIREBOND_REFUSED_HELD);
static_assert(static_cast<int>(Refusal::range) == WIREBOND_REFUSED_RANGE);
static_assert(static_cast<int>(Refusal::down) == WIREBOND_REFUSED_DOWN);
static_assert(static_cast<int>(Refusal::abandoned) == WIREBOND_REFUSED_ABANDONED);
static_assert(refusal_count == WIREBOND_REFUSAL_COUNT);

/// A port whose functions are in C.
class Port {
 public:
  /// `table` must outlive this object and be complete.
  explicit Port(const wirebond_port_t& table)
      : tells_every_lap(table.tells_every_lap), is_unpaced(table.is_unpaced), table_(table) {}

  static bool is_complete(const wirebond_port_t& table) {
    return table.start_receive != nullptr && table.receiving != nullptr && table.receive_position != nullptr &&
           table.start_transmit != nullptr && table.stop_transmit != nullptr && table.pend != nullptr &&
           table.reaches != nullptr;
  }

  bool start_receive(std::uint8_t* ring, std::size_t size) { return table_.start_receive(table_.context, ring, size); }
  bool receiving() const { return table_.receiving(table_.context); }
  std::size_t receive_position() const { return table_.receive_position(table_.context); }
  bool start_transmit(const std::uint8_t* bytes, std::size_t size) {
    return table_.start_transmit(table_.context, bytes, size);
  }
  void stop_transmit() { table_.stop_transmit(table_.context); }
  void pend() { table_.pend(table_.context); }
  bool reaches(const void* bytes, std::size_t size) const { return table_.reaches(table_.context, bytes, size); }
  bool clock_runs() const { return table_.now_us != nullptr; }
  std::uint32_t now_us() const { return table_.now_us(table_.context); }
  bool tick_runs() const { return table_.tick_ms != nullptr; }
  std::uint32_t tick_ms() const { return table_.tick_ms(table_.context); }
  Why check(std::uint32_t baud) const {
    return table_.check == nullptr ? Why::nothing : static_cast<Why>(table_.check(table_.context, baud));
  }
  LineErrors take_line_errors() {
    if (table_.take_line_errors == nullptr) return {};
    const wirebond_line_errors_t errors = table_.take_line_errors(table_.context);
    return {errors.framing, errors.noise, errors.overrun, errors.parity};
  }
  bool connected() const { return runs && (table_.connected == nullptr || table_.connected(table_.context)); }
  void stop_receive() {
    if (table_.stop_receive != nullptr) table_.stop_receive(table_.context);
  }
  void line_free() {
    if (table_.line_free != nullptr) table_.line_free(table_.context);
  }
  void read_to(std::size_t place) {
    if (table_.read_to != nullptr) table_.read_to(table_.context, place);
  }

  const bool tells_every_lap;
  const bool is_unpaced;
  bool runs = true;  ///< false: the program has stopped the link

 private:
  const wirebond_port_t& table_;
};

/// Parameters in memory of C: the counterpart of `wirebond::Parameters`.
class Parameters {
 public:
  /// Everything that `table` points to must outlive this object and be complete.
  explicit Parameters(const wirebond_parameters_t& table) : table_(table) {
    for (std::size_t i = 0; i < table_.count; ++i) table_.values[i] = table_.rules[i].initial;
  }

  static bool is_complete(const wirebond_parameters_t& table) {
    return table.count == 0 || (table.rules != nullptr && table.values != nullptr);
  }

  std::size_t size() const { return table_.count; }
  float operator[](std::size_t index) const { return table_.values[index]; }

  /// See wirebond::Parameters::set.
  ParameterResult set(std::size_t index, float value) {
    if (index >= table_.count) return ParameterResult::no_such_index;
    const wirebond_parameter_rule_t& rule = table_.rules[index];
    if (!ParameterRule{rule.least, rule.most, rule.initial}.allows(value)) return ParameterResult::out_of_range;
    table_.values[index] = value;
    return ParameterResult::ok;
  }

 private:
  wirebond_parameters_t table_;
};

/// View the first characters of a C string, at most `most`, where it may end without a zero. NULL is empty.
inline std::string_view text_of(const char* text, std::size_t most) {
  if (text == nullptr) return {};
  std::size_t size = 0;
  while (size < most && text[size] != '\0') ++size;
  return {text, size};
}

inline wirebond_link_state_t to_c(LinkState state) { return static_cast<wirebond_link_state_t>(state); }
inline wirebond_why_t to_c(Why why) { return static_cast<wirebond_why_t>(why); }
inline wirebond_peer_t to_c(Peer peer) { return static_cast<wirebond_peer_t>(peer); }

inline wirebond_link_counters_t to_c(const LinkCounters& counts) {
  return {counts.line_errors,
          counts.framing_errors,
          counts.noise_errors,
          counts.overruns,
          counts.parity_errors,
          counts.receive_restarts,
          counts.reception_stops,
          counts.transmit_retries,
          counts.transmit_timeouts,
          counts.slow_polls,
          counts.nested_polls,
          counts.unserved_pends,
          counts.late,
          counts.held_back,
          counts.foreign,
          counts.unlisted,
          counts.echoed,
          counts.collisions,
          counts.clock_steps,
          counts.own_frames};
}

inline wirebond_receive_account_t to_c(const ReceiveAccount& account) {
  return {account.received,  account.handed_out, account.lapped,      account.laps,
          account.overtaken, account.dropped,    account.laps_unknown};
}

inline wirebond_send_account_t to_c(const SendAccount& from) {
  wirebond_send_account_t account{};
  account.offered = from.offered;
  account.accepted = from.accepted;
  for (std::size_t cause = 0; cause < refusal_count; ++cause) account.refused_by[cause] = from.refused_by[cause];
  account.sent = from.sent;
  account.replaced = from.replaced;
  account.expired = from.expired;
  account.aborted = from.aborted;
  account.queued = from.queued;
  account.unfinished = from.unfinished;
  return account;
}

}  // namespace wirebond::c
