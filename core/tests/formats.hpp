// Frame formats that the tests share, each as a constant source and as a run-time source over the same value.
#pragma once

#include <doctest/doctest.h>

#include <array>
#include <cstddef>
#include <cstdint>
#include <vector>

#include "wirebond/encoder.hpp"
#include "wirebond/format.hpp"
#include "wirebond/host/runtime_source.hpp"

namespace formats {

using wirebond::ByteOrder;
using wirebond::CheckAlgorithm;
using wirebond::CheckKind;
using wirebond::FrameFormat;
using wirebond::Framing;
using wirebond::MessageRow;
using wirebond::MessageShape;
using wirebond::PayloadSize;
using wirebond::Stuffing;

constexpr CheckAlgorithm mcrf4xx{CheckKind::crc, 16, true, true, 0x1021, 0xFFFF, 0x0000};
constexpr CheckAlgorithm ibm_sdlc{CheckKind::crc, 16, true, true, 0x1021, 0xFFFF, 0xFFFF};
constexpr CheckAlgorithm xmodem{CheckKind::crc, 16, false, false, 0x1021, 0x0000, 0x0000};
constexpr CheckAlgorithm xor8{CheckKind::exclusive_or, 8, false, false, 0, 0, 0};
constexpr CheckAlgorithm sum16{CheckKind::sum, 16, false, false, 0, 0, 0};

/// AA, length, id, CRC of these, payload, CRC of all: a wrong length is found before anybody waits for it.
struct HeaderChecked {
  static constexpr std::array<MessageRow, 3> rows = {{{0xA1, {0, 4, 4}}, {0xA2, {1, 0, 40}}, {0xA3, {2, 1, 1}}}};
  static constexpr FrameFormat make() {
    FrameFormat format{};
    format.algorithm_count = 1;
    format.algorithms[0] = mcrf4xx;
    format.deliver_unknown = true;
    format.max_payload = 40;
    auto& form = format.forms[0];
    form.prefix = 5;
    form.suffix = 2;
    form.prefix_constants = form.constant_count = 1;
    form.constants[0] = {{0, false}, 0xFF, 0xAA};
    form.payload_size = PayloadSize::by_length;
    form.length = {{1, false}, 1};
    form.id = {{2, false}, 1};
    form.header_checks = 1;
    form.check_count = 2;
    form.checks[0] = {0, {0, false}, {3, false}, {3, false}, 2};
    form.checks[1] = {0, {0, false}, {-2, true}, {-2, true}, 2, ByteOrder::little, 0, 0};
    return format;
  }
};

/// AA 55, id, four payload bytes, two reserved ones, exclusive-or of all, 0D.
struct FixedSize {
  static constexpr std::array<MessageRow, 2> rows = {{{0x01, {0, 4, 4}}, {0x02, {1, 0, 0}}}};
  static constexpr FrameFormat make() {
    FrameFormat format{};
    format.algorithm_count = 1;
    format.algorithms[0] = xor8;
    format.max_payload = 4;
    auto& form = format.forms[0];
    form.prefix = 3;
    form.suffix = 4;
    form.prefix_constants = 2;
    form.constant_count = 3;
    form.constants[0] = {{0, false}, 0xFF, 0xAA};
    form.constants[1] = {{1, false}, 0xFF, 0x55};
    form.constants[2] = {{-1, true}, 0xFF, 0x0D};
    form.payload_size = PayloadSize::fixed;
    form.fixed_payload = 4;
    form.id = {{2, false}, 1};
    form.check_count = 1;
    form.checks[0] = {0, {0, false}, {-2, true}, {-2, true}, 1};
    return format;
  }
};

/// 7A, id, length, payload, high byte of the sum of these three, 7B. Nothing checks the length by itself.
struct WeakSum {
  static constexpr std::array<MessageRow, 2> rows = {{{0x01, {0, 2, 2}}, {0x02, {1, 0, 200}}}};
  static constexpr FrameFormat make() {
    FrameFormat format{};
    format.algorithm_count = 1;
    format.algorithms[0] = sum16;
    format.max_payload = 200;
    auto& form = format.forms[0];
    form.prefix = 3;
    form.suffix = 2;
    form.prefix_constants = 1;
    form.constant_count = 2;
    form.constants[0] = {{0, false}, 0xFF, 0x7A};
    form.constants[1] = {{-1, true}, 0xFF, 0x7B};
    form.payload_size = PayloadSize::by_length;
    form.id = {{1, false}, 1};
    form.length = {{2, false}, 1};
    form.check_count = 1;
    form.checks[0] = {0, {1, false}, {-2, true}, {-2, true}, 1, ByteOrder::little, 8};
    return format;
  }
};

/// COBS between zeros: id, payload, CRC.
struct Delimited {
  static constexpr std::array<MessageRow, 2> rows = {{{0x01, {0, 3, 3}}, {0x02, {1, 0, 300}}}};
  static constexpr FrameFormat make() {
    FrameFormat format{};
    format.framing = Framing::delimited;
    format.stuffing = Stuffing::cobs;
    format.algorithm_count = 1;
    format.algorithms[0] = ibm_sdlc;
    format.deliver_unknown = true;
    format.max_payload = 300;
    auto& form = format.forms[0];
    form.prefix = 1;
    form.suffix = 2;
    form.payload_size = PayloadSize::rest;
    form.id = {{0, false}, 1};
    form.check_count = 1;
    form.checks[0] = {0, {0, false}, {-2, true}, {-2, true}, 2};
    return format;
  }
};

/// A length of two bytes, big-endian, that counts itself and all that follows; an id of two bytes behind the payload;
/// a plain CRC, big-endian, in the middle; the payload's size is that of its message.
struct BigEndian {
  static constexpr std::array<MessageRow, 2> rows = {{{0x0102, {0, 5, 5}}, {0xFFFE, {1, 0, 9}}}};
  static constexpr FrameFormat make() {
    FrameFormat format{};
    format.algorithm_count = 1;
    format.algorithms[0] = xmodem;
    format.max_payload = 9;
    auto& form = format.forms[0];
    form.prefix = 3;
    form.suffix = 4;
    form.prefix_constants = form.constant_count = 1;
    form.constants[0] = {{0, false}, 0xFF, 0x3C};
    form.payload_size = PayloadSize::by_length;
    form.length = {{1, false}, 2, ByteOrder::big};
    form.length_bias = -6;
    form.id = {{-2, true}, 2, ByteOrder::big};
    form.check_count = 1;
    form.checks[0] = {0, {1, false}, {-4, true}, {-4, true}, 2, ByteOrder::big};
    return format;
  }
};

/// DLE STX, id, payload, exclusive-or of both, DLE ETX; among the three a DLE (10) is sent twice.
struct Doubled {
  static constexpr std::array<MessageRow, 2> rows = {{{0x10, {0, 2, 2}}, {0x03, {1, 0, 20}}}};
  static constexpr FrameFormat make() {
    FrameFormat format{};
    format.framing = Framing::bracketed;
    format.stuffing = Stuffing::escape;
    format.opening = {2, 0x10, 0x02};
    format.closing = {2, 0x10, 0x03};
    format.escapes = {0x10, 0, 1, {0x10}, {0x10}};
    format.algorithm_count = 1;
    format.algorithms[0] = xor8;
    format.max_payload = 20;
    auto& form = format.forms[0];
    form.prefix = 1;
    form.suffix = 1;
    form.payload_size = PayloadSize::rest;
    form.id = {{0, false}, 1};
    form.check_count = 1;
    form.checks[0] = {0, {0, false}, {-1, true}, {-1, true}, 1};
    return format;
  }
};

/// The same; what failed is not looked through again.
struct StrictDoubled : Doubled {
  static constexpr FrameFormat make() {
    FrameFormat format = Doubled::make();
    format.skips_failed = true;
    return format;
  }
};

/// Payload, exclusive-or of it, CR LF; there is no id, and nothing is stuffed.
struct Lines {
  static constexpr std::array<MessageRow, 1> rows = {{{0, {0, 0, 20}}}};
  static constexpr FrameFormat make() {
    FrameFormat format{};
    format.framing = Framing::delimited;
    format.opening = format.closing = {2, 0x0D, 0x0A};
    format.sends_opening = false;
    format.algorithm_count = 1;
    format.algorithms[0] = xor8;
    format.max_payload = 20;
    auto& form = format.forms[0];
    form.suffix = 1;
    form.payload_size = PayloadSize::rest;
    form.check_count = 1;
    form.checks[0] = {0, {0, false}, {-1, true}, {-1, true}, 1};
    return format;
  }
};

/// 0x00, id, COBS of the payload and an exclusive-or of it, exclusive-or of all as it is sent, 0xFE, 0x00.
struct PartlyStuffed {
  static constexpr std::array<MessageRow, 2> rows = {{{0x10, {0, 2, 2}}, {0x11, {1, 0, 300}}}};
  static constexpr FrameFormat make() {
    FrameFormat format{};
    format.framing = Framing::delimited;
    format.stuffing = Stuffing::cobs;
    format.opening = format.closing = {1, 0x00};
    format.plain_front = 1;
    format.plain_back = 2;
    format.algorithm_count = 1;
    format.algorithms[0] = xor8;
    format.max_payload = 300;
    auto& form = format.forms[0];
    form.prefix = 1;
    form.suffix = 3;
    form.payload_size = PayloadSize::rest;
    form.id = {{0, false}, 1};
    form.constant_count = 1;
    form.constants[0] = {{-1, true}, 0xFF, 0xFE};
    form.check_count = 2;
    form.checks[0] = {0, {1, false}, {-3, true}, {-3, true}, 1};
    form.checks[1] = {0, {0, false}, {-2, true}, {-2, true}, 1};
    form.checks[1].on_wire = true;
    return format;
  }
};

/// The same with escapes for COBS; the check that is sent as it is may be a delimiter and then cuts the frame.
struct PartlyEscaped : PartlyStuffed {
  static constexpr FrameFormat make() {
    FrameFormat format = PartlyStuffed::make();
    format.stuffing = Stuffing::escape;
    format.escapes = {0x7D, 0x20, 2, {0x00, 0x7D}, {0x20, 0x5D}};
    return format;
  }
};

/// WeakSum whose failed frames are skipped.
struct Strict : WeakSum {
  static constexpr FrameFormat make() {
    FrameFormat format = WeakSum::make();
    format.skips_failed = true;
    return format;
  }
};

template <class Format>
struct Constant {
  static constexpr bool is_constant = true;
  static constexpr FrameFormat value = Format::make();

  constexpr const FrameFormat& format() const { return value; }
  constexpr MessageShape message(std::uint32_t id) const {
    for (const MessageRow& row : Format::rows) {
      if (row.id == id) return row.shape;
    }
    return {};
  }
  /// The only algorithm that these formats have, as generated code would call it.
  std::uint64_t check_update(unsigned, std::uint64_t reg, const std::uint8_t* bytes, std::size_t size) const {
    constexpr const CheckAlgorithm& a = value.algorithms[0];
    if constexpr (a.kind == CheckKind::crc) {
      return wirebond::crc_update<a.width_bits, a.poly, a.reflect_in>(reg, bytes, size);
    } else {
      return wirebond::sum_update(a, reg, bytes, size);
    }
  }
};

/// The run-time source over the very same value.
template <class Format>
wirebond::RuntimeSource run_time() {
  static const wirebond::RuntimeTables tables(Constant<Format>::value, Format::rows.data(), Format::rows.size());
  return wirebond::RuntimeSource(tables);
}

using Bytes = std::vector<std::uint8_t>;

/// One frame on the wire. The buffer is dirty before, as a queue's memory is.
template <class Source>
Bytes frame_of(const Source& source, std::uint32_t id, const Bytes& payload) {
  Bytes buffer(wirebond::wire_bytes(source.format(), payload.size()), 0xCC);
  for (std::size_t i = 0; i < payload.size(); ++i) buffer[wirebond::payload_lead(source) + i] = payload[i];
  buffer.resize(wirebond::seal(source, buffer.data(), buffer.size(), id, payload.size()));
  return buffer;
}

inline Bytes operator+(Bytes left, const Bytes& right) {
  left.insert(left.end(), right.begin(), right.end());
  return left;
}

/// Run `body(source)` with the constant source and with the run-time source of one format.
template <class Format, class Body>
void for_both_sources(Body&& body) {
  {
    INFO("constant source");
    body(Constant<Format>{});
  }
  {
    INFO("run-time source");
    body(run_time<Format>());
  }
}

}  // namespace formats
