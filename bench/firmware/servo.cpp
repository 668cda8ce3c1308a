// The servo of firmware/servo, whole. Its board and its UART are variables here, as registers are. bench/m4_runtime.py
// takes its size and asks it for its pose.
#include "servo.hpp"

extern "C" {
std::uint32_t received_bytes = 0;  // that DMA has put into the ring so far
std::uint32_t runs = 0;
std::uint32_t now_us = 0;
float angle_rad = 0.0F;
}

namespace {

struct Port {
  bool start_receive(std::uint8_t*, std::size_t) { return true; }
  bool receiving() const { return true; }
  std::size_t receive_position() const { return *const_cast<volatile std::uint32_t*>(&received_bytes) % 256; }
  bool start_transmit(const std::uint8_t*, std::size_t) {
    runs = runs + 1;
    return true;
  }
  void stop_transmit() {}
  void pend() {}
  bool reaches(const void*, std::size_t) const { return true; }
};

struct Board {
  void turn(float angle, float) { ::angle_rad = angle; }
  void release() {}
  float angle_rad() const { return ::angle_rad; }
  bool moves() const { return false; }
};

constexpr std::uint8_t address = 3;

Board board;
Port port;

}  // namespace

servo::Buffers buffers;
servo::Servo<Board, Port> firmware{board, port, buffers, address};

extern "C" {
void poll() { firmware.poll(now_us); }
void on_received() { firmware.link().on_received(); }
void on_transmitted() { firmware.link().on_transmitted(); }
void on_pended() { firmware.link().on_pended(); }
void on_error() { firmware.link().on_error(); }
}
