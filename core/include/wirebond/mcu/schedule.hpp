// Decides which periodic messages of an end are due. Their values come from the handler.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <type_traits>
#include <utility>

#include "wirebond/deadline.hpp"
#include "wirebond/handler.hpp"
#include "wirebond/header.hpp"
#include "wirebond/message_list.hpp"

namespace wirebond {

template <class List>
class Schedule;

/// Keeps the rhythm of `Messages`, each by its Info::every_us. One context at a time.
template <class... Messages>
class Schedule<MessageList<Messages...>> {
 public:
  /// Start: each message is due at `now_us` for the first time.
  void start(std::uint32_t now_us) { due_us_.fill(now_us); }

  /// For each message that is due and for which the handler has `bool fill(Message&)`: fill it, and pass it to `send`
  /// unless `fill` returned false. A message that `sender.fill` fills needs no handler; if there is one, it is called
  /// afterwards. `sender.header()` is the initial header for `bool fill(Message&, Header&)`. After a stall the old
  /// rhythm continues, without a burst.
  template <class Handler, class Sender>
  void poll([[maybe_unused]] std::uint32_t now_us, [[maybe_unused]] Handler& handler, [[maybe_unused]] Sender& sender) {
    [[maybe_unused]] std::size_t place = 0;
    (offer<Messages>(due_us_[place++], now_us, handler, sender), ...);
  }

  /// Return how long after `now_us` the next of them is due; at most `most_us`.
  template <class Handler, class Sender>
  std::uint32_t time_left([[maybe_unused]] std::uint32_t now_us, std::uint32_t most_us) const {
    std::uint32_t least_us = most_us;
    [[maybe_unused]] std::size_t place = 0;
    [[maybe_unused]] const auto look = [&](bool counts, std::uint32_t due_us) {
      const std::uint32_t left_us = static_cast<std::int32_t>(due_us - now_us) > 0 ? due_us - now_us : 0;
      if (counts && left_us < least_us) least_us = left_us;
    };
    (look(is_offered<Messages, Handler, Sender>, due_us_[place++]), ...);
    return least_us;
  }

 private:
  template <class Message, class Handler, class Sender>
  static constexpr bool is_offered =
      Sender::template fills<Message> || detail::HasFill<Handler, Message>::value ||
      detail::HasFillWithHeader<Handler, Message, HeaderOf<typename Message::Info>>::value;

  template <class Message, class Handler, class Sender>
  static void offer([[maybe_unused]] std::uint32_t& due_us, [[maybe_unused]] std::uint32_t now_us,
                    [[maybe_unused]] Handler& handler, [[maybe_unused]] Sender& sender) {
    using Header = HeaderOf<typename Message::Info>;
    static_assert(detail::RightFill<Handler, Message, Header>::value);
    constexpr bool with_header = detail::HasFillWithHeader<Handler, Message, Header>::value;
    constexpr bool by_sender = Sender::template fills<Message>;
    if constexpr (is_offered<Message, Handler, Sender>) {
      Periodic<> rhythm(Message::Info::every_us, due_us);
      if (!rhythm.due(now_us)) return;
      due_us = rhythm.next_us();
      Message message;
      if constexpr (by_sender) sender.fill(message);
      if constexpr (with_header) {
        Header header = sender.header();
        if (handler.fill(message, header)) static_cast<void>(sender.send(message, header));
      } else if constexpr (detail::HasFill<Handler, Message>::value) {
        if (handler.fill(message)) static_cast<void>(sender.send(message));
      } else {
        static_cast<void>(sender.send(message));  // a refused one is counted, as any message is
      }
    }
  }

  std::array<std::uint32_t, sizeof...(Messages)> due_us_{};
};

}  // namespace wirebond
