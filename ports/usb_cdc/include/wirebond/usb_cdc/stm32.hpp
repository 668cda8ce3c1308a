// A port: a virtual serial port over USB, by ST's device library and its class CDC. It uses the class and no register.
#pragma once

#include <cstddef>
#include <cstdint>

#include "usbd_cdc.h"
#include "wirebond/mcu/atomics.hpp"
#include "wirebond/mcu/software_ring.hpp"

namespace wirebond::usb_cdc {

/// CubeMX generates `hUsbDeviceFS` and the file usbd_cdc_if.c. Call these between its USER CODE marks, and nothing
/// else:
///   CDC_Init_FS                                 port.line_state(0)
///   CDC_Receive_FS                              port.received(Buf, *Len, link)
///   CDC_TransmitCplt_FS                         link.on_transmitted()
///   CDC_Control_FS, CDC_SET_CONTROL_LINE_STATE  port.line_state(reinterpret_cast<USBD_SetupReqTypedef*>(pbuf)->wValue)
///   the USB interrupt's handler, at its end     port.service(link)
/// The USB interrupt replaces "the UART's interrupt" of a link.
///
/// The link is down while no program has the port open (DTR), USB is not configured, or the computer sleeps. A packet
/// that does not fit into the receive ring waits in the computer (NAK), and no byte is lost to a late poll. A run has
/// no time limit: a program that has the port open may be slow to read.
class Stm32 {
 public:
  /// `interrupt`: that of USB, for example OTG_FS_IRQn. `device` must outlive this object.
  Stm32(USBD_HandleTypeDef& device, IRQn_Type interrupt) : device_(device), interrupt_(interrupt) {}

  static constexpr bool is_unpaced = true;       ///< USB has no baud rate
  static constexpr bool tells_every_lap = true;  ///< there is no DMA that could lap unseen
  static constexpr bool may_wait = true;         ///< waits for the computer, without a limit

  bool start_receive(std::uint8_t* ring, std::size_t size) {
    ring_.start(ring, size);
    pend();  // for waiting bytes
    return true;
  }
  bool receiving() const { return ring_.runs(); }
  std::size_t receive_position() const { return ring_.place(); }  ///< any context

  void stop_receive() {
    ring_.stop();
    give_back_packet();
  }

  /// Returns false if a run is being sent.
  bool start_transmit(const std::uint8_t* bytes, std::size_t size) {
    auto* const mutable_bytes = const_cast<std::uint8_t*>(bytes);  // the class lacks the const, but does not write
    USBD_CDC_SetTxBuffer(&device_, mutable_bytes, static_cast<std::uint32_t>(size));
    return USBD_CDC_TransmitPacket(&device_) == USBD_OK;
  }

  void stop_transmit() {
    USBD_LL_FlushEP(&device_, CDC_IN_EP);
    auto* const state = static_cast<USBD_CDC_HandleTypeDef*>(device_.pClassData);
    if (state != nullptr) state->TxState = 0;  // otherwise the class stays busy for ever
  }

  /// Any task, any interrupt.
  void pend() { NVIC_SetPendingIRQ(interrupt_); }

  /// The core copies; the class counts in 16 bits.
  bool reaches(const void*, std::size_t size) const { return size <= 0xFFFF; }

  bool connected() const { return device_.dev_state == USBD_STATE_CONFIGURED && dtr_.load(std::memory_order_relaxed); }

  /// Called by the link, after each poll.
  void read_to(std::size_t place) {
    ring_.read_to(place);
    if (packet_left_.load(std::memory_order_relaxed) != 0) pend();
  }

  // ---- the USB interrupt

  /// Note the bits of SET_CONTROL_LINE_STATE: bit 0 is DTR, set by a program that opens the port.
  void line_state(std::uint16_t bits) { dtr_.store((bits & 1u) != 0, std::memory_order_relaxed); }

  template <class Link>
  void received(const std::uint8_t* packet, std::uint32_t size, Link& link) {
    packet_ = packet;
    packet_left_.store(size, std::memory_order_relaxed);
    if (size == 0 || !ring_.runs()) return give_back_packet();  // empty, or no link reads
    move(link);
  }

  template <class Link>
  void service(Link& link) {
    move(link);
    link.on_pended();
  }

 private:
  template <class Link>
  void move(Link& link) {
    const std::size_t left = packet_left_.load(std::memory_order_relaxed);
    if (left == 0) return;
    const std::size_t count = ring_.put(packet_, left);
    packet_ += count;
    packet_left_.store(left - count, std::memory_order_relaxed);
    if (count == left) give_back_packet();
    if (count != 0) link.on_received();
  }

  /// Let the class fill its packet again; until then the computer waits.
  void give_back_packet() {
    if (packet_ == nullptr) return;
    packet_ = nullptr;
    packet_left_.store(0, std::memory_order_relaxed);
    static_cast<void>(USBD_CDC_ReceivePacket(&device_));  // it fails if USB is not configured: then there is none
  }

  USBD_HandleTypeDef& device_;
  IRQn_Type interrupt_;
  SoftwareRing ring_;
  LoadStore<bool> dtr_{false};
  const std::uint8_t* packet_ = nullptr;
  LoadStore<std::size_t> packet_left_{0};
};

}  // namespace wirebond::usb_cdc
