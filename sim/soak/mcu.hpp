// The MCU's end of a soak: the generated link on a UART with DMA, and tasks that offer messages.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>

#include "buffers.hpp"
#include "ledger.hpp"
#include "mix.hpp"
#include "received_place.hpp"
#include "run_reader.hpp"
#include "wirebond/sim/dma_uart.hpp"

namespace soak {

/// Under virtual time. `to_mcu` and `to_host` outlive it.
class Mcu {
 public:
  static constexpr std::size_t receive_bytes = buffer_for(mix::protocol::AtHost::max_sent_bytes);
  static constexpr std::size_t send_bytes = buffer_for(mix::protocol::AtMcu::max_sent_bytes);
  static constexpr Time poll_every = 1'000'000;

  Mcu(wirebond::sim::Wire& to_mcu, wirebond::sim::Wire& to_host, Ledger& received, Ledger& sent)
      : to_host_(to_host),
        sent_(sent),
        uart_(to_mcu, to_host),
        handler_(to_mcu, received),
        link_(handler_, uart_, buffers_) {
    handler_.place.look = [this] { return place_of(link_); };
  }

  Time next() const { return uart_.next(); }

  /// Interrupts until `now`.
  void run(Time now) {
    now_ = now;
    uart_.run(now, link_, [this](const std::uint8_t* bytes, std::size_t size, Time end) {
      const std::uint32_t expired = link_.send_account().expired;
      sent_.expire(expired - expired_);
      expired_ = expired;
      const std::uint64_t number = to_host_.counts().put - size;
      if constexpr (mix::reads_runs) {
        is_in_order_ = reader_.read(bytes, size, number, end, sent_, to_host_) && is_in_order_;
      } else {
        is_in_order_ = sent_.leave(number, size, end, to_host_) && is_in_order_;
      }
    });
  }

  void poll(Time now) {
    run(now);
    handler_.now = now;
    link_.poll(static_cast<std::uint32_t>(now / 1000));
    polls_ += 1;
    run(now);
  }

  /// One task offers one message.
  void offer(Time now, std::uint16_t message) {
    run(now);
    std::uint16_t& sample = next_sample_[message];
    sent_.fates.offered += 1;
    if (mix::send(link_, message, sample) == wirebond::Status::ok) {
      if (mix::is_latest[message]) sent_.replace(message);
      sent_.accept(now, message, sample, mix::from_mcu(message, sample).size);
    }
    sample = static_cast<std::uint16_t>((sample + 1) % mix::samples);
    run(now);  // the interrupt that the sender pended
  }

  /// What lies in the receive ring, and is not read.
  std::size_t unread() const { return link_.unread(); }
  const auto& link() const { return link_; }
  const wirebond::sim::DmaUart& uart() const { return uart_; }
  std::uint64_t polls() const { return polls_; }
  /// Did every run hold the frames that were accepted first?
  bool is_in_order() const { return is_in_order_; }

 private:
  /// Its base has a function for each action of the file's deadlines.
  struct Handler : mix::Actions {
    Handler(wirebond::sim::Wire& to_mcu, Ledger& ledger) : wire(to_mcu), received(ledger) {}

    wirebond::sim::Wire& wire;
    Ledger& received;
    ReceivedPlace place;
    Time now = 0;

    template <class Message>
    void on(const Message& message) {
      std::uint8_t payload[Message::Info::max_payload_bytes + 1];
      const std::size_t size = payload_bytes(message);
      const bool is_written = write_payload(message, payload);
      received.deliver(mix::host_message(Message::Info::index), payload, is_written ? size : 0, place(), now,
                       mix::from_host, wire);
    }
    void unknown(const wirebond::Frame&) { received.deliver_false(); }
  };

  wirebond::sim::Wire& to_host_;
  Ledger& sent_;
  wirebond::sim::DmaUart uart_;
  Handler handler_;
  mix::protocol::McuBuffers<receive_bytes, send_bytes> buffers_{};
  mix::protocol::McuLink<Handler, wirebond::sim::DmaUart, decltype(buffers_)> link_;
  RunReader reader_;
  Time now_ = 0;
  std::uint64_t polls_ = 0;
  std::uint32_t expired_ = 0;
  bool is_in_order_ = true;
  std::array<std::uint16_t, mix::mcu_messages> next_sample_{};
};

}  // namespace soak
