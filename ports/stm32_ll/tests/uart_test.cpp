// The ports in C++ and in C on registers in memory: both keep the contract of a port.
#include "wirebond/stm32_ll/uart.hpp"

#include <doctest/doctest.h>

#include <string>

#include "../c/wirebond_stm32_ll.h"
#include "board.hpp"
#include "wirebond/fake/port_contract.hpp"

namespace fake = wirebond::fake;
using contract::Bytes;

namespace {

constexpr wirebond::stm32_ll::Wiring wiring{USART3, DMA1, DMA1_Stream1, 1, DMA1_Stream3, 3, USART3_IRQn};
std::string pin_log;

/// The port in C, as a link asks it: by its table. Its handlers are those that its header shows.
class InC {
 public:
  explicit InC(const wirebond::stm32_ll::Wiring& wires) { uart_.registers.wiring = wires; }

  bool start_receive(std::uint8_t* ring, std::size_t size) { return table_.start_receive(table_.context, ring, size); }
  bool receiving() const { return table_.receiving(table_.context); }
  std::size_t receive_position() const { return table_.receive_position(table_.context); }
  void stop_receive() { table_.stop_receive(table_.context); }
  bool start_transmit(const std::uint8_t* bytes, std::size_t size) {
    return table_.start_transmit(table_.context, bytes, size);
  }
  void stop_transmit() { table_.stop_transmit(table_.context); }
  void line_free() { table_.line_free(table_.context); }
  void pend() { table_.pend(table_.context); }
  bool reaches(const void* bytes, std::size_t size) const { return table_.reaches(table_.context, bytes, size); }
  wirebond::Why check(std::uint32_t baud) const {
    return static_cast<wirebond::Why>(table_.check(table_.context, baud));
  }
  wirebond::LineErrors take_line_errors() {
    const wirebond_line_errors_t errors = table_.take_line_errors(table_.context);
    return {errors.framing, errors.noise, errors.overrun, errors.parity};
  }
  void set_driver(void (*drive)(bool on)) { uart_.drive = drive; }

  template <class Link>
  void usart_interrupt(Link& link) {
    link.on_pended();
    const wirebond_stm32_events_t events = wirebond_stm32_ll_usart_events(&uart_);
    if (events.received) link.on_received();
    if (events.transmitted) link.on_transmitted();
  }
  template <class Link>
  void receive_interrupt(Link& link) {
    wirebond_stm32_ll_receive_event(&uart_) ? link.on_received() : link.on_error();
  }

 private:
  wirebond_stm32_ll_t uart_{};
#pragma GCC diagnostic push
#pragma GCC diagnostic ignored "-Wmissing-field-initializers"  // C leaves them out without a word
  const wirebond_port_t table_ = WIREBOND_STM32_LL_PORT(uart_, nullptr);
#pragma GCC diagnostic pop
};

template <class Port>
contract::Events<Port> events{wiring};

bool in_c = false;  // which port has the interrupts

template <class Port>
struct Tested : contract::Bench<Board, Port> {
  Tested() : contract::Bench<Board, Port>(events<Port>) {
    in_c = std::is_same_v<Port, InC>;
    this->port.stop_transmit();
  }
};

using InCpp = wirebond::stm32_ll::Uart;

}  // namespace

// What a user writes, as docs/firmware.md and docs/c.md say.
void USART3_IRQHandler() {
  in_c ? events<InC>.uart.usart_interrupt(events<InC>) : events<InCpp>.uart.usart_interrupt(events<InCpp>);
}
void DMA1_Stream1_IRQHandler() {
  in_c ? events<InC>.uart.receive_interrupt(events<InC>) : events<InCpp>.uart.receive_interrupt(events<InCpp>);
}

PORT_KEEPS_ITS_CONTRACT(Tested<InCpp>, Tested<InC>);

TEST_CASE_TEMPLATE("line errors of all kinds never end reception: every byte that DMA moved is in the ring, in order",
                   Port, InCpp, InC) {
  Tested<Port> bench;
  bench.in.faults = {4'000, 3'000, 3'000, 0};  // 1 in 100 bytes
  bench.uart.behaviour.spurious = 20'000;
  REQUIRE(bench.start());
  Bytes got;
  std::size_t read = 0;
  for (fake::Time now = 0; now < 200'000'000; now += 80'000) {
    for (int i = 0; i < 6; ++i) bench.in.put(static_cast<std::uint8_t>(i), now);
    bench.board.run(now + 80'000);
    for (; read != bench.port.receive_position(); read = (read + 1) % 16) got.push_back(bench.events.ring[read]);
  }
  Bytes moved;
  for (const fake::LineByte& byte : bench.in.bytes()) {
    if (byte.fate == fake::Fate::received || byte.fate == fake::Fate::damaged) moved.push_back(byte.seen);
  }
  CHECK(got == moved);
  CHECK(bench.in.count(fake::Fate::damaged) > 80);
  CHECK(bench.uart.counts().receive_starts == 1);
  CHECK(bench.events.log.find('e') == std::string::npos);
  CHECK(bench.events.framing > 40);
  CHECK(bench.events.noise > 30);
  CHECK(bench.events.overruns > 30);
  CHECK(bench.events.framing + bench.events.noise <= bench.in.count(fake::Fate::damaged));
  CHECK(bench.board.idles_ended() > 1'000);
  CHECK(bench.board.taken_bytes() == 0);
}

TEST_CASE_TEMPLATE("an error of the DMA is reported, and a start within it brings bytes again", Port, InCpp, InC) {
  Tested<Port> bench;
  REQUIRE(bench.start());
  bench.in.put(Bytes{1, 2}, 0);
  bench.board.run(50'000);
  bench.board.fail_receive_dma();
  CHECK(bench.events.log == "re");
  CHECK(bench.events.is_started);
  CHECK(bench.port.receiving());
  bench.in.put(6, 60'000);
  bench.board.run(90'000);
  CHECK(bench.port.receive_position() == 1);
  CHECK(bench.events.ring[0] == 6);
}

TEST_CASE_TEMPLATE("a UART that waits for a late DMA has not completed", Port, InCpp, InC) {
  Tested<Port> bench;
  REQUIRE(bench.send());
  bench.board.run(15'000);
  bench.board.starve_transmitter();
  CHECK(bench.events.log.empty());
  bench.board.run(100'000);
  CHECK(bench.events.log == "t");
}

TEST_CASE_TEMPLATE("a carrier in normal mode that has filled the ring has ended reception, though it stays enabled",
                   Port, InCpp, InC) {  // as the channels of F1, G0, G4 and L4 do; a stream clears its bit
  Tested<Port> bench;
  REQUIRE(bench.start());
  const std::uint32_t size = DMA1_Stream1->NDTR;
  DMA1_Stream1->NDTR = 0;
  CHECK(bench.port.receiving());  // in circles: it is about to begin the next round
  DMA1_Stream1->CR = DMA1_Stream1->CR & ~DMA_SxCR_CIRC;
  CHECK_FALSE(bench.port.receiving());
  DMA1_Stream1->NDTR = size;
  CHECK(bench.port.receiving());
}

TEST_CASE_TEMPLATE("each mistake in the settings is reported by its name", Port, InCpp, InC) {
  using wirebond::Why;
  Tested<Port> bench;
  CHECK(bench.port.check(115'200) == Why::nothing);
  NVIC->ISER[USART3_IRQn / 32] = 0;
  CHECK(bench.port.check(115'200) == Why::interrupt_off);
  DMA1_Stream1->CR = DMA_SxCR_MINC;
  CHECK(bench.port.check(115'200) == Why::receive_dma_not_circular);
  DMA1_Stream3->CR = 0;
  CHECK(bench.port.check(115'200) == Why::no_transmit_dma);
  DMA1_Stream1->CR = 0;
  CHECK(bench.port.check(115'200) == Why::no_receive_dma);
  USART3->CR1 = 0;
  CHECK(bench.port.check(115'200) == Why::uart_not_set_up);
}

TEST_CASE("in C the driver of RS-485 is on from before a run until nothing follows it, where there is one") {
  Tested<InC> bench;
  pin_log.clear();
  bench.port.line_free();
  CHECK(pin_log.empty());
  bench.port.set_driver([](bool on) { pin_log += on ? '+' : '-'; });
  REQUIRE(bench.send());
  CHECK(pin_log == "+");
  bench.board.run(100'000);
  CHECK(pin_log == "+");
  bench.port.line_free();
  CHECK(pin_log == "+-");
  bench.port.set_driver(nullptr);
}
