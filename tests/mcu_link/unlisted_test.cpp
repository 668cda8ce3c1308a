// A peer whose messages the file does not list: the link is up all the same, and acts on none of them.
#include <doctest/doctest.h>

#include <cstdint>
#include <vector>

#include "diffdrive_link.hpp"
#include "scripted_port.hpp"
#include "seeded_blocks_link.hpp"
#include "seeded_escaped_link.hpp"
#include "seeded_link.hpp"
#include "wirebond/mcu/c_link.hpp"
#include "wirebond/mcu/link.hpp"

namespace {

struct Counting {
  void on(const seeded::Order&) { orders += 1; }
  void on(const seeded_blocks::Order&) { orders += 1; }
  void on(const seeded_escaped::Order&) { orders += 1; }
  unsigned orders = 0;
};

/// A message of another id, with a check that counts a seed which this file does not have.
const Bytes other{0xFD, 0x03, 0x1E, 0x11, 0x22, 0x33, 0xAB, 0xCD};

}  // namespace

TEST_CASE("frames of messages that the file does not list keep a link up") {
  Counting counting;
  ScriptedPort port;
  seeded::McuBuffers<256, 256> buffers;
  seeded::McuLink link{counting, port, buffers};
  std::uint32_t now_us = 0;
  link.poll(now_us);
  const auto pass_100_ms = [&] {
    for (int i = 0; i < 10; ++i) link.poll(now_us += 10 * ms);
  };
  for (int i = 0; i < 30; ++i) {
    port.arrive(other);
    pass_100_ms();
  }
  CHECK(link.state() == wirebond::LinkState::up);
  CHECK(counting.orders == 0);
  CHECK(link.receiver().account().frames == 0);
  CHECK(link.counters().unlisted == 29);  // of the last nothing shows yet that it ended
  CHECK(wirebond::c::to_c(link.counters()).unlisted == 29);
  for (int i = 0; i < 11; ++i) pass_100_ms();
  CHECK(link.state() == wirebond::LinkState::stale);
}

TEST_CASE("between delimiters they do, too") {
  Counting counting;
  ScriptedPort port;
  seeded_blocks::McuBuffers<256, 256> buffers;
  seeded_blocks::McuLink link{counting, port, buffers};
  std::uint32_t now_us = 0;
  link.poll(now_us);
  for (int i = 0; i < 150; ++i) {
    if (i % 10 == 0) port.arrive({0x00, 0x07, 0x1E, 0x11, 0x22, 0x33, 0xAB, 0xCD, 0x00});
    if (i % 10 == 5) port.arrive({0x00, 0x03, 0x1E, 0x11, 0x00});  // shorter than any frame
    link.poll(now_us += 10 * ms);
  }
  CHECK(link.state() == wirebond::LinkState::up);
  CHECK(counting.orders == 0);
  CHECK(link.counters().unlisted == 15);
}

TEST_CASE("where escapes move the end of a frame, they do, too") {
  Counting counting;
  ScriptedPort port;
  seeded_escaped::McuBuffers<256, 256> buffers;
  seeded_escaped::McuLink link{counting, port, buffers};
  std::uint32_t now_us = 0;
  link.poll(now_us);
  for (int i = 0; i < 101; ++i) {
    if (i % 10 == 0) port.arrive({0x7E, 0x03, 0x1E, 0x7D, 0x5D, 0x7D, 0x5E, 0x33, 0xAB, 0x7D, 0x5D});
    if (i % 10 == 5) port.arrive({0x7E, 0x03, 0x1E, 0x7D, 0x5D, 0x33});  // cut short by the next one
    link.poll(now_us += 10 * ms);
  }
  CHECK(link.state() == wirebond::LinkState::up);
  CHECK(counting.orders == 0);
  CHECK(link.counters().unlisted == 10);  // each shows its end where the short one begins
}

TEST_CASE("noise with the start byte in it does not") {
  Counting counting;
  ScriptedPort port;
  seeded::McuBuffers<256, 256> buffers;
  seeded::McuLink link{counting, port, buffers};
  std::uint32_t now_us = 0;
  link.poll(now_us);
  for (int i = 0; i < 300; ++i) {
    port.arrive({0xFD, 0x03, 0x1E, 0x11, 0x22, 0x33, 0xAB});
    link.poll(now_us += 10 * ms);
  }
  CHECK(link.state() == wirebond::LinkState::stale);
  CHECK(link.receiver().account().unlisted.frames() == 0);
}

TEST_CASE("a format without seeds has no counter for them") {
  using Source = seeded::FromHost;
  static_assert(wirebond::counts_unlisted(Source{}.format()));
  static_assert(wirebond::counts_unlisted(seeded_blocks::FromHost{}.format()));
  static_assert(wirebond::counts_unlisted(seeded_escaped::FromHost{}.format()));
  static_assert(!wirebond::counts_unlisted(diffdrive::FromHost{}.format()));
}
