// The protocols that the tests of Link speak: one with lengths and two checks, one with delimiters. A command and a
// report of each carry a number, so that every frame can be told from every other.
#pragma once

#include <cstdint>

#include "enterprize_link.hpp"
#include "native_link.hpp"

struct Enterprize {
  static constexpr const char* name = "enterprize";
  using FromHost = enterprize::FromHost;
  using FromMcu = enterprize::FromMcu;
  using Command = enterprize::ChassisCmd;
  using Report = enterprize::ChassisMsg;
  template <class Handler, class Port, class Memory>
  using Link = enterprize::McuLink<Handler, Port, Memory>;
  template <std::size_t receive, std::size_t send>
  using Memory = enterprize::McuBuffers<receive, send>;
  static constexpr std::uint32_t baud = 2'000'000;
  static constexpr std::uint32_t bits_per_byte = 11;

  // A float holds whole numbers up to 2^24. The other fields make bytes that look like anything.
  template <class Message>
  static void set(Message& message, std::uint32_t number) {
    message.x_vel = static_cast<float>(number);
    message.y_vel = static_cast<float>(number) * 0.37F;
    message.w_vel = static_cast<float>(number % 7) - 3.0F;
  }
  template <class Message>
  static std::uint32_t get(const Message& message) {
    return static_cast<std::uint32_t>(message.x_vel);
  }
  template <class Message>
  static auto encode(const Message& message, std::uint8_t* out, std::size_t capacity, std::size_t& size) {
    return enterprize::encode(message, out, capacity, size);
  }
};

struct Native {
  static constexpr const char* name = "native";
  using FromHost = native::FromHost;
  using FromMcu = native::FromMcu;
  using Command = native::Ping;
  using Report = native::State;
  template <class Handler, class Port, class Memory>
  using Link = native::McuLink<Handler, Port, Memory>;
  template <std::size_t receive, std::size_t send>
  using Memory = native::McuBuffers<receive, send>;
  static constexpr std::uint32_t baud = 921'600;
  static constexpr std::uint32_t bits_per_byte = 10;

  static void set(native::Ping& ping, std::uint32_t number) { ping.number = number; }
  static std::uint32_t get(const native::Ping& ping) { return ping.number; }
  static void set(native::State& state, std::uint32_t number) {
    state.position = static_cast<double>(number) * 0.0001;
    state.current = static_cast<float>(number) * 0.5F;
  }
  static std::uint32_t get(const native::State& state) { return static_cast<std::uint32_t>(state.current * 2.0F); }
  template <class Message>
  static auto encode(const Message& message, std::uint8_t* out, std::size_t capacity, std::size_t& size) {
    return native::encode(message, out, capacity, size);
  }
};
