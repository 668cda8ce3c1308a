// See registers.hpp. Which register does what: RM0090, chapters 10 (DMA) and 30 (USART).
#include "registers.hpp"

#include <cstdlib>
#include <cstring>

namespace {

/// The HAL works out a stream's number and its flags' place from the low bits of its address.
struct alignas(1024) Dma {
  DMA_TypeDef flags;
  DMA_Stream_TypeDef streams[8];
};
static_assert(sizeof(DMA_TypeDef) == 0x10 && sizeof(DMA_Stream_TypeDef) == 0x18, "as in hardware");

Dma dma1;
USART_TypeDef usart3;
DMA_HandleTypeDef receive_dma, send_dma;
Board* board = nullptr;
std::uint32_t ticks = 0;

DMA_Stream_TypeDef& receive_stream() { return dma1.streams[1]; }
DMA_Stream_TypeDef& send_stream() { return dma1.streams[3]; }

constexpr std::uint32_t error_flags = USART_SR_PE | USART_SR_FE | USART_SR_NE | USART_SR_ORE;

bool runs(const DMA_Stream_TypeDef& stream) { return (stream.CR & DMA_SxCR_EN) != 0; }

std::uint8_t* bytes_of(const DMA_Stream_TypeDef& stream) {
  return reinterpret_cast<std::uint8_t*>(static_cast<std::uintptr_t>(stream.M0AR));
}

bool start(DMA_HandleTypeDef& dma, DMA_Stream_TypeDef& stream, std::uint32_t direction, std::uint32_t mode) {
  dma = {};
  dma.Instance = &stream;
  dma.Init.Channel = DMA_CHANNEL_4;
  dma.Init.Direction = direction;
  dma.Init.MemInc = DMA_MINC_ENABLE;
  dma.Init.Mode = mode;
  return HAL_DMA_Init(&dma) == HAL_OK;
}

}  // namespace

UART_HandleTypeDef huart3;

Board::Board(wirebond::fake::Uart& uart) : uart_(uart) {
  board = this;
  std::memset(&dma1, 0, sizeof dma1);
  std::memset(&usart3, 0, sizeof usart3);
  huart3 = {};
  huart3.Instance = &usart3;
  huart3.Init.BaudRate = 2'000'000;
  huart3.Init.StopBits = UART_STOPBITS_2;
  huart3.Init.Mode = UART_MODE_TX_RX;
  if (!start(receive_dma, receive_stream(), DMA_PERIPH_TO_MEMORY, DMA_CIRCULAR) ||
      !start(send_dma, send_stream(), DMA_MEMORY_TO_PERIPH, DMA_NORMAL)) {
    std::abort();
  }
  __HAL_LINKDMA(&huart3, hdmarx, receive_dma);
  __HAL_LINKDMA(&huart3, hdmatx, send_dma);
  if (HAL_UART_Init(&huart3) != HAL_OK) std::abort();
}

Board::~Board() { board = nullptr; }

std::uint32_t Board::baud_divider() const { return usart3.BRR; }

void Board::obey() {
  clear_flags();
  const bool interrupts = (usart3.CR3 & USART_CR3_EIE) != 0;
  uart_.behaviour.on_line_error = interrupts ? wirebond::fake::OnLineError::tell : wirebond::fake::OnLineError::flag;
  DMA_Stream_TypeDef& receive = receive_stream();
  const bool receives = runs(receive) && (usart3.CR3 & USART_CR3_DMAR) != 0;
  if (uart_.receiving() && (!receives || receive.NDTR != receive_left_)) uart_.stop_receive();
  if (receives && !uart_.receiving()) {
    uart_.start_receive(bytes_of(receive), receive.NDTR);
    receive_left_ = receive.NDTR;
    told_place_ = 0;
  }
  DMA_Stream_TypeDef& send = send_stream();
  const bool sends = runs(send) && (usart3.CR3 & USART_CR3_DMAT) != 0;
  if (uart_.transmitting() && (!sends || send.NDTR != send_left_)) uart_.stop_transmit();
  if (sends && !uart_.transmitting()) {
    uart_.start_transmit(bytes_of(send), send.NDTR);
    send_left_ = send.NDTR;
  }
}

/// Writing 1 to a bit of a clear register clears the flag of that place. The USART's flags for an event are cleared by
/// the HAL's handler for it.
void Board::clear_flags() {
  dma1.flags.LISR = dma1.flags.LISR & ~dma1.flags.LIFCR;
  dma1.flags.LIFCR = 0;
  usart3.SR = USART_SR_TXE | errors_;
}

/// In the status they stay until it was read, which each interrupt does, and then the data, by DMA or the HAL.
void Board::show_errors() {
  if (uart_.receiving()) {
    receive_left_ = static_cast<std::uint32_t>(huart3.RxXferSize - uart_.receive_position());
    receive_stream().NDTR = receive_left_;
  }
  if (uart_.counts().written != written_) errors_ = 0;
  written_ = uart_.counts().written;
  const wirebond::LineErrors errors = uart_.take_line_errors();
  if (errors.framing) errors_ |= USART_SR_FE;
  if (errors.noise) errors_ |= USART_SR_NE;
  if (errors.overrun) errors_ |= USART_SR_ORE;
  usart3.SR = (usart3.SR & ~error_flags) | errors_;
}

/// USART3_IRQHandler, as the guide has it.
void Board::serve_uart() {
  show_errors();
  const std::uint32_t status = usart3.SR;
  usart3_pended();
  usart3.SR = usart3.SR & status;  // the HAL clears flags by writing 0 there; a 1 sets none
  HAL_UART_IRQHandler(&huart3);
}

void Board::serve_receive_dma(std::uint32_t flags) {
  show_errors();
  dma1.flags.LISR = dma1.flags.LISR | flags;
  HAL_DMA_IRQHandler(&receive_dma);
  obey();
}

void Board::on_received() {
  const std::size_t size = huart3.RxXferSize;
  const std::size_t place = uart_.receive_position();
  const bool passed_half =
      told_place_ < size / 2 ? place >= size / 2 || place < told_place_ : place < told_place_ && place >= size / 2;
  const bool passed_end = place < told_place_;
  told_place_ = place;
  receive_left_ = static_cast<std::uint32_t>(size - place);
  receive_stream().NDTR = receive_left_;
  if (passed_half) serve_receive_dma(DMA_LISR_HTIF1);
  if (passed_end) serve_receive_dma(DMA_LISR_TCIF1);
  usart3.SR = usart3.SR | USART_SR_IDLE;
  serve_uart();
  errors_ = 0;  // the HAL reads the data to clear the idle flag
  obey();
}

void Board::on_transmitted() {
  send_stream().CR = send_stream().CR & ~DMA_SxCR_EN;
  send_stream().NDTR = 0;
  dma1.flags.LISR = dma1.flags.LISR | DMA_LISR_TCIF3;
  HAL_DMA_IRQHandler(&send_dma);
  clear_flags();
  usart3.SR = usart3.SR | USART_SR_TC;
  serve_uart();
  obey();
}

void Board::on_error() {
  errors_ |= USART_SR_FE;
  serve_uart();
  errors_ = 0;
  const bool was_stopped = !runs(receive_stream());
  obey();
  if (was_stopped) serve_receive_dma(DMA_LISR_TCIF1);  // a stream that is disabled says so
}

void Board::fail_receive_dma() {
  receive_stream().CR = receive_stream().CR & ~DMA_SxCR_EN;
  serve_receive_dma(DMA_LISR_TEIF1);
}

void Board::on_pended() {
  serve_uart();
  obey();
}

// ---- functions of the rest of the HAL that the drivers call

extern "C" {

uint32_t SystemCoreClock = 168'000'000;
uint32_t HAL_RCC_GetPCLK1Freq() { return 42'000'000; }
uint32_t HAL_RCC_GetPCLK2Freq() { return 84'000'000; }
uint32_t HAL_GetTick() { return ++ticks; }
uint32_t uwTickPrio = 0;
NVIC_Type nvic_registers;
uint32_t NVIC_GetPriority(IRQn_Type) { return 5; }
void NVIC_SetPendingIRQ(IRQn_Type interrupt) {
  if (interrupt == USART3_IRQn) board->pend();
}

}  // extern "C"
