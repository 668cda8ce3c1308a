// Which form a sender takes: by the id, by the payload's size, by header values and by conditions.
#include <doctest/doctest.h>

#include <array>
#include <cstddef>
#include <cstdint>

#include "formats.hpp"
#include "wirebond/encoder.hpp"
#include "wirebond/source.hpp"

using wirebond::HeaderField;
using wirebond::HeaderValues;
using wirebond::Subject;

namespace {

/// Four forms, told apart by their first byte, which is the header value of place 2. The sender takes the first three
/// by itself.
///   02  up to 100 bytes, of ids without the top bit
///   03  from 101 bytes on, with a length of two bytes
///   04  1 to 255 bytes, of ids with the top bit
///   05  with the values of places 0 and 1; place 1 is odd, and place 0 not from 10 to 20
struct Chosen {
  static constexpr std::array<formats::MessageRow, 1> rows = {{{0x01, {0, 0, 0}}}};
  static constexpr wirebond::FrameFormat make() {
    formats::FrameFormat format{};
    format.max_payload = 0xFFFF;
    format.form_count = 4;
    format.own_forms = 3;
    for (std::uint8_t i = 0; i < 4; ++i) {
      auto& form = format.forms[i];
      const auto start = static_cast<std::uint8_t>(2 + i);
      form.prefix_constants = form.constant_count = 1;
      form.constants[0] = {{0, false}, 0xFF, start};
      form.payload_size = formats::PayloadSize::by_length;
      form.header_count = 1;
      form.header[0] = HeaderField{{{0, false}, 1}, start, 2, 0xFF, start, true};
    }
    auto& brief = format.forms[0];
    brief.prefix = 3;
    brief.length = {{1, false}, 1, formats::ByteOrder::little, 0, 0xFF};
    brief.id = {{2, false}, 1};
    brief.id_mask = 0x80;
    brief.exclusion_count = 1;
    format.exclusions[0] = {Subject::size, 0, true, {}, 101, 0xFFFF};

    auto& wide = format.forms[1];
    wide.prefix = 4;
    wide.length = {{1, false}, 2, formats::ByteOrder::big, 0, 0xFFFF};
    wide.id = {{3, false}, 1};
    wide.first_exclusion = 1;
    wide.exclusion_count = 1;
    format.exclusions[1] = {Subject::size, 0, true, {}, 0, 100};

    auto& marked = format.forms[2];
    marked.prefix = 3;
    marked.length = {{1, false}, 1, formats::ByteOrder::little, 0, 0xFF};
    marked.id = {{2, false}, 1};
    marked.id_mask = marked.id_value = 0x80;
    marked.first_exclusion = 3;
    marked.exclusion_count = 1;
    format.exclusions[3] = {Subject::size, 0, true, {}, 0, 0};

    auto& asked = format.forms[3];
    asked.prefix = 5;
    asked.header_count = 3;
    asked.header[1] = HeaderField{{{1, false}, 1}, 0, 0};
    asked.header[2] = HeaderField{{{2, false}, 1}, 1, 1, 0x01, 0x01};
    asked.length = {{3, false}, 1, formats::ByteOrder::little, 0, 0xFF};
    asked.id = {{4, false}, 1};
    asked.first_exclusion = 2;
    asked.exclusion_count = 1;
    format.exclusions[2] = {Subject::field, 0, true, {{1, false}, 1}, 10, 20};
    return format;
  }
};

constexpr int none = -1;

/// The index of the form; -1: there is none, and nothing was called.
template <class Source>
int form_of(const Source& source, std::uint32_t id, std::size_t payload, HeaderValues header = {}) {
  int found = none, calls = 0;
  const bool is_there = wirebond::detail::with_own_form(
      source, id, payload,
      [&](std::size_t index) {
        found = static_cast<int>(index);
        ++calls;
      },
      header);
  CHECK(calls == (is_there ? 1 : 0));
  return found;
}

constexpr std::uint32_t given(unsigned place) { return std::uint32_t{1} << place; }

}  // namespace

TEST_CASE("the payload's size chooses the form") {
  formats::for_both_sources<Chosen>([](const auto& source) {
    CHECK(form_of(source, 0x01, 0) == 0);
    CHECK(form_of(source, 0x01, 100) == 0);
    CHECK(form_of(source, 0x01, 101) == 1);
    CHECK(form_of(source, 0x01, 0xFFFF) == 1);
  });
}

TEST_CASE("of forms for some ids the first that carries the id is taken") {
  formats::for_both_sources<Chosen>([](const auto& source) {
    CHECK(form_of(source, 0x7F, 50) == 0);
    CHECK(form_of(source, 0x80, 50) == 2);
    CHECK(form_of(source, 0x80, 101) == 1);
    CHECK(form_of(source, 0xFF, 255) == 1);
  });
}

TEST_CASE("a form whose id has no room for this one does not carry it") {
  formats::for_both_sources<Chosen>([](const auto& source) {
    CHECK(form_of(source, 0xFF, 101) == 1);
    CHECK(form_of(source, 0x100, 101) == none);
    CHECK(form_of(source, 0x1'007F, 50) == none);
    std::uint8_t buffer[200] = {};
    for (const std::size_t form : {0u, 1u, 2u}) {
      CHECK(wirebond::seal(source, buffer, sizeof buffer, 0x0100, 50, form) == 0);
      CHECK(wirebond::seal(source, buffer, sizeof buffer, 0x0180, 50, form) == 0);
      CHECK(wirebond::seal(source, buffer, sizeof buffer, 0x0180, 150, form) == 0);
    }
  });
}

TEST_CASE("a value that was given takes the form that has it, and no sender does so by itself") {
  formats::for_both_sources<Chosen>([](const auto& source) {
    const std::uint64_t values[] = {5, 1, 0x02};
    CHECK(form_of(source, 0x01, 50, {values, 0}) == 0);
    CHECK(form_of(source, 0x01, 50, {values, given(0)}) == 3);
    CHECK(form_of(source, 0x01, 50, {values, given(1)}) == 3);
    CHECK(form_of(source, 0x01, 255, {values, given(0)}) == 3);
    CHECK(form_of(source, 0x01, 256, {values, given(0)}) == none);  // its length has one byte
    CHECK(form_of(source, 0x01, 50, {values, given(3)}) == none);   // no form has that field
    CHECK(form_of(source, 0x80, 0) == none);
    CHECK(form_of(source, 0x80, 0, {values, 0}) == 3);
  });
}

TEST_CASE("bits that tell a form, and conditions over a field, keep values out") {
  formats::for_both_sources<Chosen>([](const auto& source) {
    const std::uint64_t even[] = {5, 2, 0x02};
    CHECK(form_of(source, 0x01, 50, {even, given(0)}) == none);
    CHECK(form_of(source, 0x01, 50, {even, 0}) == 0);
    for (const std::uint64_t value : {9u, 10u, 20u, 21u}) {
      const std::uint64_t values[] = {value, 3, 0x02};
      const bool is_out = value >= 10 && value <= 20;
      CHECK(form_of(source, 0x01, 50, {values, given(0)}) == (is_out ? none : 3));
    }
  });
}

TEST_CASE("a magic that was given is kept to, and one that was not is any form's") {
  formats::for_both_sources<Chosen>([](const auto& source) {
    for (std::uint64_t magic = 2; magic <= 6; ++magic) {
      const std::uint64_t values[] = {5, 1, magic};
      const int small[] = {0, none, none, 3, none};   // of id 0x01 and 50 bytes
      const int large[] = {none, 1, none, 3, none};   // and 200 bytes
      const int marked[] = {none, none, 2, 3, none};  // of id 0x81 and 50 bytes
      CHECK(form_of(source, 0x01, 50, {values, given(2)}) == small[magic - 2]);
      CHECK(form_of(source, 0x01, 200, {values, given(2)}) == large[magic - 2]);
      CHECK(form_of(source, 0x81, 50, {values, given(2)}) == marked[magic - 2]);
      CHECK(form_of(source, 0x01, 50, {values, 0}) == 0);
    }
  });
}
