// What the exports of the module share: the open protocol, how bytes come in, and how a result goes out.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <exception>
#include <memory>
#include <stdexcept>
#include <utility>
#include <vector>

#include "wirebond/engine/columns.hpp"
#include "wirebond/engine/decoder.hpp"
#include "wirebond/engine/follower.hpp"
#include "wirebond/engine/header.hpp"
#include "wirebond/engine/link_core.hpp"
#include "wirebond/engine/node_values.hpp"

#define WIREBOND_EXPORT(name) __attribute__((export_name(#name)))

namespace wirebond::engine {

/// Whose frames: the index of a format.
enum Sender : unsigned { mcu, host, either };
constexpr std::array<const char*, 3> sender_names = {"mcu", "host", "either"};

/// The numbers in the rows of one message.
struct MessageColumns {
  std::vector<Column> columns;
  std::vector<std::vector<double>> values;  ///< of each column
};

/// Everything of one protocol.
struct Session {
  std::shared_ptr<const ProtocolTable> protocol;
  std::array<std::shared_ptr<const FormatTable>, sender_names.size()> formats;  ///< null: the file has none
  double idle_seconds = 0;
  std::array<std::unique_ptr<Decoder>, sender_names.size()> decoders;
  std::array<std::unique_ptr<Follower>, sender_names.size()> followers;
  Capture rows;                         ///< of the last call of a follower
  std::vector<MessageColumns> columns;  ///< made of them, by message
  std::unique_ptr<LinkCore> link;
  int tap = 0;  ///< of the link
};

extern std::vector<std::uint8_t> input;   ///< of the next call
extern std::vector<std::uint8_t> result;  ///< of the last call
extern std::unique_ptr<Session> session;  ///< null: none is open

inline std::uint64_t us(double time) { return time < 0 ? 0 : static_cast<std::uint64_t>(time); }

/// Throws std::logic_error if there is none.
Session& open_session();
/// Throws std::logic_error if there is none.
LinkCore& open_link();
/// Throws std::logic_error if the protocol has no frames of this sender.
const std::shared_ptr<const FormatTable>& format_of(unsigned sender);

/// Keep the node as the result, and return the result's address.
const std::uint8_t* give(const Node& node);

/// Call `work`, and keep its return value or exception as the result.
template <class Work>
const std::uint8_t* answered(Work work) {
  Node answer;
  try {
    answer = Node::Map{{"ok", work()}};
  } catch (const MessageError& refused) {
    answer = Node::Map{{"error", "message"}, {"text", refused.what()}};
  } catch (const std::exception& mistake) {
    answer = Node::Map{{"error", "engine"}, {"text", mistake.what()}};
  }
  return give(answer);
}

/// Return the input as a node.
inline Node given() { return unpacked(input.data(), input.size()); }

/// Return a message as JavaScript gets it.
Node to_node(const Batch& batch, const Event& event);

/// Return the frame of a message: `asked` has its index, its values and its header values. Frames of the sender.
std::vector<std::uint8_t> frame_of(unsigned sender, const Node& asked);

}  // namespace wirebond::engine
