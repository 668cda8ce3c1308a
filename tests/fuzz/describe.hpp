// A format and bytes as text, for the report of a finding.
#pragma once

#include <cstddef>
#include <cstdint>
#include <cstdio>

#include "wirebond/format.hpp"

namespace fuzz {

inline void print_position(const char* name, const wirebond::Position& at) {
  std::fprintf(stderr, " %s %s%d", name, at.from_end ? "end" : "", at.offset);
}

inline void print_number(const char* name, const wirebond::Number& number) {
  if (!number.present()) return;
  std::fprintf(stderr, "  %s:", name);
  print_position("at", number.at);
  std::fprintf(stderr, " bytes %u %s >> %u & 0x%llX\n", number.bytes,
               number.order == wirebond::ByteOrder::little ? "little" : "big", number.shift,
               static_cast<unsigned long long>(number.mask));
}

inline void print_form(const wirebond::Form& form) {
  static constexpr const char* rules[] = {"by_length", "fixed", "by_id", "rest"};
  std::fprintf(stderr, " form: prefix %u suffix %u payload %s unit %u bias %d fixed %u in units of %u and %u%s\n",
               form.prefix, form.suffix, rules[static_cast<int>(form.payload_size)], form.length_unit, form.length_bias,
               form.fixed_payload, form.payload_unit, form.payload_rest, form.trims_zeros ? " trims zeros" : "");
  for (std::size_t i = 0; i < form.constant_count; ++i) {
    std::fprintf(stderr, "  constant:");
    print_position("at", form.constants[i].at);
    std::fprintf(stderr, " mask %02X value %02X\n", form.constants[i].mask, form.constants[i].value);
  }
  print_number("length", form.length);
  print_number("id", form.id);
  for (std::size_t i = 0; i < form.header_count; ++i) print_number("header field", form.header[i].number);
  for (std::size_t i = 0; i < form.check_count; ++i) {
    const wirebond::CheckRule& rule = form.checks[i];
    std::fprintf(stderr, "  check of algorithm %u%s:", rule.algorithm, i < form.header_checks ? " (header)" : "");
    print_position("over", rule.from);
    print_position("to", rule.to);
    for (std::size_t range = 0; range < rule.more_count; ++range) {
      print_position("and over", rule.more[range].from);
      print_position("to", rule.more[range].to);
    }
    print_position("at", rule.at);
    if (rule.run.present()) print_number(rule.covers_run ? "covered run" : "run", rule.run);
    std::fprintf(stderr, " bytes %u shift %u%s%s continues %d\n", rule.bytes, rule.shift, rule.seeded ? " seeded" : "",
                 rule.as_hex ? " as hex" : "", rule.continues);
  }
}

inline void print_format(const wirebond::FrameFormat& format) {
  static constexpr const char* framings[] = {"by_start", "delimited", "bracketed", "silence", "sized"};
  static constexpr const char* stuffings[] = {"none",         "cobs", "escape", "hex", "insertion", "hex_after_digit",
                                              "decimal_check"};
  std::fprintf(
      stderr,
      "format: %s, stuffing %s, delimiters %02X %02X, %02X %02X%s, escape %02X xor %02X, max_payload %u, unknown %s\n",
      framings[static_cast<int>(format.framing)], stuffings[static_cast<int>(format.stuffing)], format.opening.first,
      format.opening.size == 2 ? format.opening.second : 0u, format.closing.first,
      format.closing.size == 2 ? format.closing.second : 0u, format.sends_opening ? "" : " (closing alone)",
      format.escapes.escape, format.escapes.exclusive_or, format.max_payload,
      format.deliver_unknown ? "deliver" : "reject");
  for (std::size_t i = 0; i < format.algorithm_count; ++i) {
    const wirebond::CheckAlgorithm& algorithm = format.algorithms[i];
    std::fprintf(stderr, " algorithm %zu: kind %d width %u poly %llX init %llX refin %d refout %d xorout %llX\n", i,
                 static_cast<int>(algorithm.kind), algorithm.width_bits,
                 static_cast<unsigned long long>(algorithm.poly), static_cast<unsigned long long>(algorithm.init),
                 algorithm.reflect_in, algorithm.reflect_out, static_cast<unsigned long long>(algorithm.xor_out));
    std::fprintf(stderr, "  unit %u%s odd tail %d modulus %u%s%s plus %llX keep %llX%s\n", algorithm.unit,
                 algorithm.unit_is_little ? " little" : "", static_cast<int>(algorithm.odd_tail), algorithm.modulus,
                 algorithm.end_around ? " end-around" : "", algorithm.negate ? " negated" : "",
                 static_cast<unsigned long long>(algorithm.plus), static_cast<unsigned long long>(algorithm.keep),
                 algorithm.bcd ? " in decimal digits" : "");
    for (std::size_t j = 0; j < algorithm.avoided_count; ++j) {
      std::fprintf(stderr, "  avoids %02X to %02X, plus %02X\n", algorithm.avoided[j].low, algorithm.avoided[j].high,
                   algorithm.avoided_plus);
    }
  }
  for (std::size_t i = 0; i < format.form_count; ++i) print_form(format.forms[i]);
}

inline void print_bytes(const char* name, const std::uint8_t* bytes, std::size_t size) {
  std::fprintf(stderr, "%s (%zu bytes):", name, size);
  for (std::size_t i = 0; i < size; ++i) std::fprintf(stderr, " %02X", bytes[i]);
  std::fprintf(stderr, "\n");
}

}  // namespace fuzz
