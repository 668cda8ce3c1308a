// What a link knows of messages when it is compiled: how each is queued, and lists of them. No payload, no frame.
#pragma once

#include <cstddef>
#include <cstdint>
#include <type_traits>

namespace wirebond {

/// How a message waits for the line (`queue:` in the protocol file).
enum class Queue : std::uint8_t {
  normal,  ///< behind what was sent before it
  urgent,  ///< before all that is not urgent; behind what was urgent before it
  latest,  ///< only the newest one, in a place of its own; in no order to other messages
};

/// Messages, in the file's order.
template <class... Messages>
struct MessageList {
  static constexpr std::size_t size = sizeof...(Messages);

  /// The place of `Message` in the list; `size` where it is not in it.
  template <class Message>
  static constexpr std::size_t index_of() {
    std::size_t index = 0;
    static_cast<void>(((!std::is_same_v<Message, Messages> && (++index, true)) && ...));
    return index;
  }
};

}  // namespace wirebond
