// A port: a UART of an STM32 through the vendor's HAL, with circular DMA in and DMA out. It defines no HAL callback.
#pragma once

// The HAL of the family whose headers exist. For another family, include its HAL before this header.
#ifndef HAL_UART_MODULE_ENABLED
#if __has_include("stm32f4xx_hal.h")
#include "stm32f4xx_hal.h"
#elif __has_include("stm32g4xx_hal.h")
#include "stm32g4xx_hal.h"
#elif __has_include("stm32h7xx_hal.h")
#include "stm32h7xx_hal.h"
#endif
#ifndef HAL_UART_MODULE_ENABLED
#error "no HAL with HAL_UART_MODULE_ENABLED: add its folder to the include path, or include it before this header"
#endif
#endif

#include <cstddef>
#include <cstdint>

#include "wirebond/mcu/dma_uart.h"
#include "wirebond/mcu/line_errors.hpp"
#include "wirebond/mcu/why.hpp"
#include "wirebond/stm32/reach.h"

extern "C" uint32_t uwTickPrio;  // of the HAL: the priority of its tick

namespace wirebond::stm32_hal {

/// Your project initialises the UART: CubeMX's MX_USARTn_UART_Init with a circular RX DMA and a normal TX DMA. All
/// functions except `pend` are for the UART's interrupt and its DMA's, which have one priority; Link calls them only
/// there.
///
/// Forward three callbacks of the HAL (or `register_events`), and `pend` from the UART's handler:
///   HAL_UARTEx_RxEventCallback -> link.on_received()     HAL_UART_TxCpltCallback -> link.on_transmitted()
///   HAL_UART_ErrorCallback     -> link.on_error()        USARTn_IRQHandler, before the HAL's -> link.on_pended()
///
/// Line errors do not end reception, as they would with the HAL: its interrupt for them is disabled, DMA continues, and
/// the checks reject the frame. The UART's status shows the errors since its last interrupt. It is read before the
/// HAL's handler runs, because that clears it. Only an error of DMA itself calls HAL_UART_ErrorCallback.
class Uart {
 public:
  /// `interrupt`: the UART's own, for example USART3_IRQn. `handle` must outlive this object.
  Uart(UART_HandleTypeDef& handle, IRQn_Type interrupt) : handle_(handle), interrupt_(interrupt) {}

  /// Returns false while DMA is still being stopped after an error (the HAL returns HAL_BUSY or HAL_ERROR), or without
  /// a DMA, which the HAL does not check.
  bool start_receive(std::uint8_t* ring, std::size_t size) {
    if (handle_.hdmarx == nullptr) return false;
    // After a DMA error the HAL reports ready with the stream still running, and would never start again.
    if (HAL_UART_AbortReceive(&handle_) != HAL_OK) return false;
    if (HAL_UARTEx_ReceiveToIdle_DMA(&handle_, ring, static_cast<std::uint16_t>(size)) != HAL_OK) return false;
    // The HAL enabled them, and would end reception for each error.
    clear_bits(handle_.Instance->CR3, USART_CR3_EIE);
    clear_bits(handle_.Instance->CR1, USART_CR1_PEIE);
    return true;
  }

  /// Return the errors in the UART's status since the last call.
  LineErrors take_line_errors() {
#ifdef UART_CLEAR_FEF  // families that clear flags by writing them: F0, F3, F7, G0, G4, H7, L4
    const std::uint32_t flags = handle_.Instance->ISR;
    handle_.Instance->ICR = UART_CLEAR_PEF | UART_CLEAR_FEF | UART_CLEAR_NEF | UART_CLEAR_OREF;
#else
    const std::uint32_t left = __HAL_DMA_GET_COUNTER(handle_.hdmarx);  // F1, F2, F4
    const std::uint32_t flags = wirebond_new_flags(&look_, handle_.Instance->SR, left);
#endif
    return {(flags & UART_FLAG_FE) != 0, (flags & UART_FLAG_NE) != 0, (flags & UART_FLAG_ORE) != 0,
            (flags & UART_FLAG_PE) != 0};
  }

  /// False after an error of DMA: the HAL ends reception.
  bool receiving() const { return handle_.RxState == HAL_UART_STATE_BUSY_RX; }

  /// Any context.
  std::size_t receive_position() const {
    return wirebond_ring_position(handle_.RxXferSize, __HAL_DMA_GET_COUNTER(handle_.hdmarx));
  }

  /// Called when a link is stopped.
  void stop_receive() { static_cast<void>(HAL_UART_AbortReceive(&handle_)); }

  bool start_transmit(const std::uint8_t* bytes, std::size_t size) {
    if (handle_.hdmatx == nullptr) return false;
    auto* mutable_bytes = const_cast<std::uint8_t*>(bytes);  // older HALs lack the const, but do not write
    return HAL_UART_Transmit_DMA(&handle_, mutable_bytes, static_cast<std::uint16_t>(size)) == HAL_OK;
  }

  void stop_transmit() { static_cast<void>(HAL_UART_AbortTransmit(&handle_)); }

  /// Any task, any interrupt.
  void pend() { NVIC_SetPendingIRQ(interrupt_); }

  /// The HAL counts bytes in 16 bits, and DMA does not reach all memory.
  bool reaches(const void* bytes, std::size_t size) const {
    return wirebond_stm32_dma_reaches(WIREBOND_STM32_FAMILY, reinterpret_cast<std::uintptr_t>(bytes), size);
  }

  /// For Link::why, which detects with it that `poll` gets HAL_GetTick() as if it were microseconds.
  std::uint32_t tick_ms() const { return HAL_GetTick(); }

  /// For Link::why: return the fault of CubeMX's settings. Priorities are compared as HAL_Init groups them: no bit is a
  /// subpriority.
  Why check(std::uint32_t baud) const {
    if (handle_.gState == HAL_UART_STATE_RESET) return Why::uart_not_set_up;
    if (handle_.hdmarx == nullptr) return Why::no_receive_dma;
    if (handle_.hdmatx == nullptr) return Why::no_transmit_dma;
    if (handle_.hdmarx->Init.Mode != DMA_CIRCULAR) return Why::receive_dma_not_circular;
    if (handle_.Init.BaudRate != baud) return Why::baud_differs;
    if (!wirebond_interrupt_enabled(NVIC->ISER, static_cast<std::uint32_t>(interrupt_))) return Why::interrupt_off;
    return uwTickPrio >= NVIC_GetPriority(interrupt_) ? Why::tick_below_uart : Why::nothing;
  }

 private:
  /// Clear bits even if an interrupt may change the register in between; older HALs lack the macro, and do not care.
  static void clear_bits(volatile std::uint32_t& control, std::uint32_t bits) {
#ifdef ATOMIC_CLEAR_BIT
    ATOMIC_CLEAR_BIT(control, bits);
#else
    control = control & ~bits;
#endif
  }

  UART_HandleTypeDef& handle_;
  IRQn_Type interrupt_;
#ifndef UART_CLEAR_FEF
  wirebond_status_look_t look_{};
#endif
};

#if defined(USE_HAL_UART_REGISTER_CALLBACKS) && USE_HAL_UART_REGISTER_CALLBACKS == 1
/// Replace the three callbacks: the HAL calls this link for this UART. Call it once after the HAL initialised the UART,
/// and again if it is initialised again. `link` is an object at namespace scope. Returns false if the HAL refuses
/// because the UART is not ready.
template <auto& link>
bool register_events(UART_HandleTypeDef& handle) {
  const auto received = [](UART_HandleTypeDef*, std::uint16_t) { link.on_received(); };
  const auto transmitted = [](UART_HandleTypeDef*) { link.on_transmitted(); };
  const auto error = [](UART_HandleTypeDef*) { link.on_error(); };
  return HAL_UART_RegisterRxEventCallback(&handle, received) == HAL_OK &&
         HAL_UART_RegisterCallback(&handle, HAL_UART_TX_COMPLETE_CB_ID, transmitted) == HAL_OK &&
         HAL_UART_RegisterCallback(&handle, HAL_UART_ERROR_CB_ID, error) == HAL_OK;
}
#endif

}  // namespace wirebond::stm32_hal
