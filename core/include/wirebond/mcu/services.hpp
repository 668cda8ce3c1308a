// An MCU's built-in services: hello, ping, clock, parameters and counters. The protocol file maps each to messages of
// its own.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <type_traits>
#include <utility>

#include "wirebond/message.hpp"
#include "wirebond/message_list.hpp"
#include "wirebond/number.hpp"
#include "wirebond/violation.hpp"

namespace wirebond {

/// Marks a service that the protocol has not mapped.
struct NoService {
  using Message = NoService;
  using Request = NoService;
  using Reply = NoService;
  using Read = NoService;
  using Set = NoService;
  using Value = NoService;
};

/// The services of a protocol's end; generated ends override them.
struct NoServices {
  using Hello = NoService;
  using Ping = NoService;
  using Clock = NoService;
  static constexpr bool holds_back_strangers = false;  ///< at the MCU: commands of hosts with another protocol hash
  using Log = NoService;
  using LogLines = MessageList<>;  ///< of the `log` service, and messages with `log`
  using Parameter = NoService;
  using Counters = NoService;
  using Mistakable = MessageList<>;  ///< own messages that the own receiver would mistake for the other end's
  static constexpr bool knows_own_ids = false;  ///< an own message that is not among them has an id of its own
};

/// Knowledge about the protocol file of the other end.
enum class Peer : std::uint8_t {
  unknown,    ///< it has not said hello
  same,       ///< the same wire
  different,  ///< another protocol hash: its messages may mean something else
};

/// Severity of a log line, as in the log service's `level`.
enum class Level : std::uint8_t { debug, info, warning, error };

// ---- parameters -------------------------------------------------------------------------------------------------

/// One line of a firmware's table of parameters. An index is its position in the table.
struct ParameterRule {
  float least;
  float most;
  float initial;

  /// Check that the value is finite and within the range.
  bool allows(float value) const { return is_finite(value) && value >= least && value <= most; }
};

/// As in the parameter service's `result`.
enum class ParameterResult : std::uint8_t { ok, no_such_index, out_of_range };

/// Values with ranges. One context at a time; a value is one word, so other tasks may read it.
template <std::size_t Size>
class Parameters {
 public:
  /// `rules` must outlive this object: make them a constant.
  explicit constexpr Parameters(const std::array<ParameterRule, Size>& rules) : rules_(&rules) {
    for (std::size_t i = 0; i < Size; ++i) values_[i] = rules[i].initial;
  }
  explicit Parameters(const std::array<ParameterRule, Size>&&) = delete;

  static constexpr std::size_t size() { return Size; }
  constexpr float operator[](std::size_t index) const { return values_[index]; }

  /// Set a value that is finite and within the rule's range; any result other than `ok` changes nothing.
  ParameterResult set(std::size_t index, float value) {
    if (index >= Size) return ParameterResult::no_such_index;
    if (!(*rules_)[index].allows(value)) return ParameterResult::out_of_range;
    values_[index] = value;
    return ParameterResult::ok;
  }

 private:
  const std::array<ParameterRule, Size>* rules_;
  std::array<float, Size> values_{};
};

namespace detail {

template <class Handler, class = void>
struct HasParameters : std::false_type {};
template <class Handler>
struct HasParameters<Handler, std::void_t<decltype(std::declval<Handler&>().parameters())>> : std::true_type {};

template <class Handler, class = void>
struct HasParameterSet : std::false_type {};
template <class Handler>
struct HasParameterSet<Handler, std::void_t<decltype(std::declval<Handler&>().parameter_set(std::size_t{}, 0.0F))>>
    : std::true_type {};

/// Return the answer to a request for parameter `index`: the current value and the result of the request. A handler
/// without `parameters()` has no parameters.
template <class Value, class Handler>
Value parameter_value([[maybe_unused]] Handler& handler, std::size_t index, ParameterResult result) {
  Value answer{};
  answer.index = static_cast<decltype(answer.index)>(index);
  bool is_there = false;
  if constexpr (HasParameters<Handler>::value) {
    is_there = index < handler.parameters().size();
    if (is_there) answer.value = static_cast<decltype(answer.value)>(handler.parameters()[index]);
  }
  if (!is_there) result = ParameterResult::no_such_index;
  answer.result = static_cast<decltype(answer.result)>(result);
  return answer;
}

/// Whether this is a request of the parameter service.
template <class Protocol, class Message>
inline constexpr bool asks_parameter = std::is_same_v<Message, typename Protocol::Parameter::Read> ||
                                       std::is_same_v<Message, typename Protocol::Parameter::Set>;

/// Return the answer to such a request whose fields break a rule of the file, so that it does not act: either the index
/// is wrong, or the value to be set.
template <class Protocol, class Message, class Handler>
typename Protocol::Parameter::Value parameter_refusal(const Message& message, Handler& handler) {
  using Value = typename Protocol::Parameter::Value;
  using Read = typename Protocol::Parameter::Read;
  ParameterResult result = ParameterResult::no_such_index;
  if constexpr (!std::is_same_v<Message, Read>) {
    Read read{};
    read.index = static_cast<decltype(read.index)>(message.index);
    if (!rejects(violations(read))) result = ParameterResult::out_of_range;
  }
  if (result == ParameterResult::no_such_index) {
    Value answer{};
    answer.index = static_cast<decltype(answer.index)>(message.index);
    answer.result = static_cast<decltype(answer.result)>(result);
    return answer;
  }
  return parameter_value<Value>(handler, static_cast<std::size_t>(message.index), result);
}

template <class Message>
constexpr bool is_index(std::int16_t index) {
  if constexpr (std::is_same_v<Message, NoService>) {
    return false;
  } else {
    return index == Message::Info::index;
  }
}

/// Whether this message acts although the host sent another protocol hash: requests that move nothing do, so that a
/// program can find out what is wrong.
template <class Protocol>
constexpr bool acts_for_strangers(std::int16_t index) {
  return is_index<typename Protocol::Hello::Message>(index) || is_index<typename Protocol::Ping::Request>(index) ||
         is_index<typename Protocol::Clock::Request>(index) || is_index<typename Protocol::Parameter::Read>(index);
}

constexpr unsigned hello_version = 1;  ///< of the hello service itself

template <class Protocol>
typename Protocol::Hello::Message hello() {
  typename Protocol::Hello::Message hello{};
  hello.protocol_hash = Protocol::hash;
  hello.version = static_cast<decltype(hello.version)>(hello_version);
  return hello;
}

/// When the last byte of a request came, and the time now. Without a clock at the port both are poll's time.
struct ServiceTimes {
  std::uint32_t received_us;
  std::uint32_t now_us;
};

/// Answer `message` if it is the request of a service. `send` takes the answer; if it refuses, the answer is lost and
/// counted there, as any message is. Does not answer a broadcast.
template <class Protocol, class Message, class Handler, class Send>
void serve(const Message& message, [[maybe_unused]] Handler& handler, [[maybe_unused]] const ServiceTimes& times,
           [[maybe_unused]] Peer& peer, [[maybe_unused]] Send&& send) {
  if constexpr (std::is_same_v<Message, typename Protocol::Hello::Message>) {
    peer = message.protocol_hash == Protocol::hash ? Peer::same : Peer::different;
    if constexpr (Protocol::end == End::mcu) send(hello<Protocol>());
  }
  if constexpr (std::is_same_v<Message, typename Protocol::Ping::Request>) {
    typename Protocol::Ping::Reply reply{};
    reply.number = static_cast<decltype(reply.number)>(message.number);
    send(reply);
  }
  if constexpr (std::is_same_v<Message, typename Protocol::Clock::Request>) {
    typename Protocol::Clock::Reply reply{};
    reply.host_us = static_cast<decltype(reply.host_us)>(message.host_us);
    reply.received_us = static_cast<decltype(reply.received_us)>(times.received_us);
    reply.sent_us = static_cast<decltype(reply.sent_us)>(times.now_us);
    send(reply);
  }
  if constexpr (std::is_same_v<Message, typename Protocol::Parameter::Read>) {
    using Value = typename Protocol::Parameter::Value;
    send(parameter_value<Value>(handler, static_cast<std::size_t>(message.index), ParameterResult::ok));
  }
  if constexpr (std::is_same_v<Message, typename Protocol::Parameter::Set>) {
    using Value = typename Protocol::Parameter::Value;
    const std::size_t index = static_cast<std::size_t>(message.index);
    ParameterResult result = ParameterResult::no_such_index;
    if constexpr (HasParameters<Handler>::value) {
      const float value = static_cast<float>(message.value);
      result = handler.parameters().set(index, value);
      if constexpr (HasParameterSet<Handler>::value) {
        if (result == ParameterResult::ok) handler.parameter_set(index, value);
      }
    }
    send(parameter_value<Value>(handler, index, result));
  }
}

}  // namespace detail

}  // namespace wirebond
