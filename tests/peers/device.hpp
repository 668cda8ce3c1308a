// Devices that real programs talk to, one for each protocol: what a firmware of each would be at its smallest. The
// tests say which, by DEVICE.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <cstdio>
#include <cstring>

#include LINK_HEADER

namespace device {

#if DEVICE_UBX

/// A receiver whose position counts its measurements; it acknowledges a rate of its own, and refuses another.
template <class Port>
class Device {
 public:
  using Buffers = ubx::McuBuffers<512, 1024, 32>;
  using Link = ubx::McuLink<Device, Port, Buffers>;

  Device(Port& port, Buffers& buffers) : link_(*this, port, buffers) {}
  Link& link() { return link_; }

  void poll(std::uint32_t now_us) {
    link_.poll(now_us);
    if (++polls_ % 8 != 0) return;
    const auto n = static_cast<float>(count_);
    ubx::NavPosllh position{};
    position.time_of_week = n;
    position.longitude = count_ * 1e-7;
    position.latitude = -count_ * 1e-7;
    position.height = -n;
    if (link_.send(position) == wirebond::Status::ok) ++count_;
  }

  void on(const ubx::CfgRate& rate) {
    constexpr std::uint16_t cfg_rate = 0x0608;
    if (rate.measurements_per_solution == 0) {
      static_cast<void>(link_.send(ubx::AckNak{cfg_rate}));
    } else {
      static_cast<void>(link_.send(ubx::AckAck{cfg_rate}));
    }
  }

 private:
  std::int32_t count_ = 0;
  std::uint32_t polls_ = 0;
  Link link_;
};

#elif DEVICE_NMEA

/// A compass: it counts its headings, and sends back each sentence that it is sent.
template <class Port>
class Device {
 public:
  using Buffers = nmea::McuBuffers<512, 1024, 32>;
  using Link = nmea::McuLink<Device, Port, Buffers>;

  Device(Port& port, Buffers& buffers) : link_(*this, port, buffers) {}
  Link& link() { return link_; }

  void poll(std::uint32_t now_us) {
    link_.poll(now_us);
    if (++polls_ % 50 != 0) return;
    std::array<char, 32> text{};
    const int size = std::snprintf(text.data(), text.size(), "IIHDT,%u.5,T", static_cast<unsigned>(count_ % 360));
    nmea::Sentence sentence{};
    if (size > 0 && sentence.text.assign(text.data(), static_cast<std::size_t>(size)) &&
        link_.send(sentence) == wirebond::Status::ok) {
      ++count_;
    }
  }

  void on(const nmea::Sentence& sentence) { static_cast<void>(link_.send(sentence)); }

 private:
  std::uint32_t count_ = 0;
  std::uint32_t polls_ = 0;
  Link link_;
};

#elif DEVICE_MODBUS

/// A slave with a hundred holding registers. A broadcast is acted on and not answered.
template <class Port>
class Device {
 public:
  using Buffers = modbus_rtu::McuBuffers<1024, 1024, 16>;
  using Link = modbus_rtu::McuLink<Device, Port, Buffers>;

  Device(Port& port, Buffers& buffers) : link_(*this, port, buffers) {
    for (std::size_t i = 0; i < registers_.size(); ++i) registers_[i] = static_cast<std::uint16_t>(1000 * i);
  }
  Link& link() { return link_; }
  void poll(std::uint32_t now_us) { link_.poll(now_us); }

  void on(const modbus_rtu::ReadHoldingRegisters& request) {
    if (!is_asked()) return;
    if (!has(request.first, request.number)) {
      static_cast<void>(link_.send(modbus_rtu::ReadRefused{modbus_rtu::ReadRefused::Reason::address}));
      return;
    }
    modbus_rtu::HoldingRegisters reply{};
    reply.registers.size = request.number;
    for (std::size_t i = 0; i < request.number; ++i) reply.registers.data[i] = registers_[request.first + i];
    static_cast<void>(link_.send(reply));
  }

  void on(const modbus_rtu::WriteRegister& request) {
    if (!has(request.address, 1)) {
      static_cast<void>(link_.send(modbus_rtu::WriteRefused{modbus_rtu::WriteRefused::Reason::address}));
      return;
    }
    registers_[request.address] = request.value;
    if (is_asked()) static_cast<void>(link_.send(request));
  }

  void on(const modbus_rtu::WriteRegisters& request) {
    const std::uint16_t number = request.registers.size;
    if (!has(request.first, number)) {
      static_cast<void>(link_.send(modbus_rtu::WritesRefused{modbus_rtu::WritesRefused::Reason::address}));
      return;
    }
    for (std::size_t i = 0; i < number; ++i) registers_[request.first + i] = request.registers.data[i];
    if (is_asked()) static_cast<void>(link_.send(modbus_rtu::RegistersWritten{request.first, number}));
  }

 private:
  bool is_asked() const { return link_.addressee() == wirebond::Addressee::own; }
  bool has(std::size_t first, std::size_t number) const { return first + number <= registers_.size(); }

  std::array<std::uint16_t, 100> registers_{};
  Link link_;
};

#elif DEVICE_MAVLINK

/// A vehicle: it counts its attitudes, and accepts every command. The link raises the sequence number.
template <class Port>
class Device {
 public:
  using Buffers = mavlink::McuBuffers<1024, 1024, 32>;
  using Link = mavlink::McuLink<Device, Port, Buffers>;

  Device(Port& port, Buffers& buffers) : link_(*this, port, buffers) {}
  Link& link() { return link_; }

  void poll(std::uint32_t now_us) {
    link_.poll(now_us);
    if (++polls_ % 10 != 0) return;
    mavlink::Attitude attitude{};
    attitude.time_since_boot = static_cast<float>(count_);
    attitude.angles = {0.25F, -0.5F, 1.0F};
    if (link_.send(attitude) == wirebond::Status::ok) ++count_;
  }

  void on(const mavlink::CommandLong& command) {
    static_cast<void>(link_.send(mavlink::CommandAck{command.command, 0}));
  }

 private:
  std::uint32_t count_ = 0;
  std::uint32_t polls_ = 0;
  Link link_;
};

#endif

}  // namespace device
