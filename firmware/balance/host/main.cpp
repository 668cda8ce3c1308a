// The balance bot as a process: its firmware and a simulated body in a person's hand. Events: its motors run, its
// motors rest. On stdin it takes: push.
#include <string>

#include "balance.hpp"
#include "body.hpp"
#include "host/line_clock.hpp"
#include "host/process.hpp"

namespace {

class SimulatedBoard : public balance::HeldBody {
 public:
  explicit SimulatedBoard(const host::Process& process) : process_(process) {}

  void set_motors(float left, float right) {
    const bool run = left != 0.0F || right != 0.0F;
    if (run != run_) process_.report(run ? "motors run" : "motors rest");
    run_ = run;
    HeldBody::set_motors(left, right);
  }

 private:
  const host::Process& process_;
  bool run_ = false;
};

}  // namespace

int main(int argument_count, char** arguments) {
  host::Process process;
  if (const int failure = process.open(argument_count, arguments); failure != 0) return failure;
  SimulatedBoard board(process);
  balance::Buffers buffers{};
  wirebond::posix::Port uart(process.uart());
  balance::Balance<SimulatedBoard, wirebond::posix::Port> balance(board, uart, buffers);
  host::LineClock clock(balance.link());
  return process.run(
      uart, balance.link(), "push",
      [&](const std::string& line) {
        if (line != "push") return false;
        board.push(1.0F);
        return true;
      },
      // Control in each millisecond of the body's time: a slow machine does not make it fall.
      [&](std::uint32_t) {
        if (clock.advance()) board.step(1e-3F);
        balance.poll(clock.now_us());
      },
      [](std::uint32_t) {});
}
