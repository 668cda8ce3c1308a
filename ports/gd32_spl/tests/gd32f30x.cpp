// The double's functions: registers and flags, and the UART of fake/ that they control.
#include "gd32f30x.h"

#include <array>

#include "board.hpp"

using wirebond::fake::Uart;

namespace {

struct Channel {
  std::uint32_t control = 0;
  std::uint32_t flags = 0;
  std::uint32_t number = 0;
  std::uint8_t* memory = nullptr;
  bool hangs = false;
};

struct Registers {
  Uart* uart = nullptr;
  std::array<Channel, 8> channels{};
  std::uint32_t control_0 = USART_CTL0_UEN;
  std::uint32_t control_2 = 0;
  std::uint32_t status = 0;
  bool idle_enabled = false;
  bool has_ended = false;         ///< the receive channel, in normal mode
  std::uint64_t written = 0;      ///< bytes in memory when an interrupt last ran
  std::uint64_t taken_bytes = 0;  ///< reads of the data register while a byte may come
};

Registers registers;
Channel& of(dma_channel_enum channel) { return registers.channels[channel]; }

}  // namespace

Board::Board(Uart& uart) {
  registers = {};
  registers.uart = &uart;
  of(DMA_CH4).control = DMA_CHXCTL_MNAGA | DMA_CHXCTL_CMEN;
  of(DMA_CH3).control = DMA_CHXCTL_MNAGA;
}

Board::~Board() { registers = {}; }

void Board::run(wirebond::fake::Time until) {
  using wirebond::fake::OnLineError;
  const bool tells = (registers.control_2 & USART_CTL2_ERRIE) != 0;
  registers.uart->behaviour.on_line_error = tells ? OnLineError::tell : OnLineError::flag;
  registers.uart->run(until, *this);
}

std::uint64_t Board::taken_bytes() const { return registers.taken_bytes; }

/// In the status they stay until it was read and DMA has read a byte after that: it is read in each interrupt.
void Board::show_errors() {
  if (registers.uart->counts().written != registers.written) registers.status &= USART_STAT0_IDLEF;
  registers.written = registers.uart->counts().written;
  const wirebond::LineErrors errors = registers.uart->take_line_errors();
  registers.status |= (errors.framing ? USART_STAT0_FERR : 0) | (errors.noise ? USART_STAT0_NERR : 0) |
                      (errors.overrun ? USART_STAT0_ORERR : 0);
}

void Board::hang(dma_channel_enum channel) { of(channel).hangs = true; }

void Board::on_received() {
  show_errors();
  const std::size_t place = registers.uart->receive_position();
  const std::uint32_t size = of(DMA_CH4).number;
  if (place == 0 && (of(DMA_CH4).control & DMA_CHXCTL_CMEN) == 0) {  // it has read its round, and stays enabled
    registers.uart->stop_receive();
    registers.has_ended = true;
  }
  if (place == 0 || place == size / 2) {
    of(DMA_CH4).flags |= place == 0 ? DMA_INTF_FTFIF : DMA_INTF_HTFIF;
    if ((of(DMA_CH4).control & of(DMA_CH4).flags) != 0) DMA0_Channel4_IRQHandler();
  } else if (registers.idle_enabled) {
    registers.status |= USART_STAT0_IDLEF;
    USART0_IRQHandler();
  }
}

void Board::on_transmitted() {
  of(DMA_CH3).flags |= DMA_INTF_FTFIF;
  if ((of(DMA_CH3).control & DMA_CHXCTL_FTFIE) != 0) DMA0_Channel3_IRQHandler();
}

void Board::on_error() {
  registers.status |= USART_STAT0_FERR;
  if ((registers.control_2 & USART_CTL2_ERRIE) != 0) USART0_IRQHandler();
}

void Board::on_pended() {
  show_errors();
  USART0_IRQHandler();
}

std::uint32_t& DMA_CHCTL(std::uint32_t, dma_channel_enum channel) { return of(channel).control; }
std::uint32_t& USART_CTL0(std::uint32_t) { return registers.control_0; }
std::uint32_t& USART_CTL2(std::uint32_t) { return registers.control_2; }
std::uint32_t& USART_STAT0(std::uint32_t) { return registers.status; }

void dma_channel_enable(std::uint32_t, dma_channel_enum channel) {
  Channel& it = of(channel);
  it.control |= DMA_CHXCTL_CHEN;
  if (channel == DMA_CH4) {
    registers.has_ended = false;
    registers.uart->start_receive(it.memory, it.number);
  } else {
    registers.uart->start_transmit(it.memory, it.number);
  }
}

void dma_channel_disable(std::uint32_t, dma_channel_enum channel) {
  if (of(channel).hangs) return;
  of(channel).control &= ~DMA_CHXCTL_CHEN;
  if (channel == DMA_CH4) {
    registers.uart->stop_receive();
  } else {
    of(channel).number = static_cast<std::uint32_t>(registers.uart->waiting());
    registers.uart->stop_transmit();
  }
}

void dma_memory_address_config(std::uint32_t, dma_channel_enum channel, std::uint32_t address) {
  auto* const near = reinterpret_cast<std::uint8_t*>(&registers);
  const auto base = static_cast<std::uint32_t>(reinterpret_cast<std::uintptr_t>(near));
  of(channel).memory = near + static_cast<std::int32_t>(address - base);
}

void dma_transfer_number_config(std::uint32_t, dma_channel_enum channel, std::uint32_t number) {
  of(channel).number = number;
}

std::uint32_t dma_transfer_number_get(std::uint32_t, dma_channel_enum channel) {
  if (channel == DMA_CH4 && registers.has_ended) return 0;
  if (channel == DMA_CH4) return of(channel).number - static_cast<std::uint32_t>(registers.uart->receive_position());
  if (!registers.uart->transmitting()) return (of(channel).control & DMA_CHXCTL_CHEN) != 0 ? 0 : of(channel).number;
  return 1 + static_cast<std::uint32_t>(registers.uart->waiting());
}

void dma_interrupt_enable(std::uint32_t, dma_channel_enum channel, std::uint32_t source) {
  of(channel).control |= source;
}

FlagStatus dma_interrupt_flag_get(std::uint32_t, dma_channel_enum channel, std::uint32_t flag) {
  return (of(channel).flags & flag) != 0 ? SET : RESET;
}

void dma_interrupt_flag_clear(std::uint32_t, dma_channel_enum channel, std::uint32_t flag) {
  of(channel).flags &= ~flag;
}

std::uint16_t usart_data_receive(std::uint32_t) {
  if ((registers.status & USART_STAT0_IDLEF) == 0 && registers.uart->receiving()) registers.taken_bytes += 1;
  registers.status = 0;  // the status was read before
  return 0;
}

void usart_interrupt_enable(std::uint32_t, usart_interrupt_enum) { registers.idle_enabled = true; }

void usart_interrupt_disable(std::uint32_t, usart_interrupt_enum) { registers.idle_enabled = false; }

FlagStatus usart_interrupt_flag_get(std::uint32_t, usart_interrupt_flag_enum) {
  return (registers.status & USART_STAT0_IDLEF) != 0 ? SET : RESET;
}

void NVIC_SetPendingIRQ(IRQn_Type interrupt) {
  if (interrupt == USART0_IRQn) registers.uart->pend();
}
