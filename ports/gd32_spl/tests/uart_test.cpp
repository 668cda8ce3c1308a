// The port on the double of the vendor's library: it keeps the contract of a port.
#include "wirebond/gd32_spl/uart.hpp"

#include <doctest/doctest.h>

#include "board.hpp"
#include "gd32f30x.h"
#include "wirebond/fake/port_contract.hpp"

namespace {

contract::Events<wirebond::gd32_spl::Uart> events{
    wirebond::gd32_spl::Wiring{USART0, DMA0, DMA_CH4, DMA_CH3, USART0_IRQn}};

struct Bench : contract::Bench<Board, wirebond::gd32_spl::Uart> {
  Bench() : contract::Bench<Board, wirebond::gd32_spl::Uart>(::events) {}
};

}  // namespace

// What a user writes, as docs/firmware.md says.
void USART0_IRQHandler() { events.uart.usart_interrupt(events); }
void DMA0_Channel3_IRQHandler() { events.uart.transmit_interrupt(events); }
void DMA0_Channel4_IRQHandler() { events.uart.receive_interrupt(events); }

PORT_KEEPS_ITS_CONTRACT(Bench);

TEST_CASE("the data register is read at an idle event alone, so that no byte is taken away from the DMA") {
  Bench bench;
  REQUIRE(bench.start());
  bench.in.put(1, 0, wirebond::fake::Fault::framing);
  bench.in.put(2, 0);
  bench.board.run(15'000);
  bench.port.pend();
  bench.board.run(50'000);
  CHECK(bench.events.log == "r");
  CHECK(bench.board.taken_bytes() == 0);
}

TEST_CASE("the transmit channel's interrupt without its flag is not a completion") {
  Bench bench;
  events.uart.transmit_interrupt(events);
  CHECK(events.log.empty());
}

TEST_CASE("a channel that does not stop is an answer, not a hang") {
  Bench bench;
  REQUIRE(bench.start());
  bench.board.hang(DMA_CH4);
  CHECK_FALSE(bench.start());
}

TEST_CASE("a channel in normal mode that has filled the ring has ended reception, and a start begins it again") {
  Bench bench;
  DMA_CHCTL(DMA0, DMA_CH4) &= ~DMA_CHXCTL_CMEN;
  REQUIRE(bench.start());
  for (std::uint8_t i = 0; i < 15; ++i) bench.in.put(i, 0);
  bench.board.run(155'000);
  CHECK(bench.port.receiving());
  bench.in.put(15, 160'000);
  bench.board.run(200'000);
  CHECK((DMA_CHCTL(DMA0, DMA_CH4) & DMA_CHXCTL_CHEN) != 0);
  CHECK_FALSE(bench.port.receiving());
  REQUIRE(bench.start());
  CHECK(bench.port.receiving());
}

TEST_CASE("each mistake in the settings is reported by its name") {
  using wirebond::Why;
  Bench bench;
  NVIC->ISER[USART0_IRQn / 32] = 1u << USART0_IRQn % 32;
  CHECK(bench.port.check(115'200) == Why::nothing);
  NVIC->ISER[USART0_IRQn / 32] = 0;
  CHECK(bench.port.check(115'200) == Why::interrupt_off);
  DMA_CHCTL(DMA0, DMA_CH4) &= ~DMA_CHXCTL_CMEN;
  CHECK(bench.port.check(115'200) == Why::receive_dma_not_circular);
  DMA_CHCTL(DMA0, DMA_CH3) = 0;
  CHECK(bench.port.check(115'200) == Why::no_transmit_dma);
  DMA_CHCTL(DMA0, DMA_CH4) = 0;
  CHECK(bench.port.check(115'200) == Why::no_receive_dma);
  USART_CTL0(USART0) = 0;
  CHECK(bench.port.check(115'200) == Why::uart_not_set_up);
}
