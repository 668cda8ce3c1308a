// A frame that waits for its number: whatever the number is, it leaves as if it had been sealed with it, and never
// writes beyond what was set aside.
#include "wirebond/numbering.hpp"

#include <doctest/doctest.h>

#include <cstdint>
#include <random>

#include "formats.hpp"
#include "wirebond/mcu/sent_numbers.hpp"

using namespace formats;

namespace {

/// AA, length, four bits of flags and twelve of a number, id, payload, CRC.
struct Plain {
  static constexpr std::array<MessageRow, 2> rows = {{{0x01, {0, 0, 300}}, {0x02, {1, 0, 300}}}};
  static constexpr FrameFormat make() {
    FrameFormat format{};
    format.algorithm_count = 1;
    format.algorithms[0] = xmodem;
    format.max_payload = 300;
    format.sequence_place = 1;
    auto& form = format.forms[0];
    form.prefix = 6;
    form.suffix = 2;
    form.prefix_constants = form.constant_count = 1;
    form.constants[0] = {{0, false}, 0xFF, 0xAA};
    form.payload_size = PayloadSize::by_length;
    form.length = {{1, false}, 2};
    form.id = {{5, false}, 1};
    form.header_count = 2;
    form.header[0] = {{{3, false}, 2, ByteOrder::big, 0, 0xF}, 9, 0};
    form.header[1] = {{{3, false}, 2, ByteOrder::big, 4, 0xFFF}, 0, 1};
    form.check_count = 1;
    form.checks[0] = {0, {1, false}, {-2, true}, {-2, true}, 2};
    return format;
  }
};

/// 00, COBS of id, number, payload and CRC, 00.
struct Cobs {
  static constexpr std::array<MessageRow, 2> rows = Plain::rows;
  static constexpr FrameFormat make() {
    FrameFormat format{};
    format.framing = Framing::delimited;
    format.stuffing = Stuffing::cobs;
    format.opening = format.closing = {1, 0x00};
    format.algorithm_count = 1;
    format.algorithms[0] = mcrf4xx;
    format.max_payload = 300;
    format.sequence_place = 0;
    auto& form = format.forms[0];
    form.prefix = 2;
    form.suffix = 2;
    form.payload_size = PayloadSize::rest;
    form.id = {{0, false}, 1};
    form.header_count = 1;
    form.header[0] = {{{1, false}, 1, ByteOrder::little, 0, 0xFF}, 0, 0};
    form.check_count = 1;
    form.checks[0] = {0, {0, false}, {-2, true}, {-2, true}, 2};
    return format;
  }
};

/// The same with escapes, as HDLC has them.
struct Escaped : Cobs {
  static constexpr FrameFormat make() {
    FrameFormat format = Cobs::make();
    format.stuffing = Stuffing::escape;
    format.opening = format.closing = {1, 0x7E};
    format.escapes = {0x7D, 0x20, 2, {0x7E, 0x7D}, {0x5E, 0x5D}};
    return format;
  }
};

/// With a byte before and two behind the escaped ones, one of them a check over the bytes as they are sent.
struct EscapedWithin : Escaped {
  static constexpr FrameFormat make() {
    FrameFormat format = Escaped::make();
    format.plain_front = 1;
    format.plain_back = 1;
    format.algorithms[0] = xor8;
    auto& form = format.forms[0];
    form.check_count = 2;
    form.checks[0] = {0, {1, false}, {-2, true}, {-2, true}, 1};
    form.checks[1] = {0, {0, false}, {-1, true}, {-1, true}, 1};
    form.checks[1].on_wire = true;
    return format;
  }
};

/// 55, id, payload, sum; or AA, id, number, payload, sum: only one of two forms has a number.
struct TwoForms {
  static constexpr std::array<MessageRow, 2> rows = {{{0x01, {0, 4, 4}}, {0x02, {1, 4, 4}}}};
  static constexpr FrameFormat make() {
    FrameFormat format{};
    format.algorithm_count = 1;
    format.algorithms[0] = xor8;
    format.max_payload = 4;
    format.form_count = 2;
    format.sequence_place = 0;
    for (std::uint16_t i = 0; i < 2; ++i) {
      auto& form = format.forms[i];
      form.prefix = static_cast<std::uint16_t>(2 + i);
      form.suffix = 1;
      form.prefix_constants = form.constant_count = 1;
      form.constants[0] = {{0, false}, 0xFF, static_cast<std::uint8_t>(i == 0 ? 0x55 : 0xAA)};
      form.payload_size = PayloadSize::fixed;
      form.fixed_payload = 4;
      form.id = {{1, false}, 1};
      form.header_count = static_cast<std::uint8_t>(i);
      form.header[0] = {{{2, false}, 1, ByteOrder::little, 0, 0xFF}, 0, 0};
      form.check_count = 1;
      form.checks[0] = {0, {0, false}, {-1, true}, {-1, true}, 1};
    }
    return format;
  }
};

/// AA, number, length or nothing, id, payload, sum, and two bytes more where the payload has at most four: of the same
/// bytes, only what tells the payload's size tells the form.
template <wirebond::PayloadSize tells>
struct BySize {
  static constexpr std::array<MessageRow, 2> rows = {{{0x01, {0, 6, 6}}, {0x02, {1, 4, 4}}}};
  static constexpr FrameFormat make() {
    const bool has_length = tells == wirebond::PayloadSize::by_length;
    FrameFormat format{};
    format.algorithm_count = 1;
    format.algorithms[0] = xor8;
    format.max_payload = 6;
    format.form_count = 2;
    format.sequence_place = 0;
    for (std::uint16_t i = 0; i < 2; ++i) {
      auto& form = format.forms[i];
      form.prefix = has_length ? 4 : 3;
      form.suffix = i == 0 ? 1 : 3;
      form.prefix_constants = form.constant_count = 1;
      form.constants[0] = {{0, false}, 0xFF, 0xAA};
      form.payload_size = tells;
      if (has_length) form.length = {{2, false}, 1};
      form.id = {{static_cast<std::int16_t>(has_length ? 3 : 2), false}, 1};
      form.header_count = 1;
      form.header[0] = {{{1, false}, 1, ByteOrder::little, 0, 0xFF}, 0, 0};
      form.check_count = 1;
      const wirebond::Position check{static_cast<std::int16_t>(i == 0 ? -1 : -3), true};
      form.checks[0] = {0, {0, false}, check, check, 1};
      form.first_exclusion = static_cast<std::uint8_t>(i);
      form.exclusion_count = 1;
      format.exclusions[i].subject = wirebond::Subject::size;
    }
    format.exclusions[0].high = 4;
    format.exclusions[1].low = 5;
    format.exclusions[1].high = 0xFFFF;
    return format;
  }
};

constexpr std::uint8_t untouched = 0xCC;

/// Lay out, wait, close: against `seal` with the same values.
template <class Source>
void waits_as_it_is_sealed(const Source& source, const Bytes& payload, std::size_t form, std::uint64_t number,
                           std::uint64_t flags) {
  const FrameFormat& format = source.format();
  std::uint64_t header[2] = {flags, flags};
  header[format.sequence_place] = 0;
  const std::size_t reserved = wirebond::wire_bytes(format, payload.size(), form);
  const auto filled = [&] {
    Bytes buffer(reserved + 8, untouched);
    std::copy(payload.begin(), payload.end(),
              buffer.begin() + static_cast<std::ptrdiff_t>(wirebond::payload_lead(source, form)));
    return buffer;
  };
  Bytes waiting = filled();
  std::size_t size = 0;
  REQUIRE(wirebond::lay_out_frame(source, waiting.data(), reserved, 0x02, payload.size(), form, header, size));
  const std::size_t room = wirebond::set_aside(source, waiting.data(), size, form);
  REQUIRE(room <= reserved);
  for (std::size_t i = room; i < waiting.size(); ++i) waiting[i] = untouched;  // another frame lies here
  REQUIRE(wirebond::waiting_size(format, waiting.data(), room) == size);
  unsigned asked = 0;
  const std::size_t on_wire = wirebond::close_numbered(source, waiting.data(), size, [&] {
    ++asked;
    return number;
  });
  REQUIRE(on_wire <= room);
  for (std::size_t i = room; i < waiting.size(); ++i) REQUIRE(waiting[i] == untouched);
  CHECK(asked == (wirebond::number_at(format.forms[form], format.sequence_place).present() ? 1 : 0));

  Bytes sealed = filled();
  header[format.sequence_place] = number;
  sealed.resize(wirebond::seal(source, sealed.data(), reserved, 0x02, payload.size(), form, header));
  waiting.resize(on_wire);
  CHECK(waiting == sealed);
}

template <class Format>
void waits_at_every_size(std::size_t most, std::size_t forms = 1) {
  for_both_sources<Format>([&](const auto& source) {
    std::mt19937 random(5);
    for (std::size_t form = 0; form < forms; ++form) {
      for (std::size_t size = most == 4 ? 4 : 0; size <= most; ++size) {
        Bytes payload(size);
        for (std::uint8_t& byte : payload) {
          const std::uint8_t likely[] = {0x00, 0x7D, 0x7E, static_cast<std::uint8_t>(random())};
          byte = likely[random() % (size % 3 == 0 ? 4 : 3)];
        }
        for (const std::uint64_t number : {std::uint64_t{0}, std::uint64_t{0x7E}, std::uint64_t{random()}}) {
          waits_as_it_is_sealed(source, payload, form, number, 5);
        }
      }
    }
  });
}

}  // namespace

TEST_CASE("a frame without stuffing gets its number among other bits") { waits_at_every_size<Plain>(300); }
TEST_CASE("a frame under COBS, with codes for more than 254 bytes too") { waits_at_every_size<Cobs>(300); }
TEST_CASE("a frame whose stuffing depends on its number") { waits_at_every_size<Escaped>(300); }
TEST_CASE("a frame with bytes beside those that are escaped") { waits_at_every_size<EscapedWithin>(300); }
TEST_CASE("a form without a number asks for none") { waits_at_every_size<TwoForms>(4, 2); }

TEST_CASE("a form that only the payload's size tells from another, by a length") {
  for_both_sources<BySize<wirebond::PayloadSize::by_length>>([](const auto& source) {
    for (std::size_t size = 0; size <= 6; ++size)
      waits_as_it_is_sealed(source, Bytes(size, 0x11), size <= 4 ? 1 : 0, 0x7E, 5);
  });
}

TEST_CASE("a form that only the payload's size tells from another, by the message") {
  for_both_sources<BySize<wirebond::PayloadSize::by_id>>(
      [](const auto& source) { waits_as_it_is_sealed(source, Bytes(4, 0x11), 1, 0x7E, 5); });
}

TEST_CASE("an escaped frame takes little more room than it needs while it waits") {
  const Constant<Escaped> source;
  Bytes buffer(1000);
  std::size_t size = 0;
  REQUIRE(wirebond::lay_out_frame(source, buffer.data(), buffer.size(), 1, 100, 0, nullptr, size));
  CHECK(wirebond::set_aside(source, buffer.data(), size, 0) == 104 + 2 + 1 + 2);  // delimiters; number; check
}
