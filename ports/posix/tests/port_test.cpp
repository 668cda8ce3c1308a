// The port over a descriptor: a socket pair stands for the line. Waits have no bound that a slow machine could miss.
#include "wirebond/posix/port.hpp"

#include <doctest/doctest.h>
#include <fcntl.h>
#include <sys/socket.h>

#include <array>
#include <atomic>
#include <cstdint>
#include <vector>

using wirebond::posix::Descriptor;
using wirebond::posix::Port;
using Bytes = std::vector<std::uint8_t>;

namespace {

struct Sockets {
  Descriptor ours;
  Descriptor theirs;
  Sockets() {
    int pair[2];
    REQUIRE(::socketpair(AF_UNIX, SOCK_STREAM, 0, pair) == 0);
    ours = Descriptor(pair[0]);
    theirs = Descriptor(pair[1]);
    REQUIRE(::fcntl(pair[0], F_SETFL, O_NONBLOCK) == 0);
  }

  void put(const Bytes& bytes) const {
    REQUIRE(::write(theirs.get(), bytes.data(), bytes.size()) == static_cast<ssize_t>(bytes.size()));
  }
  /// Waits for this many.
  Bytes take(std::size_t size) const {
    Bytes bytes(size);
    for (std::size_t got = 0; got < size;) {
      const ssize_t more = ::read(theirs.get(), bytes.data() + got, size - got);
      REQUIRE(more > 0);
      got += static_cast<std::size_t>(more);
    }
    return bytes;
  }
};

/// Sends every byte back, by the events that a Link gets.
struct Echo {
  Port& port;
  std::array<std::uint8_t, 16> ring{};
  std::size_t read = 0;
  Bytes run{};
  Bytes waiting{};
  std::atomic<int> pended{0};

  void on_received() {
    for (; read != port.receive_position(); read = (read + 1) % ring.size()) waiting.push_back(ring[read]);
    send();
  }
  void on_transmitted() {
    run.clear();
    send();
  }
  void on_error() { FAIL("no line error on a socket"); }
  void on_pended() { ++pended; }

  void send() {
    if (!run.empty() || waiting.empty()) return;
    run.swap(waiting);
    CHECK(port.start_transmit(run.data(), run.size()));
    CHECK_FALSE(port.start_transmit(run.data(), run.size()));
  }
};

}  // namespace

TEST_CASE("bytes come and go through many turns of the ring") {
  const Sockets sockets;
  Port port(sockets.ours.get());
  Echo echo{port};
  REQUIRE(port.start(echo));
  REQUIRE(port.start_receive(echo.ring.data(), echo.ring.size()));
  for (std::uint8_t i = 0; i < 100; ++i) {
    const Bytes bytes(static_cast<std::size_t>(1 + i % 40), i);
    sockets.put(bytes);
    CHECK(sockets.take(bytes.size()) == bytes);
  }
  port.stop();
  CHECK(port.error() == 0);
}

TEST_CASE("more than the other side's buffer takes leaves in parts, whole") {
  const Sockets sockets;
  const int little = 2048;
  REQUIRE(::setsockopt(sockets.ours.get(), SOL_SOCKET, SO_SNDBUF, &little, sizeof little) == 0);
  Port port(sockets.ours.get());
  struct Sender {
    Port& port;
    const Bytes& bytes;
    std::atomic<int> transmitted{0};
    void on_received() {}
    void on_transmitted() { ++transmitted; }
    void on_error() {}
    void on_pended() {
      if (transmitted == 0) static_cast<void>(port.start_transmit(bytes.data(), bytes.size()));
    }
  };
  Bytes bytes(100'000);
  for (std::size_t i = 0; i < bytes.size(); ++i) bytes[i] = static_cast<std::uint8_t>(i * 7);
  Sender sender{port, bytes};
  REQUIRE(port.start(sender));
  port.pend();
  CHECK(sockets.take(bytes.size()) == bytes);
  while (sender.transmitted == 0) std::this_thread::yield();
  port.stop();
  CHECK(sender.transmitted == 1);
}

TEST_CASE("pend is served, also what was pended before the thread began") {
  const Sockets sockets;
  Port port(sockets.ours.get());
  Echo echo{port};
  port.pend();
  REQUIRE(port.start(echo));
  while (echo.pended == 0) std::this_thread::yield();
  port.pend();
  while (echo.pended == 1) std::this_thread::yield();
  port.stop();
}

TEST_CASE("when the other side is gone the thread ends and says so") {
  Sockets sockets;
  Port port(sockets.ours.get());
  Echo echo{port};
  REQUIRE(port.start(echo));
  REQUIRE(port.start_receive(echo.ring.data(), echo.ring.size()));
  sockets.theirs.reset();
  while (port.error() == 0) std::this_thread::yield();
  CHECK(port.error() == EIO);
  port.stop();
}
