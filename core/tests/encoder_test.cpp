// Sealing frames: known bytes, dirty buffers, buffers that are too small; constant and run-time format alike.
#include <doctest/doctest.h>

#include <cstdint>
#include <cstring>

#include "formats.hpp"
#include "wirebond/examine.hpp"

using namespace formats;

TEST_CASE("a fixed frame is padded with zeros and closed by check and tail") {
  for_both_sources<FixedSize>([](const auto& source) {
    CHECK(frame_of(source, 0x01, {0xF4, 0x01, 0x00, 0x00}) ==
          Bytes{0xAA, 0x55, 0x01, 0xF4, 0x01, 0x00, 0x00, 0x00, 0x00, 0x0B, 0x0D});
    CHECK(frame_of(source, 0x02, {}) == Bytes{0xAA, 0x55, 0x02, 0x00, 0x00, 0x00, 0x00, 0x00, 0x00, 0xFD, 0x0D});
    CHECK(frame_of(source, 0x01, Bytes(5)).empty());
  });
}

TEST_CASE("an id that its place has no room for makes no frame") {
  for_both_sources<HeaderChecked>([](const auto& source) { CHECK(frame_of(source, 0x1A2, Bytes(20)).empty()); });
  for_both_sources<BigEndian>([](const auto& source) { CHECK(frame_of(source, 0x1'0102, Bytes(5)).empty()); });
  for_both_sources<FixedSize>([](const auto& source) { CHECK(frame_of(source, 0x101, Bytes(4)).empty()); });
}

TEST_CASE("without a mask a number has all bits of its bytes, eight of them, too") {
  for (const wirebond::ByteOrder order : {wirebond::ByteOrder::little, wirebond::ByteOrder::big}) {
    for (std::uint8_t bytes = 1; bytes <= 8; ++bytes) {
      const wirebond::Number number{{1, false}, bytes, order};
      const std::uint64_t value = 0x8877665544332211u >> (8 * (8 - bytes));
      std::uint8_t frame[10] = {};
      wirebond::detail::write_number(number, frame, sizeof frame, value);
      CHECK(wirebond::detail::read_wide(number, frame, sizeof frame) == value);
      CHECK(wirebond::Form{}.length.most() == 0);
      if (bytes <= 4) CHECK(number.most() == static_cast<std::int64_t>(~std::uint64_t{0} >> (8 * (8 - bytes))));
      wirebond::detail::clear_number(number, frame, sizeof frame);
      for (const std::uint8_t byte : frame) CHECK(byte == 0);
    }
  }
}

TEST_CASE("a length that counts itself, big-endian numbers, an id behind the payload") {
  for_both_sources<BigEndian>([](const auto& source) {
    const Bytes frame = frame_of(source, 0x0102, {'1', '2', '3', '4', '5'});
    REQUIRE(frame.size() == 12);
    CHECK(frame[0] == 0x3C);
    CHECK(frame[1] == 0x00);
    CHECK(frame[2] == 11);
    CHECK(frame[10] == 0x01);
    CHECK(frame[11] == 0x02);
    std::uint64_t crc = wirebond::crc_update<16, 0x1021, false>(0, frame.data() + 1, 7);
    CHECK(frame[8] == (crc >> 8));
    CHECK(frame[9] == (crc & 0xFF));
  });
}

TEST_CASE("the high byte of a sum") {
  for_both_sources<WeakSum>([](const auto& source) {
    CHECK(frame_of(source, 0x02, Bytes(4, 0xFF)) == Bytes{0x7A, 0x02, 0x04, 0xFF, 0xFF, 0xFF, 0xFF, 0x04, 0x7B});
  });
}

TEST_CASE("every payload size up to the format's largest comes back from its frame") {
  for_both_sources<HeaderChecked>([](const auto& source) {
    for (std::size_t size = 0; size <= 40; ++size) {
      const Bytes payload(size, static_cast<std::uint8_t>(0xAA + size));
      const Bytes frame = frame_of(source, 0xA2, payload);
      wirebond::Frame found;
      const auto verdict = wirebond::examine(source, frame.data(), frame.size(), nullptr, found);
      REQUIRE(verdict.outcome == wirebond::Outcome::frame);
      CHECK(verdict.bytes == frame.size());
      CHECK(found.id == 0xA2);
      CHECK(found.message == 1);
      CHECK(Bytes(found.payload, found.payload + found.payload_size) == payload);
    }
    CHECK(frame_of(source, 0xA2, Bytes(41)).empty());
  });
}

TEST_CASE("a frame is sealed in exactly the room that wire_bytes asks for, and in no less") {
  for_both_sources<Delimited>([](const auto& source) {
    for (const std::size_t size :
         {std::size_t{0}, std::size_t{1}, std::size_t{250}, std::size_t{251}, std::size_t{252}, std::size_t{300}}) {
      for (const int value : {0x00, 0x55}) {
        const std::size_t room = wirebond::wire_bytes(source.format(), size);
        Bytes buffer(room, 0xCC);
        std::memset(buffer.data() + wirebond::payload_lead(source), value, size);
        CHECK(wirebond::seal(source, buffer.data(), room - 1, 0x02, size) == 0);
        const std::size_t sealed = wirebond::seal(source, buffer.data(), room, 0x02, size);
        REQUIRE(sealed != 0);
        CHECK(sealed <= room);
        CHECK(buffer[0] == 0);
        CHECK(buffer[sealed - 1] == 0);
        CHECK(std::memchr(buffer.data() + 1, 0, sealed - 2) == nullptr);
      }
    }
  });
}

TEST_CASE("a size that a length in words cannot tell is refused") {
  FrameFormat format = run_time<HeaderChecked>().format();
  format.forms[0].length_unit = 4;
  const wirebond::RuntimeTables tables(format, HeaderChecked::rows.data(), HeaderChecked::rows.size());
  const wirebond::RuntimeSource source(tables);
  for (std::size_t size = 0; size <= 12; ++size) CHECK(frame_of(source, 0xA2, Bytes(size)).empty() == (size % 4 != 0));
}

TEST_CASE("a frame without a byte is refused where it would be fill, and sent between brackets") {
  FrameFormat format;
  format.framing = Framing::delimited;
  format.forms[0].payload_size = wirebond::PayloadSize::rest;
  format.max_payload = 4;
  format.opening = format.closing = {1, 0x7E};
  const wirebond::RuntimeTables tables(format, nullptr, 0);
  const wirebond::RuntimeSource source(tables);
  CHECK(frame_of(source, 0, {}).empty());
  CHECK(frame_of(source, 0, {1}) == Bytes{0x7E, 1, 0x7E});
  format.framing = Framing::bracketed;
  format.closing = {1, 0x7D};
  CHECK(frame_of(source, 0, {}) == Bytes{0x7E, 0x7D});
}
