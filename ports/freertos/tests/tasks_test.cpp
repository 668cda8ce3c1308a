// The tasks on the double of the kernel: when they poll, when they wake, and in which context the port is called.
#include "wirebond/freertos/tasks.hpp"

#include <doctest/doctest.h>

#include <array>
#include <cstdint>
#include <string>
#include <vector>

#include "kernel.hpp"

using wirebond::freertos::ReceiveTask;
using wirebond::freertos::SendTask;
using wirebond::freertos::tick_clock_us;

namespace {

struct Link {
  std::vector<std::uint32_t> polls;
  std::string log;

  void poll(std::uint32_t now_us) { polls.push_back(now_us); }
  void on_received() { log += 'r'; }
  void on_transmitted() { log += 't'; }
  void on_error() { log += 'e'; }
  void on_pended() { log += 'p'; }
};

struct Port {
  std::string log;

  bool start_receive(std::uint8_t*, std::size_t size) { return size != 0; }
  bool receiving() const { return true; }
  std::size_t receive_position() const { return 7; }
  bool start_transmit(const std::uint8_t*, std::size_t size) { return size != 0; }
  void stop_transmit() { log += 's'; }
  bool reaches(const void*, std::size_t size) const { return size < 100; }
};

}  // namespace

TEST_CASE("the receive task polls every period, by the time of the ticks") {
  kernel::reset();
  Link link;
  ReceiveTask<Link, 128> task(link, 2);
  task.start("receive", 3);
  CHECK(kernel::last_created().stack_words == 128);
  CHECK(kernel::last_created().priority == 3);
  kernel::run_task(kernel::last_created(), 5);
  CHECK(link.polls == std::vector<std::uint32_t>{0, 2'000, 4'000});
}

TEST_CASE("a wake makes the receive task poll at once, and ends the interrupt with a change of task") {
  kernel::reset();
  Link link;
  ReceiveTask<Link, 128> task(link, 10);
  task.wake();  // nobody to wake yet
  task.start("receive", 3);
  kernel::run_task(kernel::last_created(), 0);
  kernel::set_interrupt(true);
  task.wake();
  task.wake();
  kernel::set_interrupt(false);
  CHECK(kernel::yields() == 2);
  kernel::run_task(kernel::last_created(), 0);
  CHECK(link.polls.size() == 3);  // each run begins with one, the wakes made one more
}

TEST_CASE("the clock of ticks wraps as a clock of 32 bits does") {
  kernel::reset();
  kernel::set_ticks(4'294'967);
  const std::uint32_t before = tick_clock_us();
  kernel::set_ticks(4'294'968);
  CHECK(tick_clock_us() - before == 1'000);
  kernel::set_ticks(0xFFFF'FFFF);
  const std::uint32_t last = tick_clock_us();
  kernel::set_ticks(0);
  CHECK(tick_clock_us() - last == 1'000);
}

TEST_CASE("the send task calls the link's events, each once however often it was told, reception before errors") {
  kernel::reset();
  Port port;
  Link link;
  SendTask<Port, 128> task(port);
  task.pend();  // before the task is there
  task.start(link, "send", 4);
  kernel::run_task(kernel::last_created(), 0);
  CHECK(link.log == "p");
  link.log.clear();
  kernel::set_interrupt(true);
  task.on_error();
  task.on_transmitted();
  task.on_received();
  task.on_received();
  kernel::set_interrupt(false);
  task.pend();
  StaticTask_t& control = kernel::last_created();
  CHECK(control.bits == 15);
  kernel::run_task(control, 0);
  CHECK(link.log == "pretp");  // the first is its beginning again
}

TEST_CASE("the send task is a port around its driver") {
  Port port;
  SendTask<Port, 128> task(port);
  std::array<std::uint8_t, 4> bytes{};
  CHECK(task.start_receive(bytes.data(), 4));
  CHECK_FALSE(task.start_receive(bytes.data(), 0));
  CHECK(task.receiving());
  CHECK(task.receive_position() == 7);
  CHECK(task.start_transmit(bytes.data(), 4));
  CHECK_FALSE(task.start_transmit(bytes.data(), 0));
  CHECK(task.reaches(bytes.data(), 99));
  CHECK_FALSE(task.reaches(bytes.data(), 100));
  task.stop_transmit();
  CHECK(port.log == "s");
}
