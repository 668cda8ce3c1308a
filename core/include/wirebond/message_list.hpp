// Compile-time knowledge of a link about messages: how each is queued, and lists of them. No payload, no frame.
#pragma once

#include <cstddef>
#include <cstdint>
#include <type_traits>

namespace wirebond {

/// How a message waits for the line (`queue:` in the protocol file).
enum class Queue : std::uint8_t {
  normal,  ///< after all that was sent before it
  urgent,  ///< before all that is not urgent; after what was urgent before it
  latest,  ///< only the newest one is kept, in its own slot; no order relative to other messages
};

/// A list of messages, in the file's order.
template <class... Messages>
struct MessageList {
  static constexpr std::size_t size = sizeof...(Messages);

  /// Return the index of `Message` in the list; `size` if it is not in it.
  template <class Message>
  static constexpr std::size_t index_of() {
    std::size_t index = 0;
    static_cast<void>(((!std::is_same_v<Message, Messages> && (++index, true)) && ...));
    return index;
  }
};

}  // namespace wirebond
