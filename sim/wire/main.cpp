// Two ptys joined by a simulated wire: the program of `wirebond wire`. It prints the two paths, a line each; after each
// line on stdin, and at its end, the account of every byte so far, as one line of JSON. It ends with stdin, with
// SIGINT, or after `length_ns`.
#include <signal.h>
#include <unistd.h>

#include <atomic>
#include <cerrno>
#include <cinttypes>
#include <cstdio>
#include <cstring>
#include <mutex>
#include <string_view>
#include <thread>

#include "wirebond/sim/options.hpp"
#include "wirebond/sim/pty_wire.hpp"

namespace {

using wirebond::sim::PtyWire;
using wirebond::sim::Time;

std::atomic<bool> ends{false};

void print(const char* name, const wirebond::sim::PtyWireAccount& account) {
  const wirebond::sim::WireCounts& counts = account.counts;
  std::printf("\"%s\": {\"line_use\": %.6f, \"is_misheard\": %s, \"bytes\": %" PRIu64 ", \"handed_over\": %" PRIu64
              ", \"not_read\": %" PRIu64 ", \"travelling\": %" PRIu64 ", \"unplugged\": %" PRIu64
              ", \"bit_errors\": %" PRIu64 ", \"burst_bytes\": %" PRIu64 ", \"dropped_bytes\": %" PRIu64
              ", \"inserted_bytes\": %" PRIu64 ", \"splits\": %" PRIu64 ", \"collided_bytes\": %" PRIu64 "}",
              name, account.line_use, account.is_misheard ? "true" : "false", counts.put, account.handed_over,
              account.overrun, counts.travelling, counts.unplugged, counts.bit_errors, counts.burst_bytes,
              counts.dropped, counts.inserted, counts.splits, counts.collided);
}

/// The account of both directions. Any thread.
void print(PtyWire& wire) {
  static std::mutex one_at_a_time;
  const std::lock_guard<std::mutex> lock(one_at_a_time);
  std::printf("{\"seconds\": %.6f, ", static_cast<double>(wire.length()) * 1e-9);
  print("a_to_b", wire.account(PtyWire::a));
  std::printf(", ");
  print("b_to_a", wire.account(PtyWire::b));
  std::printf("}\n");
  std::fflush(stdout);
}

/// One setting of one end.
bool set_shape(wirebond::sim::UartShape& shape, std::string_view name, std::uint64_t value) {
  if (name == "baud") {
    shape.baud = static_cast<std::uint32_t>(value);
  } else if (name == "data_bits") {
    shape.data_bits = static_cast<unsigned>(value);
  } else if (name == "parity") {
    shape.parity = static_cast<wirebond::sim::Parity>(value);
  } else if (name == "stop_bits") {
    shape.stop_bits = static_cast<unsigned>(value);
  } else {
    return false;
  }
  return true;
}

/// `unplug:AT:LENGTH` or `fault:AT:FROM:KIND:VALUE`, times in nanoseconds; see python/src/wirebond/sim/wire/script.py.
bool is_script(std::string_view word) { return word.substr(0, 7) == "unplug:" || word.substr(0, 6) == "fault:"; }

void set_script(PtyWire& wire, const char* word) {
  using Kind = wirebond::sim::ScriptedFault::Kind;
  std::uint64_t at = 0;
  std::uint64_t length = 0;
  unsigned from = 0;
  unsigned kind = 0;
  if (std::sscanf(word, "unplug:%" SCNu64 ":%" SCNu64, &at, &length) == 2) wire.script_unplug(at, length);
  if (std::sscanf(word, "fault:%" SCNu64 ":%u:%u:%" SCNu64, &at, &from, &kind, &length) != 4) return;
  const bool is_drop = static_cast<Kind>(kind) == Kind::drop;  // its value says how many
  wire.script_fault(at, static_cast<PtyWire::End>(from), static_cast<Kind>(kind),
                    is_drop ? std::uint8_t{0} : static_cast<std::uint8_t>(length), is_drop ? length : 1);
}

}  // namespace

int main(int argument_count, char** arguments) {
  wirebond::sim::WireSettings a_to_b;
  wirebond::sim::WireSettings b_to_a;
  wirebond::sim::UartShape shapes[2];
  Time length = wirebond::sim::never;
  Time unplug_at = wirebond::sim::never;
  Time unplug_for = 0;
  bool is_joined = false;
  for (int i = 1; i < argument_count; ++i) {
    std::string_view name;
    std::uint64_t value = 0;
    if (is_script(arguments[i])) continue;
    bool is_known = wirebond::sim::split_option(arguments[i], name, value);
    if (is_known && name == "length_ns") {
      length = value;
    } else if (is_known && name == "echo") {
      is_joined = value != 0;
    } else if (is_known && name == "batch_ns") {
      a_to_b.batch = b_to_a.batch = value;
    } else if (is_known && name == "jitter_ns") {
      a_to_b.jitter = b_to_a.jitter = value;
    } else if (is_known && name == "unplug_at_ns") {
      unplug_at = value;
    } else if (is_known && name == "unplug_for_ns") {
      unplug_for = value;
    } else if (is_known && name.size() > 2 && (name.substr(0, 2) == "a_" || name.substr(0, 2) == "b_")) {
      const bool is_a = name[0] == 'a';
      is_known = set_shape(shapes[is_a ? 0 : 1], name.substr(2), value);
      (is_a ? a_to_b : b_to_a).baud = shapes[is_a ? 0 : 1].baud;
      (is_a ? a_to_b : b_to_a).bits_per_byte = shapes[is_a ? 0 : 1].bits_per_byte();
    } else {
      is_known = is_known && wirebond::sim::set_both(a_to_b, b_to_a, name, value);
    }
    if (!is_known) {
      std::fprintf(stderr, "unknown argument '%s'\n", arguments[i]);
      return 2;
    }
  }
  PtyWire wire(a_to_b, b_to_a);
  wire.set_shapes(shapes[0], shapes[1]);
  if (is_joined) wire.join_directions();
  for (int i = 1; i < argument_count; ++i) set_script(wire, arguments[i]);
  if (unplug_at != wirebond::sim::never) wire.script_unplug(unplug_at, unplug_for);
  if (!wire.open()) {
    std::fprintf(stderr, "cannot open a pty: %s\n", std::strerror(errno));
    return 3;
  }
  signal(SIGINT, [](int) { ends.store(true, std::memory_order_relaxed); });
  std::printf("%s\n%s\n", wire.path(PtyWire::a), wire.path(PtyWire::b));
  std::fflush(stdout);
  std::thread([&wire] {
    char byte;
    while (::read(STDIN_FILENO, &byte, 1) > 0) {
      if (byte == '\n') print(wire);
    }
    ends.store(true, std::memory_order_relaxed);  // the program that started it has gone
  }).detach();
  if (const int error = wire.run(ends, length); error != 0) {
    std::fprintf(stderr, "a pty does not work any more: %s\n", std::strerror(error));
    ::_exit(3);  // the thread may print the account
  }
  print(wire);
  ::_exit(0);  // the thread may still wait for stdin
}
