// Both USB ports under a link, on doubles of the vendors' classes, with a computer that reads slowly, sends packets of
// any size, makes and takes waits (NAK), closes the port, sleeps and pulls the cable.
#include <doctest/doctest.h>

#include <algorithm>
#include <cstdint>
#include <deque>
#include <random>
#include <vector>

#include "diffdrive_link.hpp"
#include "usbd_cdc.h"
#include "wirebond/usb_cdc/stm32.hpp"
#include "wirebond/usb_cdc/tinyusb.hpp"

using Bytes = std::vector<std::uint8_t>;
using wirebond::LinkState;
using wirebond::Status;

namespace {

struct Rover {
  void on(const diffdrive::Velocity& velocity) { commands.push_back(velocity.linear); }
  void stop() { ++stops; }
  void safe_mode() {}

  std::vector<float> commands;
  int stops = 0;
};

/// What the computer does, and what is on its side of the cable.
struct Computer {
  std::mt19937 random{7};
  std::deque<std::uint8_t> to_device;
  Bytes from_device;
  bool is_open = true;
  bool is_configured = true;
  bool is_asleep = false;
  bool reads = true;
  unsigned waits = 0;          // packets that the device did not take
  unsigned empty_packets = 0;  // both ways

  std::size_t below(std::size_t limit) { return random() % limit; }
  bool talks() const { return is_configured && !is_asleep; }
};
Computer* computer = nullptr;

// ---- ST's class

struct StDevice {
  USBD_HandleTypeDef device{USBD_STATE_CONFIGURED, nullptr};
  USBD_CDC_HandleTypeDef cdc{};
  wirebond::usb_cdc::Stm32 port{device, OTG_FS_IRQn};
  std::uint8_t packet[64] = {};
  bool is_armed = true;  // it may receive a packet
  bool is_pended = false;
  bool was_open = false;
  bool is_lost = false;  // the transfer was flushed

  StDevice();

  template <class Link>
  void step(Link& link) {
    const bool was_configured = device.dev_state == USBD_STATE_CONFIGURED && device.pClassData != nullptr;
    device.dev_state = static_cast<std::uint8_t>(!computer->is_configured ? USBD_STATE_DEFAULT
                                                 : computer->is_asleep    ? USBD_STATE_SUSPENDED
                                                                          : USBD_STATE_CONFIGURED);
    if (!computer->is_configured) device.pClassData = nullptr;
    if (computer->talks() && !was_configured && device.pClassData == nullptr) {  // USBD_CDC_Init
      cdc = {};
      device.pClassData = &cdc;
      is_armed = true;
      port.line_state(0);
      was_open = false;
    }
    if (computer->talks() && computer->is_open != was_open) port.line_state(was_open = computer->is_open);
    for (int packets = 0; packets < 4 && computer->talks(); ++packets) {
      if (is_armed && computer->below(20) == 0) {
        is_armed = false;
        ++computer->empty_packets;
        port.received(packet, 0, link);
      }
      if (computer->to_device.empty() || !computer->is_open) break;
      if (!is_armed) {
        ++computer->waits;
        break;
      }
      is_armed = false;
      const std::size_t size = std::min(computer->to_device.size(), 1 + computer->below(64));
      std::copy_n(computer->to_device.begin(), size, packet);
      computer->to_device.erase(computer->to_device.begin(), computer->to_device.begin() + static_cast<long>(size));
      port.received(packet, static_cast<std::uint32_t>(size), link);
    }
    if (cdc.TxState != 0 && computer->talks() && computer->reads && computer->is_open) {
      computer->from_device.insert(computer->from_device.end(), cdc.TxBuffer, cdc.TxBuffer + cdc.TxLength);
      if (cdc.TxLength % 64 == 0) ++computer->empty_packets;
      cdc.TxState = 0;
      link.on_transmitted();
    }
    if (is_pended) {
      is_pended = false;
      port.service(link);
    }
  }
};
StDevice* st = nullptr;

StDevice::StDevice() {
  device.pClassData = &cdc;
  st = this;
}

// ---- TinyUSB

struct TinyDevice {
  wirebond::usb_cdc::TinyUsb port;
  std::deque<std::uint8_t> received, sent;  // its FIFOs

  TinyDevice();

  template <class Link>
  void step(Link& link) {
    if (!computer->is_configured) {
      received.clear();
      sent.clear();
    }
    if (computer->talks() && computer->is_open) {
      while (!computer->to_device.empty() && received.size() < 64) {
        received.push_back(computer->to_device.front());
        computer->to_device.pop_front();
      }
      if (!computer->to_device.empty()) ++computer->waits;
      if (computer->reads) {
        computer->from_device.insert(computer->from_device.end(), sent.begin(), sent.end());
        sent.clear();
      }
    }
    port.service(link);
  }
};
TinyDevice* tiny = nullptr;

TinyDevice::TinyDevice() { tiny = this; }

// ---- both

template <class Device>
struct Bench {
  Bench() { computer = &pc; }

  void pass(int frames = 1) {
    for (; frames != 0; --frames) {
      device.step(link);
      if (pc.below(10) != 0 || polls_late == 0) {
        link.poll(now_us += ms);
      } else {
        now_us += ms;
      }
    }
  }
  void command(float linear) {
    std::uint8_t frame[diffdrive::Velocity::Info::max_frame_bytes];
    std::size_t size = 0;
    REQUIRE(diffdrive::encode(diffdrive::Velocity{linear, 0.0F}, frame, sizeof frame, size) == Status::ok);
    pc.to_device.insert(pc.to_device.end(), frame, frame + size);
  }
  Status send(float battery) {
    diffdrive::Status status;
    status.battery = battery;
    return link.send(status);
  }

  static constexpr std::uint32_t ms = 1000;
  Computer pc;
  Device device;
  Rover rover;
  diffdrive::McuBuffers<64, 256, 16> buffers;
  diffdrive::McuLink<Rover, decltype(device.port), decltype(buffers)> link{rover, device.port, buffers};
  std::uint32_t now_us = 0;
  int polls_late = 0;
};

}  // namespace

extern "C" {
uint8_t USBD_CDC_SetTxBuffer(USBD_HandleTypeDef* device, uint8_t* bytes, uint32_t size) {
  auto* const cdc = static_cast<USBD_CDC_HandleTypeDef*>(device->pClassData);
  if (cdc == nullptr || cdc->TxState != 0) return USBD_FAIL;
  cdc->TxBuffer = bytes;
  cdc->TxLength = size;
  return USBD_OK;
}
uint8_t USBD_CDC_TransmitPacket(USBD_HandleTypeDef* device) {
  auto* const cdc = static_cast<USBD_CDC_HandleTypeDef*>(device->pClassData);
  if (cdc == nullptr) return USBD_FAIL;
  if (cdc->TxState != 0) return USBD_BUSY;
  cdc->TxState = 1;
  return USBD_OK;
}
uint8_t USBD_CDC_ReceivePacket(USBD_HandleTypeDef* device) {
  if (device->pClassData == nullptr) return USBD_FAIL;
  st->is_armed = true;
  return USBD_OK;
}
USBD_StatusTypeDef USBD_LL_FlushEP(USBD_HandleTypeDef*, uint8_t) { return USBD_OK; }
void NVIC_SetPendingIRQ(IRQn_Type) { st->is_pended = true; }

bool tud_cdc_n_connected(uint8_t) { return computer->talks() && computer->is_open; }
uint32_t tud_cdc_n_read(uint8_t, void* bytes, uint32_t most) {
  const std::size_t size = std::min<std::size_t>(most, tiny->received.size());
  std::copy_n(tiny->received.begin(), size, static_cast<std::uint8_t*>(bytes));
  tiny->received.erase(tiny->received.begin(), tiny->received.begin() + static_cast<long>(size));
  return static_cast<uint32_t>(size);
}
void tud_cdc_n_read_flush(uint8_t) { tiny->received.clear(); }
uint32_t tud_cdc_n_write(uint8_t, const void* bytes, uint32_t size) {
  const std::size_t taken = std::min<std::size_t>(size, 64 - tiny->sent.size());
  const auto* const first = static_cast<const std::uint8_t*>(bytes);
  tiny->sent.insert(tiny->sent.end(), first, first + taken);
  return static_cast<uint32_t>(taken);
}
uint32_t tud_cdc_n_write_flush(uint8_t) { return 0; }
bool tud_cdc_n_write_clear(uint8_t) {
  tiny->sent.clear();
  return true;
}
}

TEST_CASE_TEMPLATE("every frame goes through once and in order, with packets of any size, waits and late polls", Device,
                   StDevice, TinyDevice) {
  Bench<Device> bench;
  bench.polls_late = 1;
  bench.pass(5);
  int commands = 0;
  unsigned sent = 0;
  for (int i = 0; i < 3000; ++i) {
    for (std::size_t count = bench.pc.below(6); count != 0; --count) {
      bench.command(static_cast<float>(++commands % 2000) / 1000.0F);
    }
    sent += bench.send(12.0F) == Status::ok ? 1 : 0;
    bench.pc.reads = bench.pc.below(4) != 0;
    bench.pass();
  }
  bench.pc.reads = true;
  bench.polls_late = 0;
  bench.pass(2000);
  REQUIRE(bench.rover.commands.size() == static_cast<std::size_t>(commands));
  for (int i = 0; i < commands; ++i) {
    CHECK(bench.rover.commands[static_cast<std::size_t>(i)] ==
          doctest::Approx(static_cast<float>((i + 1) % 2000) / 1000.0F));
  }
  CHECK(bench.pc.from_device.size() == sent * 11);
  CHECK(bench.pc.waits > 30);
  const wirebond::ReceiveAccount ring = bench.link.receive_account();
  CHECK(ring.lapped + ring.dropped == 0);
  CHECK(bench.link.send_account().balances());
  CHECK(bench.link.counters().receive_restarts <= 2);  // the silence at the end
}

TEST_CASE("a whole number of full packets ends by an empty one, which the class sends and the port does not mind") {
  Bench<StDevice> bench;
  bench.pass(500);
  CHECK(bench.pc.empty_packets > 10);
  bench.command(0.5F);
  bench.pass(3);
  CHECK(bench.rover.commands.size() == 1);
}

TEST_CASE_TEMPLATE("a program that has the port open and does not read is waited for, without a limit", Device,
                   StDevice, TinyDevice) {
  Bench<Device> bench;
  bench.pass(5);
  bench.pc.reads = false;
  unsigned accepted = 0;
  for (int i = 0; i < 5000; ++i) {
    accepted += bench.send(12.0F) == Status::ok ? 1 : 0;
    bench.pass();
  }
  CHECK(bench.link.state() != LinkState::down);
  CHECK(bench.link.counters().transmit_timeouts == 0);
  CHECK(accepted < 30);  // then the queue is full, and says so
  bench.pc.reads = true;
  bench.pass(100);
  CHECK(bench.pc.from_device.size() == accepted * 11);
  CHECK(bench.link.send_account().aborted == 0);
}

TEST_CASE_TEMPLATE("who closes the port, sleeps or pulls the cable takes the link down, and what waits expires", Device,
                   StDevice, TinyDevice) {
  Bench<Device> bench;
  bench.pass(5);
  for (int round = 0; round < 60; ++round) {
    for (int i = 0; i < 8; ++i) bench.command(1.0F);
    bench.pc.to_device.resize(bench.pc.to_device.size() - bench.pc.below(11));  // the last one is cut off
    for (int i = 0; i < 12; ++i) static_cast<void>(bench.send(12.0F));
    bench.pc.reads = bench.pc.below(2) != 0;
    bench.pass(static_cast<int>(bench.pc.below(4)));
    (round % 3 == 0 ? bench.pc.is_open : bench.pc.is_configured) = false;
    if (round % 3 == 2) bench.pc.is_configured = bench.pc.is_asleep = true;
    bench.pass(3);
    CHECK(bench.link.state() == LinkState::down);
    CHECK(bench.link.why() == wirebond::Why::not_connected);
    CHECK(bench.send(12.0F) == Status::link_down);
    wirebond::SendAccount account = bench.link.send_account();
    CHECK(account.queued == 0);
    CHECK(account.balances());
    bench.pass(static_cast<int>(bench.pc.below(1500)));
    bench.pc.to_device.clear();
    bench.pc.from_device.clear();
    bench.pc.is_open = bench.pc.is_configured = bench.pc.reads = true;
    bench.pc.is_asleep = false;
    bench.pass(5);
    bench.rover.commands.clear();
    bench.command(0.5F);
    bench.pc.from_device.clear();
    REQUIRE(bench.send(12.0F) == Status::ok);
    bench.pass(30);  // what was cut off is given up after 20 ms
    CHECK(bench.rover.commands == std::vector<float>{0.5F});
    CHECK(bench.pc.from_device.size() == 11);
    CHECK(bench.link.state() == LinkState::up);
  }
  CHECK(bench.link.counters().transmit_timeouts == 0);
  CHECK(bench.link.send_account().expired + bench.link.send_account().aborted > 30);
}
