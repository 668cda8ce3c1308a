// Two links whose frames end by silence, on one wire under virtual time: whatever both send, every frame arrives.
#include <doctest/doctest.h>

#include <cstdint>
#include <vector>

#include "quiet_link.hpp"
#include "scripted_port.hpp"
#include "wirebond/mcu/link.hpp"

namespace {

constexpr std::uint32_t step_us = 29;
constexpr std::uint32_t byte_us = 3 * step_us;  // 115200 baud
constexpr std::uint32_t silence_us = 2000;

struct ClockedPort : ScriptedPort {
  std::uint32_t now_us() const { return *clock_us; }
  const std::uint32_t* clock_us = nullptr;
};

struct Taker {
  template <class Message>
  void on(const Message& message) {
    numbers.push_back(message.number);
  }
  std::vector<unsigned> numbers;
};

/// One end, and the half of the wire that it sends on.
template <class Port, template <class, class, class> class LinkOf, class Memory>
struct Station {
  explicit Station(std::uint32_t& now, std::uint32_t poll_every_us, std::uint32_t first_poll_us)
      : now_us(now), every_us(poll_every_us), next_poll_us(first_poll_us) {
    if constexpr (std::is_same_v<Port, ClockedPort>) port.clock_us = &now;
  }

  void serve() {
    if (!port.pended) return;
    port.pended = false;
    link.on_pended();
  }

  /// What this end does at `now_us`; its bytes go to `peer`.
  template <class Peer>
  void step(Peer& peer) {
    if (static_cast<std::int32_t>(now_us - next_poll_us) >= 0) {
      next_poll_us += every_us;
      link.poll(now_us);
    }
    serve();
    if (!is_sending && !port.run.empty()) {
      is_sending = true;
      begun_us = now_us;
      if (has_sent) shortest_us = std::min(shortest_us, begun_us - last_bit_us);
    }
    if (is_sending && now_us - begun_us >= (sent_bytes + 1) * byte_us) {
      peer.port.arrive({port.run[sent_bytes++]});
      peer.heard_us = now_us;
      peer.is_moving = true;
    }
    if (sent_bytes != 0 && sent_bytes == port.run.size()) {
      runs += 1;
      sent_bytes = 0;
      port.run.clear();
      has_sent = true;
      is_sending = false;
      last_bit_us = now_us;
      link.on_transmitted();
    }
    if (is_moving && now_us - heard_us >= byte_us + step_us) {  // the UART's idle event
      is_moving = false;
      link.on_received();
    }
  }

  std::uint32_t& now_us;
  std::uint32_t every_us;
  std::uint32_t next_poll_us;
  Port port;
  Taker taker;
  Memory buffers;
  LinkOf<Taker, Port, Memory> link{taker, port, buffers};
  std::size_t sent_bytes = 0;
  std::size_t runs = 0;
  std::uint32_t begun_us = 0;
  std::uint32_t last_bit_us = 0;
  std::uint32_t shortest_us = ~0u;  ///< the shortest silence between two of its frames
  std::uint32_t heard_us = 0;
  bool has_sent = false;
  bool is_sending = false;
  bool is_moving = false;
};

template <class Port>
void talk(std::uint32_t poll_every_us, std::uint32_t start_us) {
  CAPTURE(poll_every_us);
  CAPTURE(start_us);
  std::uint32_t now = start_us;
  Station<Port, quiet::McuLink, quiet::McuBuffers<128, 512, 32>> mcu(now, poll_every_us, now);
  Station<Port, quiet::HostLink, quiet::HostBuffers<128, 512, 32>> host(now, poll_every_us, now + 413);
  std::vector<unsigned> orders;
  std::vector<unsigned> reports;
  unsigned number = 0;
  for (std::uint32_t step = 0; step < 60'000; ++step, now += step_us) {
    if (step % 900 == 500 && step < 50'000) {  // bursts of frames of all sizes, from both ends
      for (unsigned i = 0; i < 3; ++i) {
        quiet::Order order{};
        quiet::Report report{};
        order.number = report.number = static_cast<std::uint16_t>(++number);
        const std::uint8_t more[24] = {};
        REQUIRE(order.more.assign({more, (number * 7) % 25}));
        REQUIRE(report.more.assign({more, (number * 5) % 25}));
        if (host.link.send(order) == wirebond::Status::ok) orders.push_back(number);
        if (mcu.link.send(report) == wirebond::Status::ok) reports.push_back(number);
      }
    }
    mcu.step(host);
    host.step(mcu);
  }
  CHECK(orders.size() == number);
  CHECK(mcu.taker.numbers == orders);
  CHECK(host.taker.numbers == reports);
  CHECK(mcu.runs == reports.size());  // one frame each
  CHECK(mcu.shortest_us >= quiet::pause_us);
  CHECK(host.shortest_us >= quiet::pause_us);
  CHECK(mcu.link.counters().transmit_retries == 0);
  CHECK(mcu.link.receiver().account().frame_bytes == mcu.link.receiver().bytes());
}

}  // namespace

static_assert(quiet::pause_us == silence_us + 2000 && quiet::idle_us == silence_us);

TEST_CASE("frames that silence ends all arrive, whatever is sent at once: ports without a clock") {
  for (const std::uint32_t every_us : {200u, 700u, 1000u}) {
    talk<ScriptedPort>(every_us, 0);
    talk<ScriptedPort>(every_us, 0xFFFFFFFFu - 500'000);  // the clock wraps
  }
}

TEST_CASE("frames that silence ends all arrive, whatever is sent at once: ports with a clock") {
  for (const std::uint32_t every_us : {200u, 700u, 1000u}) {
    talk<ClockedPort>(every_us, 0);
    talk<ClockedPort>(every_us, 0xFFFFFFFFu - 500'000);
  }
}

TEST_CASE("the pause after a run that left between two polls is not measured from before its end") {
  wirebond::SendPause<4000> pause;
  CHECK(pause.is_over());
  pause.begin();
  CHECK(!pause.is_over());
  pause.poll(10'000);  // read before the run's end, perhaps
  pause.poll(11'000);  // the line has been silent since then at least
  pause.poll(14'000);
  CHECK(!pause.is_over());
  pause.poll(15'000);
  CHECK(pause.is_over());
}

TEST_CASE("with a clock the pause is as long as it must be") {
  wirebond::SendPause<4000> pause;
  pause.begin_at(0xFFFFFF00u);
  pause.poll(0xFFFFFE00u);  // read before the event
  CHECK(!pause.is_over());
  pause.poll(3743);
  CHECK(!pause.is_over());
  pause.poll(3744);
  CHECK(pause.is_over());
}
