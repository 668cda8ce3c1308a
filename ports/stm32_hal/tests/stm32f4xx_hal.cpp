// The double's functions: the HAL's states and answers, and the UART of fake/ in the place of registers.
#include "stm32f4xx_hal.h"

#include "board.hpp"

using wirebond::fake::Uart;

namespace {

USART_TypeDef usart3{};
DMA_HandleTypeDef hdma_usart3_rx{};
DMA_HandleTypeDef hdma_usart3_tx{};
Uart& uart_of(UART_HandleTypeDef* handle) { return *static_cast<Uart*>(handle->uart); }

}  // namespace

UART_HandleTypeDef huart3{};
NVIC_Type nvic_registers{};
GPIO_TypeDef gpio_b_registers{};
uint32_t uwTickPrio = 0;
uint32_t ticks = 0;

Board::Board(Uart& uart) : uart_(uart) {
  huart3 = {};
  usart3 = {};
  huart3.Instance = &usart3;
  hdma_usart3_rx = {{DMA_CIRCULAR}, &huart3};
  hdma_usart3_tx = {{DMA_NORMAL}, &huart3};
  huart3.hdmarx = &hdma_usart3_rx;
  huart3.hdmatx = &hdma_usart3_tx;
  huart3.Init.BaudRate = 115200;
  huart3.gState = huart3.RxState = HAL_UART_STATE_READY;
  nvic_registers = {};
  nvic_registers.ISER[USART3_IRQn / 32] = 1u << USART3_IRQn % 32;
  uwTickPrio = 0;
  ticks = 0;
  huart3.uart = &uart;
}

Board::~Board() { huart3 = {}; }

void Board::run(wirebond::fake::Time until) {
  using wirebond::fake::OnLineError;
  uart_.behaviour.on_line_error = (usart3.CR3 & USART_CR3_EIE) != 0 ? OnLineError::stop : OnLineError::flag;
  uart_.run(until, *this);
  ticks = static_cast<uint32_t>(until / 1'000'000);
}

/// In the status they stay until it was read and DMA has read a byte after that: it is read in each interrupt.
void Board::show_errors() {
  if (uart_.counts().written != written_) usart3.SR = 0;
  written_ = uart_.counts().written;
  const wirebond::LineErrors errors = uart_.take_line_errors();
  usart3.SR = usart3.SR | (errors.framing ? UART_FLAG_FE : 0) | (errors.noise ? UART_FLAG_NE : 0) |
              (errors.overrun ? UART_FLAG_ORE : 0);
}

void Board::on_received() {
  show_errors();
  if (huart3.RxState != HAL_UART_STATE_BUSY_RX) return;
  if (!uart_.receiving()) huart3.RxState = HAL_UART_STATE_READY;  // DMA is in normal mode
  // Half, full and idle have different values here. Where DMA is by now may be further: the port must not care.
  const auto place = static_cast<std::uint16_t>(uart_.receive_position());
#if USE_HAL_UART_REGISTER_CALLBACKS == 1
  huart3.RxEventCallback(&huart3, place);
#else
  HAL_UARTEx_RxEventCallback(&huart3, place);
#endif
}

void Board::on_transmitted() {
  huart3.gState = HAL_UART_STATE_READY;
#if USE_HAL_UART_REGISTER_CALLBACKS == 1
  huart3.TxCpltCallback(&huart3);
#else
  HAL_UART_TxCpltCallback(&huart3);
#endif
}

void Board::on_error() {
  if (!uart_.transmitting()) huart3.gState = HAL_UART_STATE_READY;
  huart3.RxState = HAL_UART_STATE_READY;
#if USE_HAL_UART_REGISTER_CALLBACKS == 1
  huart3.ErrorCallback(&huart3);
#else
  HAL_UART_ErrorCallback(&huart3);
#endif
}

void Board::on_pended() {
  show_errors();
  if (nvic_registers.ISER[USART3_IRQn / 32] != 0) USART3_IRQHandler();
}

extern "C" {

HAL_StatusTypeDef HAL_UARTEx_ReceiveToIdle_DMA(UART_HandleTypeDef* huart, uint8_t* pData, uint16_t Size) {
  if (huart->RxState != HAL_UART_STATE_READY) return HAL_BUSY;
  if (pData == nullptr || Size == 0) return HAL_ERROR;
  huart->RxXferSize = Size;
  uart_of(huart).behaviour.circular = huart->hdmarx->Init.Mode == DMA_CIRCULAR;
  if (!uart_of(huart).start_receive(pData, Size)) return HAL_ERROR;  // its DMA is being stopped
  huart->RxState = HAL_UART_STATE_BUSY_RX;
  huart->Instance->CR3 |= USART_CR3_EIE;
  return HAL_OK;
}

HAL_StatusTypeDef HAL_UART_Transmit_DMA(UART_HandleTypeDef* huart, const uint8_t* pData, uint16_t Size) {
  if (huart->gState != HAL_UART_STATE_READY) return HAL_BUSY;
  if (pData == nullptr || Size == 0) return HAL_ERROR;
  if (!uart_of(huart).start_transmit(pData, Size)) return HAL_ERROR;
  huart->gState = HAL_UART_STATE_BUSY_TX;
  return HAL_OK;
}

HAL_StatusTypeDef HAL_UART_AbortReceive(UART_HandleTypeDef* huart) {
  uart_of(huart).stop_receive();
  huart->RxState = HAL_UART_STATE_READY;
  return HAL_OK;
}

HAL_StatusTypeDef HAL_UART_AbortTransmit(UART_HandleTypeDef* huart) {
  uart_of(huart).stop_transmit();
  huart->gState = HAL_UART_STATE_READY;
  return HAL_OK;
}

uint32_t __HAL_DMA_GET_COUNTER(const DMA_HandleTypeDef* hdma) {
  const auto left = hdma->Parent->RxXferSize - uart_of(hdma->Parent).receive_position();
  return static_cast<uint32_t>(left);
}

void HAL_GPIO_WritePin(GPIO_TypeDef* GPIOx, uint16_t GPIO_Pin, GPIO_PinState PinState) {
  GPIOx->ODR = PinState == GPIO_PIN_SET ? GPIOx->ODR | GPIO_Pin : GPIOx->ODR & ~static_cast<uint32_t>(GPIO_Pin);
}

void NVIC_SetPendingIRQ(IRQn_Type IRQn) {
  if (IRQn == USART3_IRQn) uart_of(&huart3).pend();
}

uint32_t NVIC_GetPriority(IRQn_Type) { return 5; }

uint32_t HAL_GetTick() { return ticks; }

#if USE_HAL_UART_REGISTER_CALLBACKS == 1
HAL_StatusTypeDef HAL_UART_RegisterCallback(UART_HandleTypeDef* huart, HAL_UART_CallbackIDTypeDef CallbackID,
                                            pUART_CallbackTypeDef pCallback) {
  if (huart->gState != HAL_UART_STATE_READY) return HAL_ERROR;
  (CallbackID == HAL_UART_TX_COMPLETE_CB_ID ? huart->TxCpltCallback : huart->ErrorCallback) = pCallback;
  return HAL_OK;
}

HAL_StatusTypeDef HAL_UART_RegisterRxEventCallback(UART_HandleTypeDef* huart, pUART_RxEventCallbackTypeDef pCallback) {
  if (huart->gState != HAL_UART_STATE_READY) return HAL_ERROR;
  huart->RxEventCallback = pCallback;
  return HAL_OK;
}
#endif

}  // extern "C"
