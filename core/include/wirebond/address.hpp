// Finds out for whom a frame is, at an end whose format is a constant: its own address, broadcasts, frames for others.
// No message.
#pragma once

#include <atomic>
#include <cstddef>
#include <cstdint>
#include <type_traits>

#include "wirebond/header.hpp"
#include "wirebond/placed_number.hpp"

namespace wirebond {

/// The receiver of a frame.
enum class Addressee : std::uint8_t {
  own,      ///< this end alone: it may answer
  all,      ///< a broadcast: acted on, never answered
  another,  ///< another address: only an end that listens to all gets it, and it does not answer by itself
};

namespace detail {

/// An address that one context sets and any context reads. A small processor cannot change more than one word at once:
/// set such a long address before anything is sent.
template <class Address>
class AddressCell {
 public:
  explicit constexpr AddressCell(Address address) : address_(address) {}
  Address load() const { return get(address_); }
  void store(Address address) { put(address_, address); }

 private:
  using Atomic = std::atomic<Address>;
  static Address get(const Atomic& cell) { return cell.load(std::memory_order_relaxed); }
  static Address get(const Address& cell) { return cell; }
  static void put(Atomic& cell, Address address) { cell.store(address, std::memory_order_relaxed); }
  static void put(Address& cell, Address address) { cell = address; }

  std::conditional_t<sizeof(Address) <= sizeof(std::uint32_t), Atomic, Address> address_;
};

template <class Source, class = void>
struct NamesReceiver : std::false_type {};
template <class Source>
struct NamesReceiver<Source, std::void_t<decltype(Source::receiver_place)>> : std::true_type {};

template <class Source, class = void>
struct NamesSender : std::false_type {};
template <class Source>
struct NamesSender<Source, std::void_t<decltype(Source::sender_place)>> : std::true_type {};

template <class Source, class = void>
struct NamesAsked : std::false_type {};
template <class Source>
struct NamesAsked<Source, std::void_t<decltype(Source::asked_broadcasts)>> : std::true_type {};

}  // namespace detail

/// Whether the source's frames name their receiver (`address: mcu` in frames of the host, `address: receiver`). Then it
/// has
///
///   using Address = …;                             // an unsigned integer that holds the field
///   static constexpr std::size_t receiver_place;   // the field's `HeaderField::place`
///   static constexpr Address receiver_default;
///   static constexpr std::array<Address, …> broadcasts;
template <class Source>
inline constexpr bool names_receiver = detail::NamesReceiver<Source>::value;
/// Whether they name their sender (`address: mcu` in frames of the MCU, `address: sender`). Then it has `Address`,
/// `sender_place` and `sender_default` in the same way.
template <class Source>
inline constexpr bool names_sender = detail::NamesSender<Source>::value;
/// Whether they come from an MCU and name it. Then a host can ask one of several. The source also has
/// `asked_broadcasts`: an array of the addresses that ask all of them.
template <class Source>
inline constexpr bool names_asked = detail::NamesAsked<Source>::value;

namespace detail {

/// Address type of a protocol without addresses.
struct NoAddress {};
template <class Source, class = void>
struct AddressType {
  using type = NoAddress;
};
template <class Source>
struct AddressType<Source, std::void_t<typename Source::Address>> {
  using type = typename Source::Address;
};
template <class Source>
using AddressOf = typename AddressType<Source>::type;

/// Own address of an end whose frames name their sender, where received frames name no receiver: nothing is filtered by
/// it.
template <class Sends, bool ReceiverKeepsIt, bool = names_sender<Sends> && !ReceiverKeepsIt>
class SenderAddress {};
template <class Sends, bool ReceiverKeepsIt>
class SenderAddress<Sends, ReceiverKeepsIt, true> {
 public:
  bool set_address(AddressOf<Sends> address) {
    if (address > Sends::most_address) return false;
    address_.store(address);
    return true;
  }
  AddressOf<Sends> address() const { return address_.load(); }

 private:
  AddressCell<AddressOf<Sends>> address_{Sends::sender_default};
};

}  // namespace detail

/// Decides which frames an end acts on. If the source names no receiver, all are its own, and this takes no memory.
template <class Source, bool = names_receiver<Source>>
class Listening {
 public:
  static constexpr Addressee addressee() { return Addressee::own; }
  static constexpr std::uint32_t foreign() { return 0; }

 protected:
  static constexpr bool hears(const Frame&) { return true; }
};

template <class Source>
class Listening<Source, true> {
 public:
  using Address = typename Source::Address;

  /// Act on frames for `address`, and on broadcasts. The default is the file's address. Returns false if the field
  /// cannot hold it or it is a broadcast; nothing has changed then. Call it in the context that feeds.
  bool set_address(Address address) {
    if (address > Source::most_address || is_broadcast(address)) return false;
    address_.store(address);
    hears_all_ = false;
    return true;
  }
  /// Act on frames for any address, for a gateway or a monitor. The own address is unchanged.
  void listen_to_all() { hears_all_ = true; }
  Address address() const { return address_.load(); }  ///< any context

  Addressee addressee() const { return addressee_; }  ///< of the frame that is being delivered
  std::uint32_t foreign() const { return foreign_; }  ///< intact frames for others, modulo 2^32

 protected:
  /// Check whether this end may act on the frame. A frame for another address is counted.
  bool hears(const Frame& frame) {
    addressee_ = Addressee::own;  // also for a form without the address
    detail::each_header_field<Source>(frame, [&](const HeaderField& field) WIREBOND_INLINE_LAMBDA {
      if (field.place != Source::receiver_place) return;
      const auto to = static_cast<Address>(detail::read_wide(field.number, frame.bytes, frame.size));
      if (is_broadcast(to)) {
        addressee_ = Addressee::all;
      } else if (to != address()) {
        addressee_ = Addressee::another;
      }
    });
    if (addressee_ != Addressee::another || hears_all_) return true;
    foreign_ += 1;
    return false;
  }

 private:
  static constexpr bool is_broadcast(Address address) {
    for (const Address everybody : Source::broadcasts) {
      if (address == everybody) return true;
    }
    return false;
  }

  detail::AddressCell<Address> address_{Source::receiver_default};
  bool hears_all_ = false;
  Addressee addressee_ = Addressee::own;
  std::uint32_t foreign_ = 0;
};

/// Remembers whose reply a host waits for. If the source does not name the MCU, any reply is accepted, and this takes
/// no memory.
template <class Source, bool = names_asked<Source>>
class Asked {
 protected:
  static constexpr void ask(std::int16_t) {}
  static constexpr bool is_from_asked(const Frame&) { return true; }
  static constexpr std::uint32_t from_others() { return 0; }
};

template <class Source>
class Asked<Source, true> {
 protected:
  using Address = typename Source::Address;

  /// Accept message `reply` from any MCU.
  void ask(std::int16_t) { reply_ = -1; }
  /// Accept it from this MCU only. A broadcast asks all.
  void ask(std::int16_t reply, Address address) {
    reply_ = reply;
    address_ = address;
    for (const Address everybody : Source::asked_broadcasts) {
      if (address == everybody) reply_ = -1;
    }
  }

  /// Returns false for a reply from another MCU, and counts it.
  bool is_from_asked(const Frame& frame) {
    if (reply_ < 0 || frame.message != reply_) return true;
    bool is_from_another = false;  // a form without the address concerns everyone
    detail::each_header_field<Source>(frame, [&](const HeaderField& field) WIREBOND_INLINE_LAMBDA {
      if (field.place != Source::sender_place) return;
      is_from_another = detail::read_wide(field.number, frame.bytes, frame.size) != address_;
    });
    if (is_from_another) from_others_ += 1;
    return !is_from_another;
  }
  std::uint32_t from_others() const { return from_others_; }

 private:
  std::int16_t reply_ = -1;  ///< a message's index; -1: no address is compared
  Address address_ = 0;
  std::uint32_t from_others_ = 0;
};

}  // namespace wirebond
