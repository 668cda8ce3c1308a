// The host's link in the module: each export is one call of LinkCore. See module.cpp for how values pass.
#include <cstddef>
#include <cstdint>
#include <limits>
#include <memory>
#include <stdexcept>
#include <string>
#include <utility>
#include <vector>

#include "session.hpp"
#include "wirebond/engine/account.hpp"

namespace wirebond::engine {

LinkCore& open_link() {
  if (open_session().link == nullptr) throw std::logic_error("no link is open");
  return *session->link;
}

extern "C" {

/// Input: the settings, as `EngineSettings` of Python has them.
WIREBOND_EXPORT(link_open) const std::uint8_t* wirebond_link_open(double now) {
  return answered([&] {
    const Node settings = given();
    const auto& receive = format_of(mcu);
    open_session().link =
        std::make_unique<LinkCore>(link_setup(session->protocol, receive, format_of(host), settings), us(now));
    return Node();
  });
}

WIREBOND_EXPORT(port_up) void wirebond_port_up(double now) { open_link().port_up(us(now)); }

/// Input: why, as a text in UTF-8.
WIREBOND_EXPORT(port_down) void wirebond_port_down(double now) {
  open_link().port_down(us(now), std::string(input.begin(), input.end()));
}

/// Input: the bytes of a read that began at `before` and ended at `after`.
WIREBOND_EXPORT(received) void wirebond_received(double before, double after) {
  open_link().received(input.data(), input.size(), us(before), us(after), true);
}

WIREBOND_EXPORT(link_idle) void wirebond_link_idle(double began) { open_link().idle(us(began)); }

WIREBOND_EXPORT(poll) void wirebond_poll(double now) { open_link().poll(us(now)); }

/// When to call `poll` and `to_write` again; infinite: only bytes matter.
WIREBOND_EXPORT(next_due) double wirebond_next_due(double now) {
  const std::uint64_t due = open_link().next_due(us(now));
  return due == ~std::uint64_t{0} ? std::numeric_limits<double>::infinity() : static_cast<double>(due);
}

/// Result: the bytes that may be written now. Without a value: just the address, and `result_size`.
WIREBOND_EXPORT(to_write) const std::uint8_t* wirebond_to_write(double now, int together) {
  const Outgoing out = open_link().to_write(us(now), together != 0);
  result.assign(out.bytes, out.bytes + out.size);
  return result.data();
}

/// Result: the bytes that the port shall take now; see LinkCore::hand_over. Call `written` with 1 when it has taken all
/// of several.
WIREBOND_EXPORT(hand_over) const std::uint8_t* wirebond_hand_over(double now) {
  result = open_link().hand_over(us(now));
  return result.data();
}

WIREBOND_EXPORT(written) void wirebond_written(std::size_t size, double now) { open_link().written(size, us(now)); }

/// Input: as for `encode`, then the index of the reply (-1: none), whether it takes its sequence number as it leaves,
/// its address (bits on the wire), and seconds of a lease (0: it is sent once). Result: 0 to 3, in the order of
/// SendResult.
WIREBOND_EXPORT(send) const std::uint8_t* wirebond_send(double now) {
  return answered([&] {
    const Node asked = given();
    const std::vector<std::uint8_t> frame = frame_of(host, asked);
    const auto message = asked[0].as<std::int16_t>();
    const auto reply = asked[3].as<std::int16_t>();
    const bool takes_number = asked[4].as<bool>();
    const auto address = asked[5].as<std::uint64_t>();
    const double hold = asked[6].as<double>();
    LinkCore& link = open_link();
    const SendResult sent =
        hold == 0 ? link.outbox().send(message, frame.data(), frame.size(), reply, takes_number, us(now), address)
                  : link.outbox().repeat(message, frame.data(), frame.size(), reply, takes_number, to_us(hold), us(now),
                                         address);
    link.note_changes(us(now));
    return Node(answer_of(sent));
  });
}

/// Input: a safe value, in the order of `SafeValue` of Python. Result: false if there is no room.
WIREBOND_EXPORT(note_safe) const std::uint8_t* wirebond_note_safe() {
  return answered([] { return Node(open_link().note_safe(stop_frame(given()))); });
}

WIREBOND_EXPORT(end_safely) int wirebond_end_safely(int message, double address) {
  return open_link().outbox().end_safely(static_cast<std::int16_t>(message), static_cast<std::uint64_t>(address));
}

/// Stop repeating it to one address; -1: to any.
WIREBOND_EXPORT(stop_repeating) void wirebond_stop_repeating(int message, double address) {
  HostOutbox& outbox = open_link().outbox();
  if (address < 0) {
    outbox.stop_repeating(static_cast<std::int16_t>(message));
  } else {
    outbox.stop_repeating(static_cast<std::int16_t>(message), static_cast<std::uint64_t>(address));
  }
}

/// Another program continues the motion: see HostOutbox::hand_over_motion.
WIREBOND_EXPORT(hand_over_motion) void wirebond_hand_over_motion() { open_link().outbox().hand_over_motion(); }

WIREBOND_EXPORT(end_motion) void wirebond_end_motion() { open_link().outbox().end_motion(); }

WIREBOND_EXPORT(stop) void wirebond_stop(double now) {
  open_link().outbox().stop(us(now));
  open_link().note_changes(us(now), "stopped");
}

WIREBOND_EXPORT(release_stop) void wirebond_release_stop() { open_link().outbox().release_stop(); }

WIREBOND_EXPORT(is_stopped) int wirebond_is_stopped() { return open_link().outbox().is_stopped(); }

/// End leases with their safe values, and accept nothing more. What is queued may still leave.
WIREBOND_EXPORT(close) void wirebond_close() { open_link().outbox().close(); }

WIREBOND_EXPORT(is_empty) int wirebond_is_empty() { return open_link().outbox().is_empty(); }

/// 0 to 2, in the order of HostLinkState.
WIREBOND_EXPORT(state) int wirebond_state(double now) { return static_cast<int>(open_link().link().state(us(now))); }

/// Input: the indexes of the messages that are wanted (bytes of 16 bits each). Result: those that came since the last
/// call; the others are dropped.
WIREBOND_EXPORT(receive) const std::uint8_t* wirebond_receive() {
  return answered([] {
    std::vector<bool> wanted(open_session().protocol->messages().size() + 1);
    for (std::size_t i = 0; i + 1 < input.size(); i += 2) wanted.at(input[i] | (input[i + 1] << 8)) = true;
    Node::List out;
    for (const Arrivals& arrivals : open_link().take()) {
      for (const Event& event : arrivals.events) {
        const std::size_t place = event.message < 0 ? wanted.size() - 1 : static_cast<std::size_t>(event.message);
        if (wanted[place]) out.push_back(to_node(*arrivals.batch, event));
      }
    }
    return Node(std::move(out));
  });
}

/// Keep read bytes, written bytes and events for `tap_take`, up to `capacity` bytes. There is one tap.
WIREBOND_EXPORT(tap_open) void wirebond_tap_open(std::size_t capacity, double now) {
  session->tap = open_link().open_tap(capacity, us(now));
}

/// Result: a list of the pieces since the last call, each a list of its kind (in the order of TapKind), when it began
/// and when it was done, and its bytes; and how many pieces had no room.
WIREBOND_EXPORT(tap_take) const std::uint8_t* wirebond_tap_take() {
  return answered([] {
    const TapCopy taken = open_link().take_tap(session->tap);
    Node::List pieces;
    const std::uint8_t* at = taken.bytes.data();
    for (const TapPiece& piece : taken.pieces) {
      pieces.push_back(Node::List{static_cast<int>(piece.kind), static_cast<double>(piece.before_us),
                                  static_cast<double>(piece.t_us), Node::Bytes(at, at + piece.size)});
      at += piece.size;
    }
    return Node(Node::List{std::move(pieces), taken.loss.pieces});
  });
}

/// Add a program's own event to the tap. Input: its text.
WIREBOND_EXPORT(note) void wirebond_note(double now) {
  open_link().note(std::string(input.begin(), input.end()), us(now));
}

/// Result: the actions of deadlines at this end that have struck.
WIREBOND_EXPORT(struck) const std::uint8_t* wirebond_struck() {
  return answered([] {
    Node::List out;
    for (const std::uint8_t action : open_link().struck_deadlines()) out.emplace_back(static_cast<unsigned>(action));
    return Node(std::move(out));
  });
}

WIREBOND_EXPORT(recover_deadline) void wirebond_recover_deadline(int action, double now) {
  open_link().recover_deadline(static_cast<std::uint8_t>(action), us(now));
}

/// Result: see `account_node`.
WIREBOND_EXPORT(link_account) const std::uint8_t* wirebond_link_account() {
  return answered([] {
    LinkCore& link = open_link();
    return account_node(link.account(), link.protocol(), link.receives());
  });
}

}  // extern "C"

}  // namespace wirebond::engine
