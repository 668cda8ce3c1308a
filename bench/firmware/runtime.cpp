// A link for the emulated Cortex-M4, with one function for each thing that a firmware asks of it. bench/m4_runtime.py
// calls them by their names, and writes handler.hpp and sends.hpp: a handler of all
// messages, and a function for each message that the MCU sends.
#include "handler.hpp"

extern "C" {
std::uint32_t received_bytes = 0;  // that DMA has put into the ring so far
std::uint32_t pends = 0;
std::uint32_t runs = 0;
std::uint32_t now_us = 0;
}

namespace {

/// Registers are variables here, so that each function costs what a load or store of a register does.
struct Port {
  bool start_receive(std::uint8_t*, std::size_t) { return true; }
  bool receiving() const { return true; }
  std::size_t receive_position() const { return *const_cast<volatile std::uint32_t*>(&received_bytes) % RECEIVE_BYTES; }
  bool start_transmit(const std::uint8_t*, std::size_t) {
    runs = runs + 1;
    return true;
  }
  void stop_transmit() {}
  void pend() { pends = pends + 1; }
  bool reaches(const void*, std::size_t) const { return true; }
};

Port port;
Handler handler;

}  // namespace

protocol::McuBuffers<RECEIVE_BYTES, SEND_BYTES, SEND_FRAMES> buffers;
protocol::McuLink runtime{handler, port, buffers};

namespace {

template <class Message>
std::uint32_t send(const Message& message, std::uint32_t times) {
  std::uint32_t refused = 0;
  for (; times != 0; --times) {
    asm volatile("" : : : "memory");  // the message may have changed
    if (runtime.send(message) != wirebond::Status::ok) ++refused;
  }
  return refused;
}

}  // namespace

#include "sends.hpp"

extern "C" {

void poll() { runtime.poll(now_us); }
void on_received() { runtime.on_received(); }
void on_transmitted() { runtime.on_transmitted(); }
void on_pended() { runtime.on_pended(); }
void on_error() { runtime.on_error(); }

// Repeated, for the difference of two counts. 0: each did its work.
std::uint32_t poll_times(std::uint32_t times) {
  for (; times != 0; --times) poll();
  return 0;
}
std::uint32_t poll_frames(std::uint32_t times, std::uint32_t frame_bytes) {
  const std::uint32_t wanted = handler.calls + times;
  for (; times != 0; --times) {
    received_bytes = received_bytes + frame_bytes;
    poll();
  }
  return wanted - handler.calls;
}
std::uint32_t on_received_times(std::uint32_t times) {
  for (; times != 0; --times) on_received();
  return 0;
}
std::uint32_t on_transmitted_times(std::uint32_t times) {
  const std::uint32_t wanted = runs + times;
  for (; times != 0; --times) on_transmitted();
  return wanted - runs;
}
std::uint32_t on_pended_times(std::uint32_t times) {
  for (; times != 0; --times) on_pended();
  return 0;
}

}  // extern "C"
