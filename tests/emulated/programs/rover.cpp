// The firmware rover on the emulated board, with its simulated body. Reports when it begins to drive, and what silence
// brings about, in milliseconds of the machine's clock.
#include "rover.hpp"

#include "board.hpp"
#include "host/plant.hpp"

namespace {

class Base {
 public:
  void set_wheel_speeds(float left_m_s, float right_m_s) {
    const bool drives = left_m_s != 0.0F || right_m_s != 0.0F;
    if (drives && !drives_) report("drive");
    drives_ = drives;
    plant_.left.set_speed(static_cast<double>(left_m_s));
    plant_.right.set_speed(static_cast<double>(right_m_s));
  }
  std::int16_t take_left_ticks() { return plant_.left.take_ticks(); }
  std::int16_t take_right_ticks() { return plant_.right.take_ticks(); }
  float battery_v() const { return plant_.battery_v(); }
  bool estop_pressed() const { return false; }
  bool charging() const { return false; }
  void report(const char* event) const { board::print(event, board::clock_us() / 1000); }

  void pass_time() { plant_.step(1e-3, static_cast<double>(rover::track_m)); }

 private:
  rover::Plant plant_;
  bool drives_ = false;
};

Base base;
board::SoftwareDma dma(board::usart1, board::Interrupt::usart1, board::Interrupt::dma2_stream7, board::timer3,
                       board::Interrupt::timer3);
board::EmulatedUart uart(dma);
rover::Buffers buffers;
rover::Rover<Base, board::EmulatedUart> firmware(base, uart, buffers);
wirebond::freertos::StaticTask<board::stack_words> control_task;

void control(void*) {
  TickType_t woken = xTaskGetTickCount();
  for (;;) {
    firmware.poll(board::clock_us());
    xTaskDelayUntil(&woken, 1);
    base.pass_time();
  }
}

}  // namespace

extern "C" void usart1_interrupt() { dma.on_byte(); }
extern "C" void timer3_interrupt() { dma.on_tick(); }
extern "C" void dma2_stream7_interrupt() { board::forward_events(dma, firmware.link()); }

int main() {
  board::enable_uart(board::Interrupt::dma2_stream7);
  control_task.create(control, "control", nullptr, 3);
  board::run_tasks();
}
