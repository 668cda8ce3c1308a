// For whom a frame is, at an end whose format is a constant: its own address, broadcasts, frames for others. No
// message.
#pragma once

#include <atomic>
#include <cstddef>
#include <cstdint>
#include <type_traits>

#include "wirebond/header.hpp"
#include "wirebond/placed_number.hpp"

namespace wirebond {

/// Whom a frame is for.
enum class Addressee : std::uint8_t {
  own,      ///< this end alone: it may answer
  all,      ///< a broadcast: acted on, never answered
  another,  ///< another address: only an end that listens to all gets it, and it does not answer by itself
};

namespace detail {

/// An address that one context sets and any context reads. More than a word of the processor's is no atomic on small
/// ones: set such an address before anything is sent.
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

/// Do the source's frames say whom they are for (`address: mcu` in what the host sends, `address: receiver`)? Then it
/// has
///
///   using Address = …;                             // an unsigned integer that holds the field
///   static constexpr std::size_t receiver_place;   // the field's `HeaderField::place`
///   static constexpr Address receiver_default;
///   static constexpr std::array<Address, …> broadcasts;
template <class Source>
inline constexpr bool names_receiver = detail::NamesReceiver<Source>::value;
/// Do they say whose they are (`address: mcu` in what the MCU sends, `address: sender`)? Then it has `Address`,
/// `sender_place` and `sender_default` in the same way.
template <class Source>
inline constexpr bool names_sender = detail::NamesSender<Source>::value;
/// Are they an MCU's that say whose they are? Then a host can ask one of several. The source also has
/// `asked_broadcasts`: an array of the addresses that ask all of them.
template <class Source>
inline constexpr bool names_asked = detail::NamesAsked<Source>::value;

namespace detail {

/// The type of a protocol's addresses.
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

/// The own address of an end whose frames name their sender, where those that it receives name no receiver: they are
/// not filtered by it.
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

/// Which frames an end acts on. Of a source that names no receiver all are its own, and this takes no memory.
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

  /// Act on frames for `address`, and on broadcasts. Until somebody calls it, or `listen_to_all`, that is the file's
  /// default. False: the field cannot hold it, or it is a broadcast; nothing has changed. One context: that which
  /// feeds.
  bool set_address(Address address) {
    if (address > Source::most_address || is_broadcast(address)) return false;
    address_.store(address);
    hears_all_ = false;
    return true;
  }
  /// Act on frames for any address, for a gateway or a monitor. The own address stays.
  void listen_to_all() { hears_all_ = true; }
  Address address() const { return address_.load(); }  ///< any context

  Addressee addressee() const { return addressee_; }  ///< of the frame that is being handed out
  std::uint32_t foreign() const { return foreign_; }  ///< intact frames for others, modulo 2^32

 protected:
  /// May this end act on the frame? One for another address is counted.
  bool hears(const Frame& frame) {
    addressee_ = Addressee::own;  // also of a form without the address
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

/// Whose reply a host waits for. Of a source that does not name the MCU anybody's is one, and this takes no memory.
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

  /// Anybody answers with message `reply`.
  void ask(std::int16_t) { reply_ = -1; }
  /// This one does. A broadcast asks everybody.
  void ask(std::int16_t reply, Address address) {
    reply_ = reply;
    address_ = address;
    for (const Address everybody : Source::asked_broadcasts) {
      if (address == everybody) reply_ = -1;
    }
  }

  /// False for the reply of another one, which is counted.
  bool is_from_asked(const Frame& frame) {
    if (reply_ < 0 || frame.message != reply_) return true;
    bool is_from_another = false;  // a form without the address concerns everybody
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
