// The host's end of a soak: the link's core as the engine runs it, the format read at run time, under virtual time.
#pragma once

#include <time.h>

#include <algorithm>
#include <array>
#include <cstddef>
#include <cstdint>

#include "host_core.hpp"
#include "ledger.hpp"
#include "mix.hpp"
#include "wirebond/sim/wire.hpp"

namespace soak {

/// CPU time of this thread, measured for one of `every` pieces of work: the clock itself costs more than the work.
class CpuTime {
 public:
  static constexpr std::uint64_t every = 16;

  CpuTime() {
    for (int i = 0; i < 1000; ++i) {
      const std::uint64_t before = now_ns();
      cost_ns_ = std::min(cost_ns_, now_ns() - before);
    }
  }
  template <class Work>
  void around(Work&& work) {
    if (turn_++ % every != 0) return work();
    const std::uint64_t before = now_ns();
    work();
    const std::uint64_t spent = now_ns() - before;
    sampled_ns_ += spent > cost_ns_ ? spent - cost_ns_ : 0;
  }
  double seconds() const { return static_cast<double>(sampled_ns_) * every * 1e-9; }

 private:
  static std::uint64_t now_ns() {
    timespec now{};
    ::clock_gettime(CLOCK_THREAD_CPUTIME_ID, &now);
    return static_cast<std::uint64_t>(now.tv_sec) * 1'000'000'000 + static_cast<std::uint64_t>(now.tv_nsec);
  }

  std::uint64_t cost_ns_ = ~std::uint64_t{0};
  std::uint64_t sampled_ns_ = 0;
  std::uint64_t turn_ = 0;
};

/// `to_mcu` and `to_host` outlive it. It wakes as the engine's thread does: for bytes, and when the link says so.
class Host {
  /// What is done with each frame that comes.
  auto taking(Time now) {
    return [this, now](const wirebond::Frame& frame, wirebond::MayAct, bool) {
      if (frame.message < 0) {
        received_.deliver_false();
        return;
      }
      received_.deliver(mix::mcu_message(frame.message), frame.payload, frame.payload_size,
                        frame.offset + frame.wire_size, now, mix::from_mcu, to_host_);
    };
  }

 public:
  Host(wirebond::sim::Wire& to_mcu, wirebond::sim::Wire& to_host, Ledger& received, Ledger& sent)
      : to_mcu_(to_mcu),
        to_host_(to_host),
        received_(received),
        sent_(sent),
        core_(wirebond::Pacing(to_mcu.settings().baud, to_mcu.settings().bits_per_byte),
              (to_host.settings().batch + to_host.settings().jitter) / 1000, 0) {
    link_.port_up(0);
  }

  /// When it wakes by itself.
  Time next(Time now) const {
    const std::uint64_t due_us = link_.next_due(now / 1000);
    const Time due = due_us == wirebond::HostOutbox::never ? wirebond::sim::never : due_us * 1000;
    return std::max(std::min(to_host_.next_handover(), due), now + 1000);
  }

  /// The thread is awake.
  void wake(Time now) {
    cpu_.around([&] { work(now); });
  }

  /// A program offers one message.
  void offer(Time now, std::uint16_t message) {
    std::uint16_t& sample = next_sample_[message];
    const Sample& sent = mix::from_host(message, sample);
    sent_.fates.offered += 1;
    cpu_.around([&] {
      const wirebond::SendResult result =
          link_.outbox().send(mix::host_index(message), sent.frame, sent.size, -1, mix::host_numbers, now / 1000);
      expire();
      if (result == wirebond::SendResult::accepted) sent_.accept(now, message, sample, sent.size);
      write(now);
    });
    sample = static_cast<std::uint16_t>((sample + 1) % mix::samples);
  }

  /// The adapter is pulled out: its port is gone, and with it all that it held.
  void unplug(Time now) {
    to_mcu_.unplug_adapter(now);
    to_host_.unplug_adapter(now);
    link_.port_down(now / 1000, taking(now));
    expire();
    is_plugged_ = false;
  }
  /// The port is back, and open.
  void plug(Time now) {
    to_mcu_.plug();
    to_host_.plug();
    link_.port_up(now / 1000);
    is_plugged_ = true;
  }
  bool is_plugged() const { return is_plugged_; }

  const wirebond::HostLink& link() const { return link_; }
  bool is_in_order() const { return is_in_order_; }
  double cpu_seconds() const { return cpu_.seconds(); }

 private:
  void work(Time now) {
    const std::uint64_t now_us = now / 1000;
    const auto take = taking(now);
    const std::size_t read = to_host_.read(now, [&](const std::uint8_t* bytes, std::size_t size) {
      link_.received(bytes, size, now_us, now_us, true, take);
    });
    if (read == 0) link_.idle(now_us, take);
    link_.poll(now_us);
    expire();
    write(now);
  }

  void write(Time now) {
    for (;;) {
      const wirebond::Outgoing out = link_.to_write(now / 1000);
      expire();
      if (out.size == 0) return;
      const std::uint64_t number = to_mcu_.counts().put;
      const Time end = to_mcu_.put(out.bytes, out.size, now);
      link_.written(out.size, now / 1000);
      if constexpr (mix::host_numbers) {
        is_in_order_ = sent_.leave_next(number, out.size, end) && is_in_order_;
      } else {
        is_in_order_ = sent_.leave(number, out.size, end, to_mcu_) && is_in_order_;
      }
    }
  }

  void expire() {
    const std::uint64_t expired = link_.outbox().account().expired;
    sent_.expire(expired - expired_);
    expired_ = expired;
  }

  wirebond::sim::Wire& to_mcu_;
  wirebond::sim::Wire& to_host_;
  Ledger& received_;
  Ledger& sent_;
  HostCore core_;
  wirebond::HostLink& link_ = core_.link();
  CpuTime cpu_;
  std::uint64_t expired_ = 0;
  bool is_plugged_ = true;
  bool is_in_order_ = true;
  std::array<std::uint16_t, mix::host_messages> next_sample_{};
};

}  // namespace soak
