// A sender and the UART's interrupt on two cores: is a frame ever left in the queue although nobody will look for it?
// `wakeups ROUNDS`. The sender sends one frame at the very moment when the other side is about to rest; a wake-up is
// lost where that side has looked around often since, and rests. Prints how many, as JSON.
#include <atomic>
#include <cstdint>
#include <cstdio>
#include <cstdlib>
#include <thread>

#include "aging_link.hpp"
#include "wirebond/mcu/link.hpp"

namespace {

/// A UART whose interrupt is a thread, and whose runs leave at once.
class Port {
 public:
  bool start_receive(std::uint8_t*, std::size_t) { return true; }
  bool receiving() const { return true; }
  std::size_t receive_position() const { return 0; }
  bool start_transmit(const std::uint8_t*, std::size_t) {
    sends_ = true;
    return true;
  }
  void stop_transmit() {}
  void pend() { pended_.store(true, std::memory_order_relaxed); }  // the handshake must not need more than that
  bool reaches(const void*, std::size_t) const { return true; }

  /// By the interrupt's thread: serve what is due, once.
  template <class Link>
  void turn(Link& link) {
    if (sends_) {
      sends_ = false;
      link.on_transmitted();
    } else if (pended_.exchange(false, std::memory_order_relaxed)) {
      link.on_pended();
    }
    turns_.fetch_add(1, std::memory_order_relaxed);
  }
  std::uint64_t turns() const { return turns_.load(std::memory_order_relaxed); }

 private:
  bool sends_ = false;
  std::atomic<bool> pended_{false};
  std::atomic<std::uint64_t> turns_{0};
};

struct Nothing {};

/// More than a request takes from one core to the other.
constexpr std::uint64_t enough_turns = 20'000;

}  // namespace

int main(int count, char** arguments) {
  if (count != 2) return 2;
  const std::uint64_t rounds = std::strtoull(arguments[1], nullptr, 10);
  Nothing nothing;
  Port port;
  aging::McuBuffers<64, 1024> buffers;
  aging::McuLink<Nothing, Port, decltype(buffers)> link{nothing, port, buffers};
  link.poll(0);
  std::atomic<bool> ends{false};
  std::thread interrupt([&] {
    while (!ends.load(std::memory_order_relaxed)) port.turn(link);
  });
  std::uint64_t lost = 0;
  for (std::uint32_t round = 1; round <= rounds; ++round) {
    if (link.send(aging::Report{round}) != wirebond::Status::ok) return 3;
    // Taken once it has been booked as sent: then the interrupt looks for more, and this thread sends more.
    std::uint64_t since = port.turns();
    while (link.send_account().sent != round) {
      if (port.turns() - since < enough_turns) continue;
      if (link.send_account().sent == round) break;
      ++lost;
      port.pend();
      since = port.turns();
    }
  }
  ends.store(true, std::memory_order_relaxed);
  interrupt.join();
  std::printf("{\"rounds\": %llu, \"lost\": %llu}\n", static_cast<unsigned long long>(rounds),
              static_cast<unsigned long long>(lost));
  return lost == 0 ? 0 : 1;
}
