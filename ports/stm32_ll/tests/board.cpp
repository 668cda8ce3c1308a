// See board.hpp. Which register does what: RM0090, chapters 10 (DMA) and 30 (USART).
#include "board.hpp"

#include <cstddef>

USART_TypeDef usart3_registers{};
DMA_TypeDef dma1_registers{};
DMA_Stream_TypeDef dma1_streams[8]{};
NVIC_Type nvic_registers{};

namespace {

wirebond::fake::Uart* pended_uart = nullptr;
constexpr std::uint32_t error_flags = USART_SR_PE | USART_SR_FE | USART_SR_NE | USART_SR_ORE;

std::uint8_t* bytes_at(std::uint32_t address) {
  auto* const near = reinterpret_cast<std::uint8_t*>(&usart3_registers);
  return near + static_cast<std::int32_t>(address - static_cast<std::uint32_t>(reinterpret_cast<std::uintptr_t>(near)));
}

bool is_set(std::uint32_t value, std::uint32_t bits) { return (value & bits) != 0; }

}  // namespace

void NVIC_SetPendingIRQ(IRQn_Type interrupt) {
  if (interrupt == USART3_IRQn) pended_uart->pend();
}

Board::Board(wirebond::fake::Uart& uart) : uart_(uart) {
  usart3_registers = {};
  dma1_registers = {};
  for (DMA_Stream_TypeDef& stream : dma1_streams) stream = {};
  nvic_registers = {};
  nvic_registers.ISER[USART3_IRQn / 32] = 1u << USART3_IRQn % 32;
  usart3_registers.CR1 = USART_CR1_UE;
  usart3_registers.CR3 = USART_CR3_EIE;  // a project that had the HAL before
  DMA1_Stream1->CR = DMA_SxCR_MINC | DMA_SxCR_CIRC;
  DMA1_Stream3->CR = DMA_SxCR_MINC;
  pended_uart = &uart;
}

Board::~Board() { pended_uart = nullptr; }

void Board::run(wirebond::fake::Time until) {
  using wirebond::fake::OnLineError;
  obey();
  const bool tells = is_set(usart3_registers.CR3, USART_CR3_EIE);
  uart_.behaviour.on_line_error = tells ? OnLineError::tell : OnLineError::flag;
  uart_.run(until, *this);
  show_progress();
}

void Board::obey() {
  DMA_Stream_TypeDef& receive = *DMA1_Stream1;
  const bool receives = is_set(receive.CR, DMA_SxCR_EN) && is_set(usart3_registers.CR3, USART_CR3_DMAR);
  if (uart_.receiving() && (!receives || receive.NDTR != receive_left_)) uart_.stop_receive();
  if (receives && !uart_.receiving()) {
    size_ = receive.NDTR;
    uart_.start_receive(bytes_at(receive.M0AR), size_);
    receive_left_ = size_;
  }
  DMA_Stream_TypeDef& send = *DMA1_Stream3;
  const bool sends = is_set(send.CR, DMA_SxCR_EN) && is_set(usart3_registers.CR3, USART_CR3_DMAT);
  if (uart_.transmitting() && !sends) uart_.stop_transmit();
  if (sends && !uart_.transmitting()) uart_.start_transmit(bytes_at(send.M0AR), send.NDTR);
}

/// Errors stay in the status until it was read and DMA has read a byte after that: it is read in each interrupt.
void Board::show_progress() {
  if (uart_.receiving()) {
    receive_left_ = size_ - static_cast<std::uint32_t>(uart_.receive_position());
    DMA1_Stream1->NDTR = receive_left_;
  }
  if (uart_.counts().written != written_) usart3_registers.SR.bits &= ~error_flags;
  written_ = uart_.counts().written;
  const wirebond::LineErrors errors = uart_.take_line_errors();
  usart3_registers.SR.bits |=
      (errors.framing ? USART_SR_FE : 0) | (errors.noise ? USART_SR_NE : 0) | (errors.overrun ? USART_SR_ORE : 0);
}

void Board::serve_uart() {
  if (!is_set(nvic_registers.ISER[USART3_IRQn / 32], 1u << USART3_IRQn % 32)) return;
  show_progress();
  const bool was_idle = is_set(usart3_registers.SR, USART_SR_IDLE);
  const int reads = usart3_registers.DR.reads;
  USART3_IRQHandler();
  if (usart3_registers.DR.reads != reads) {
    was_idle ? ++idles_ended_ : ++taken_bytes_;
    usart3_registers.SR.bits &= ~(USART_SR_IDLE | error_flags);
  }
  obey();
}

void Board::on_received() {
  show_progress();
  const std::size_t place = uart_.receive_position();
  if (place == 0 && !is_set(DMA1_Stream1->CR, DMA_SxCR_CIRC)) {  // the stream ends with its round
    DMA1_Stream1->CR = DMA1_Stream1->CR & ~DMA_SxCR_EN;
    uart_.stop_receive();
  }
  if (place == 0 || place == size_ / 2) {
    const std::uint32_t wanted = place == 0 ? DMA_SxCR_TCIE : DMA_SxCR_HTIE;
    if (is_set(DMA1_Stream1->CR, wanted)) DMA1_Stream1_IRQHandler();
    return obey();
  }
  usart3_registers.SR.bits |= USART_SR_IDLE;
  if (is_set(usart3_registers.CR1, USART_CR1_IDLEIE)) serve_uart();
}

void Board::on_transmitted() {
  DMA1_Stream3->CR = DMA1_Stream3->CR & ~DMA_SxCR_EN;
  DMA1_Stream3->NDTR = 0;
  usart3_registers.SR.bits |= USART_SR_TC;
  if (is_set(usart3_registers.CR1, USART_CR1_TCIE)) serve_uart();
}

void Board::starve_transmitter() {
  obey();
  usart3_registers.SR.bits |= USART_SR_TC;
  if (is_set(usart3_registers.CR1, USART_CR1_TCIE)) serve_uart();
}

void Board::on_error() {
  usart3_registers.SR.bits |= USART_SR_FE;
  serve_uart();
}

void Board::fail_receive_dma() {
  DMA1_Stream1->CR = DMA1_Stream1->CR & ~DMA_SxCR_EN;
  obey();
  DMA1_Stream1_IRQHandler();
  obey();
}

void Board::on_pended() { serve_uart(); }
