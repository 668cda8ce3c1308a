// In which version an MCU sends, where a format has several: magics and the forms of frames, no link and no message.
#pragma once

#include <cstddef>
#include <cstdint>
#include <type_traits>

#include "wirebond/examine.hpp"
#include "wirebond/header.hpp"
#include "wirebond/mcu/atomics.hpp"
#include "wirebond/message.hpp"

namespace wirebond::detail {

/// Of a protocol in one version: nothing is kept.
template <class Protocol, class = void>
class SpokenVersion {
 public:
  static constexpr bool follows_host = false;
};

/// The version of the newest frame that came for this end. `Protocol` has `version_of_form`, by the form of a received
/// frame, and `versions`: the magics of this end in each of them, the one to be tried first before others. Version 0
/// is the default one and has none.
template <class Protocol>
class SpokenVersion<Protocol, std::void_t<decltype(Protocol::version_of_form)>> {
 public:
  static constexpr bool follows_host = true;

 protected:
  /// In `poll`.
  void hear(const Frame& frame) { version_.store(Protocol::version_of_form[frame.form], std::memory_order_relaxed); }

  /// These numbers, with a magic of the version that came where they have the default one and the message has such
  /// frames. Any context.
  template <class Message>
  HeaderNumbers<typename Protocol::Sends> spoken(const HeaderNumbers<typename Protocol::Sends>& numbers,
                                                 std::size_t payload) const {
    using Sends = typename Protocol::Sends;
    constexpr std::size_t place = Protocol::magic_place;
    if (numbers[place] != default_numbers<Sends>[place]) return numbers;
    for (const std::uint32_t magic : Protocol::versions[version_.load(std::memory_order_relaxed)]) {
      auto tried = numbers;
      tried[place] = magic;
      if (magic != 0 && frame_room<Sends, Message>(payload, tried) != 0) return tried;
    }
    return numbers;
  }

 private:
  LoadStore<std::uint8_t> version_{0};  ///< `poll` writes it, senders read it; nothing else depends on it
};

}  // namespace wirebond::detail
