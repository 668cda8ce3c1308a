// For whom a received frame is at the host: its own address, broadcasts, and replies of those that were asked.
#include "wirebond/host/addressing.hpp"

#include <doctest/doctest.h>

#include <cstdint>

using wirebond::Frame;
using wirebond::FrameFormat;
using wirebond::HostAddressing;

namespace {

/// Form 0: to (place 0) and from (place 1, two bytes, big-endian). Form 1: the other way round. Form 2: neither.
FrameFormat make_format() {
  FrameFormat format{};
  format.form_count = 3;
  const auto add = [&](std::size_t form, std::size_t at, std::uint8_t place, std::uint8_t bytes) {
    wirebond::HeaderField& field = format.forms[form].header[format.forms[form].header_count++];
    field.number = {{static_cast<std::int16_t>(at), false}, bytes, wirebond::ByteOrder::big};
    field.place = place;
  };
  add(0, 1, 0, 1);
  add(0, 2, 1, 2);
  add(1, 1, 1, 2);
  add(1, 3, 0, 1);
  return format;
}

const FrameFormat format = make_format();

struct Received {
  Received(std::uint8_t form, std::uint8_t to, std::uint16_t from, std::int16_t message = 0) {
    const auto high = static_cast<std::uint8_t>(from >> 8), low = static_cast<std::uint8_t>(from);
    const std::uint8_t first[] = {0xAA, to, high, low}, second[] = {0xAA, high, low, to};
    for (std::size_t i = 0; i < sizeof bytes; ++i) bytes[i] = form == 0 ? first[i] : second[i];
    frame.bytes = bytes;
    frame.size = sizeof bytes;
    frame.form = form;
    frame.message = message;
  }
  Received(const Received&) = delete;
  Received& operator=(const Received&) = delete;

  std::uint8_t bytes[4] = {};
  Frame frame{};
};

bool is_foreign(const HostAddressing& addressing, std::uint8_t form, std::uint8_t to, std::uint16_t from,
                std::int16_t message = 0) {
  return addressing.is_foreign(Received(form, to, from, message).frame);
}

HostAddressing::Rules receiver_rules() {
  HostAddressing::Rules rules;
  rules.receiver_place = 0;
  rules.own = 7;
  rules.broadcasts = 2;
  rules.broadcast = {0xFE, 0xFF, 9, 0};  // the third is not counted
  return rules;
}

HostAddressing::Rules sender_rules() {
  HostAddressing::Rules rules;
  rules.sender_place = 1;
  rules.broadcasts = 1;
  rules.broadcast = {0xFE};
  return rules;
}

}  // namespace

TEST_CASE("where frames say nothing of addresses all are the host's") {
  HostAddressing addressing;
  CHECK_FALSE(is_foreign(addressing, 0, 8, 3));
  addressing.asks(0, 4);
  CHECK_FALSE(is_foreign(addressing, 0, 8, 3));
}

TEST_CASE("a frame for another address is foreign, a broadcast is not") {
  const HostAddressing addressing(format, receiver_rules());
  for (const std::uint8_t form : {std::uint8_t{0}, std::uint8_t{1}}) {
    CHECK_FALSE(is_foreign(addressing, form, 7, 0x0708));
    CHECK(is_foreign(addressing, form, 8, 0x0707));
    CHECK(is_foreign(addressing, form, 9, 7));
    CHECK_FALSE(is_foreign(addressing, form, 0xFE, 3));
    CHECK_FALSE(is_foreign(addressing, form, 0xFF, 3));
  }
  CHECK_FALSE(is_foreign(addressing, 2, 8, 8));  // it does not say for whom it is
}

TEST_CASE("the own address can be set, and all be listened to for a while") {
  HostAddressing addressing(format, receiver_rules());
  CHECK(addressing.address() == 7);
  addressing.set_address(8);
  CHECK(is_foreign(addressing, 0, 7, 1));
  CHECK_FALSE(is_foreign(addressing, 0, 8, 1));
  addressing.listen_to_all(true);
  CHECK_FALSE(is_foreign(addressing, 0, 7, 1));
  CHECK(addressing.address() == 8);
  addressing.listen_to_all(false);
  CHECK(is_foreign(addressing, 0, 7, 1));
}

TEST_CASE("the reply of one that was not asked is foreign, and nothing else that it sends") {
  HostAddressing addressing(format, sender_rules());
  CHECK_FALSE(is_foreign(addressing, 0, 0, 4, 2));  // nobody was asked yet
  addressing.asks(2, 0x0103);
  CHECK_FALSE(is_foreign(addressing, 0, 0, 0x0103, 2));
  CHECK(is_foreign(addressing, 0, 0, 0x0003, 2));
  CHECK(is_foreign(addressing, 1, 0, 0x0301, 2));
  CHECK_FALSE(is_foreign(addressing, 0, 0, 0x0003, 1));
  CHECK_FALSE(is_foreign(addressing, 0, 0, 0x0003, -1));
  CHECK_FALSE(is_foreign(addressing, 2, 0, 0x0003, 2));  // it does not say whose it is
  addressing.forget();
  CHECK_FALSE(is_foreign(addressing, 0, 0, 0x0003, 2));
}

TEST_CASE("several may be asked for the same, and a broadcast asks everybody") {
  HostAddressing addressing(format, sender_rules());
  addressing.asks(2, 3);
  addressing.asks(2, 4);
  CHECK_FALSE(is_foreign(addressing, 0, 0, 3, 2));
  CHECK_FALSE(is_foreign(addressing, 0, 0, 4, 2));
  CHECK(is_foreign(addressing, 0, 0, 5, 2));
  addressing.asks(2, 0xFE);
  CHECK_FALSE(is_foreign(addressing, 0, 0, 5, 2));
}

TEST_CASE("where only the request tells what a reply is, an earlier one is over") {
  HostAddressing::Rules rules = sender_rules();
  rules.only_last_asked = true;
  HostAddressing addressing(format, rules);
  addressing.asks(2, 3);
  addressing.asks(2, 4);
  CHECK(is_foreign(addressing, 0, 0, 3, 2));
  CHECK_FALSE(is_foreign(addressing, 0, 0, 4, 2));
  addressing.asks(1, 4);
  CHECK_FALSE(is_foreign(addressing, 0, 0, 3, 2));
}

TEST_CASE("an address that is asked again is not the first to be forgotten") {
  HostAddressing addressing(format, sender_rules());
  for (std::uint16_t address = 0; address < HostAddressing::remembered; ++address) addressing.asks(2, address);
  addressing.asks(2, 0);
  addressing.asks(2, HostAddressing::remembered);
  CHECK_FALSE(is_foreign(addressing, 0, 0, 0, 2));
  CHECK(is_foreign(addressing, 0, 0, 1, 2));
  for (std::uint16_t address = 2; address <= HostAddressing::remembered; ++address) {
    CHECK_FALSE(is_foreign(addressing, 0, 0, address, 2));
  }
}

TEST_CASE("of more addresses than are remembered the one that was asked first is forgotten") {
  HostAddressing addressing(format, sender_rules());
  for (std::uint16_t address = 0; address < HostAddressing::remembered; ++address) addressing.asks(2, address);
  addressing.asks(2, 5);  // again: it takes no place
  CHECK_FALSE(is_foreign(addressing, 0, 0, 0, 2));
  addressing.asks(2, HostAddressing::remembered);
  CHECK(is_foreign(addressing, 0, 0, 0, 2));
  for (std::uint16_t address = 1; address <= HostAddressing::remembered; ++address) {
    CHECK_FALSE(is_foreign(addressing, 0, 0, address, 2));
  }
}
