// A port that does what the test says. Everything succeeds unless told otherwise; time stands still between two calls.
#pragma once

#include <cstdint>
#include <functional>
#include <utility>
#include <vector>

using Bytes = std::vector<std::uint8_t>;
constexpr std::uint32_t ms = 1000;

struct ScriptedPort {
  bool start_receive(std::uint8_t* bytes, std::size_t bytes_size) {
    ++receive_starts;
    if (refuses_receive) return false;
    ring = bytes;
    size = bytes_size;
    place = 0;
    is_receiving = true;
    if (error_behind_start) std::exchange(error_behind_start, nullptr)();
    return true;
  }
  bool receiving() const {
    call();
    return is_receiving;
  }
  std::size_t receive_position() const {
    call();
    return place;
  }
  bool start_transmit(const std::uint8_t* bytes, std::size_t bytes_size) {
    call();
    ++transmit_starts;
    if (refuses_transmit) return false;
    run.assign(bytes, bytes + bytes_size);
    return true;
  }
  void stop_transmit() { ++transmit_stops; }
  void pend() { pended = true; }
  bool reaches(const void*, std::size_t) const { return is_reachable; }

  void call() const {
    if (at_call && !std::exchange(is_called, true)) {
      at_call();
      is_called = false;
    }
  }

  void arrive(const Bytes& bytes) {
    for (const std::uint8_t byte : bytes) {
      ring[place] = byte;
      place = (place + 1) % size;
    }
  }

  std::uint8_t* ring = nullptr;
  std::size_t size = 0;
  std::size_t place = 0;
  Bytes run;
  int receive_starts = 0;
  int transmit_starts = 0;
  int transmit_stops = 0;
  bool is_receiving = false;
  std::function<void()> error_behind_start;  ///< an interrupt at the end of `start_receive`, once
  std::function<void()> at_call;             ///< an interrupt in each call of the link's events
  mutable bool is_called = false;            ///< it does not interrupt itself
  bool refuses_receive = false;
  bool refuses_transmit = false;
  bool is_reachable = true;
  bool pended = false;
};
