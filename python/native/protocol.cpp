// Reads the Python model and plan into tables. The loader has validated both: a surprise here is our own mistake.
#include "protocol.hpp"

#include <nanobind/stl/string.h>

#include <utility>

#include "words.hpp"

namespace wirebond::engine {

namespace {

nb::object interned(const std::string& text) { return nb::steal(PyUnicode_InternFromString(text.c_str())); }

constexpr std::pair<const char*, PayloadSize> payload_rules[] = {{"by_length", PayloadSize::by_length},
                                                                 {"fixed", PayloadSize::fixed},
                                                                 {"by_id", PayloadSize::by_id},
                                                                 {"rest", PayloadSize::rest}};
constexpr std::pair<const char*, CheckKind> check_kinds[] = {{"crc", CheckKind::crc},
                                                             {"sum", CheckKind::sum},
                                                             {"fletcher", CheckKind::fletcher},
                                                             {"xor", CheckKind::exclusive_or}};
constexpr std::pair<const char*, OddTail> odd_tails[] = {
    {"pad", OddTail::pad}, {"xor", OddTail::exclusive_or}, {"refuse", OddTail::refuse}};
constexpr std::pair<const char*, Framing> framings[] = {{"by_start", Framing::by_start},
                                                        {"delimited", Framing::delimited},
                                                        {"bracketed", Framing::bracketed},
                                                        {"silence", Framing::silence},
                                                        {"sized", Framing::sized}};
constexpr std::pair<const char*, Stuffing> stuffings[] = {{"none", Stuffing::none},
                                                          {"cobs", Stuffing::cobs},
                                                          {"escape", Stuffing::escape},
                                                          {"hex", Stuffing::hex},
                                                          {"hex_after_digit", Stuffing::hex_after_digit},
                                                          {"decimal_check", Stuffing::decimal_check},
                                                          {"insertion", Stuffing::insertion}};

Position read_position(nb::handle position) {
  return {nb::cast<std::int16_t>(position.attr("offset")), nb::cast<bool>(position.attr("from_end"))};
}

Number read_number(nb::handle number) {
  Number out;
  if (number.is_none()) return out;
  out.at = read_position(number.attr("at"));
  out.bytes = nb::cast<std::uint8_t>(number.attr("bytes"));
  out.order = byte_order_of(number.attr("order"));
  out.shift = nb::cast<std::uint8_t>(number.attr("shift"));
  out.mask = nb::cast<std::uint64_t>(number.attr("mask"));
  return out;
}

/// Read an index in the list of header fields; None: there is no such field.
std::uint8_t read_place(nb::handle place) { return place.is_none() ? no_header_field : nb::cast<std::uint8_t>(place); }

constexpr std::pair<const char*, Subject> subjects[] = {
    {"field", Subject::field}, {"id", Subject::id}, {"size", Subject::size}};

Exclusion read_exclusion(nb::handle exclusion) {
  return {meant_by(subjects, exclusion.attr("subject"), "subject of a condition"),
          nb::cast<std::uint8_t>(exclusion.attr("place")),
          nb::cast<bool>(exclusion.attr("on_receive")),
          read_number(exclusion.attr("number")),
          nb::cast<std::uint64_t>(exclusion.attr("low")),
          nb::cast<std::uint64_t>(exclusion.attr("high"))};
}

Mark read_mark(nb::handle bytes) {
  const auto mark = nb::cast<nb::bytes>(bytes);
  const auto* const data = static_cast<const std::uint8_t*>(mark.data());
  if (mark.size() == 0) return {};
  return {static_cast<std::uint8_t>(mark.size()), data[0], mark.size() == 2 ? data[1] : std::uint8_t{0}};
}

Form read_form(nb::handle plan) {
  Form form;
  form.prefix = nb::cast<std::uint16_t>(plan.attr("prefix"));
  form.suffix = nb::cast<std::uint16_t>(plan.attr("suffix"));
  form.prefix_constants = nb::cast<std::uint8_t>(plan.attr("prefix_constants"));
  form.header_checks = nb::cast<std::uint8_t>(plan.attr("header_checks"));
  form.payload_size = meant_by(payload_rules, plan.attr("payload"), "payload rule");
  form.length_unit = nb::cast<std::uint8_t>(plan.attr("length_unit"));
  form.length_bias = nb::cast<std::int32_t>(plan.attr("length_bias"));
  form.payload_unit = nb::cast<std::uint8_t>(plan.attr("payload_unit"));
  form.payload_rest = nb::cast<std::uint8_t>(plan.attr("payload_rest"));
  form.fixed_payload = nb::cast<std::uint16_t>(plan.attr("fixed_payload"));
  form.trims_zeros = nb::cast<bool>(plan.attr("trims_zeros"));
  form.length = read_number(plan.attr("length"));
  form.id = read_number(plan.attr("id"));
  form.id_mask = nb::cast<std::uint32_t>(plan.attr("id_mask"));
  form.id_value = nb::cast<std::uint32_t>(plan.attr("id_value"));
  for (nb::handle constant : plan.attr("constants")) {
    form.constants.at(form.constant_count++) = {read_position(constant.attr("at")),
                                                nb::cast<std::uint8_t>(constant.attr("mask")),
                                                nb::cast<std::uint8_t>(constant.attr("value"))};
  }
  for (nb::handle check : plan.attr("checks")) {
    CheckRule& rule = form.checks.at(form.check_count++);
    rule.algorithm = nb::cast<std::uint8_t>(check.attr("algorithm"));
    std::size_t number = 0;
    for (nb::handle ends : check.attr("ranges")) {
      const CheckRange range{read_position(ends[0]), read_position(ends[1])};
      if (number++ == 0) {
        rule.from = range.from;
        rule.to = range.to;
      } else {
        rule.more.at(rule.more_count++) = range;
      }
    }
    rule.run = read_number(check.attr("run"));
    rule.covers_run = nb::cast<bool>(check.attr("covers_run"));
    rule.at = read_position(check.attr("at"));
    rule.bytes = nb::cast<std::uint8_t>(check.attr("bytes"));
    rule.order = byte_order_of(check.attr("order"));
    rule.shift = nb::cast<std::uint8_t>(check.attr("shift"));
    rule.seeded = nb::cast<bool>(check.attr("seeded"));
    rule.as_hex = nb::cast<bool>(check.attr("as_hex"));
    rule.on_wire = nb::cast<bool>(check.attr("on_wire"));
    rule.continues = nb::cast<std::int8_t>(check.attr("continues"));
  }
  for (nb::handle field : plan.attr("header")) {
    form.header.at(form.header_count++) = {read_number(field.attr("number")),
                                           nb::cast<std::uint64_t>(field.attr("default")),
                                           nb::cast<std::uint8_t>(field.attr("place")),
                                           nb::cast<std::uint64_t>(field.attr("fixed_mask")),
                                           nb::cast<std::uint64_t>(field.attr("fixed_value")),
                                           nb::cast<bool>(field.attr("is_magic"))};
  }
  return form;
}

PayloadTable read_rules(nb::handle rules) {
  PayloadTable out;
  for (nb::handle constant : rules.attr("constants")) {
    out.constants.push_back(
        {nb::cast<std::uint16_t>(constant.attr("at")), nb::cast<std::uint8_t>(constant.attr("behind")),
         nb::cast<std::uint8_t>(constant.attr("mask")), nb::cast<std::uint8_t>(constant.attr("value"))});
  }
  for (nb::handle count : rules.attr("counts")) {
    const nb::object with = count.attr("agrees_with");
    const std::int8_t agrees = with.is_none() ? std::int8_t{-1} : nb::cast<std::int8_t>(with);
    out.counts.push_back({nb::cast<std::uint16_t>(count.attr("at")), nb::cast<std::uint8_t>(count.attr("behind")),
                          nb::cast<std::uint8_t>(count.attr("bytes")), byte_order_of(count.attr("order")),
                          nb::cast<std::uint8_t>(count.attr("shift")), nb::cast<std::uint64_t>(count.attr("mask")),
                          nb::cast<std::uint16_t>(count.attr("unit")), nb::cast<std::uint16_t>(count.attr("most")),
                          nb::cast<std::uint16_t>(count.attr("step")), agrees});
  }
  out.most_beside = nb::cast<std::uint16_t>(rules.attr("most_beside"));
  return out;
}

constexpr std::pair<const char*, MatchOf> match_subjects[] = {
    {"id", MatchOf::id}, {"header", MatchOf::header}, {"payload", MatchOf::payload}, {"size", MatchOf::size}};

MatchTable read_tests(nb::handle tests) {
  MatchTable out;
  for (nb::handle test : tests) {
    MatchTest one;
    one.of = meant_by(match_subjects, test.attr("of"), "subject of a match");
    one.place = nb::cast<std::uint8_t>(test.attr("place"));
    one.or_next = nb::cast<bool>(test.attr("or_next"));
    one.is_one = nb::cast<bool>(test.attr("is_one"));
    one.bytes = nb::cast<std::uint8_t>(test.attr("bytes"));
    one.order = byte_order_of(test.attr("order"));
    one.shift = nb::cast<std::uint8_t>(test.attr("shift"));
    one.at = nb::cast<std::uint16_t>(test.attr("at"));
    one.mask = nb::cast<std::uint64_t>(test.attr("mask"));
    one.low = nb::cast<std::uint64_t>(test.attr("low"));
    one.high = nb::cast<std::uint64_t>(test.attr("high"));
    out.tests.push_back(one);
    out.names.push_back(text_of(test.attr("name")));
  }
  return out;
}

CheckAlgorithm read_algorithm(nb::handle algorithm) {
  CheckAlgorithm out;
  out.kind = meant_by(check_kinds, algorithm.attr("kind"), "kind of check");
  out.modulus = nb::cast<std::uint16_t>(algorithm.attr("modulus"));
  out.negate = nb::cast<bool>(algorithm.attr("negate"));
  out.width_bits = nb::cast<std::uint8_t>(algorithm.attr("width"));
  out.reflect_in = nb::cast<bool>(algorithm.attr("refin"));
  out.reflect_out = nb::cast<bool>(algorithm.attr("refout"));
  out.poly = nb::cast<std::uint64_t>(algorithm.attr("poly"));
  out.init = nb::cast<std::uint64_t>(algorithm.attr("init"));
  out.xor_out = nb::cast<std::uint64_t>(algorithm.attr("xorout"));
  out.unit = nb::cast<std::uint8_t>(algorithm.attr("unit"));
  out.unit_is_little = byte_order_of(algorithm.attr("unit_order")) == ByteOrder::little;
  out.odd_tail = meant_by(odd_tails, algorithm.attr("odd"), "rule for an incomplete word");
  out.end_around = nb::cast<bool>(algorithm.attr("end_around"));
  out.plus = nb::cast<std::uint64_t>(algorithm.attr("plus"));
  out.keep = nb::cast<std::uint64_t>(algorithm.attr("kept"));
  out.bcd = nb::cast<bool>(algorithm.attr("bcd"));
  for (nb::handle values : algorithm.attr("avoided")) {
    out.avoided.at(out.avoided_count++) = {nb::cast<std::uint8_t>(values[0]), nb::cast<std::uint8_t>(values[1])};
  }
  out.avoided_plus = nb::cast<std::uint8_t>(algorithm.attr("avoided_plus"));
  return out;
}

}  // namespace

ProtocolTable::ProtocolTable(nb::handle protocol) : name_(text_of(protocol.attr("name"))) {
  const nb::object payload_rules = nb::module_::import_("wirebond.protocol.payload_rules").attr("payload_rules");
  for (nb::handle message : protocol.attr("messages")) {
    MessageTable table;
    table.name = text_of(message.attr("name"));
    table.key = interned(table.name);
    table.sender = interned(text_of(message.attr("sender")));
    table.min_payload = nb::cast<std::size_t>(message.attr("min_payload"));
    table.max_payload = nb::cast<std::size_t>(message.attr("max_payload"));
    table.fields = read_steps(message.attr("layout"));
    table.constants = read_rules(payload_rules(message)).constants;
    messages_.push_back(std::move(table));
  }
}

int ProtocolTable::find(const std::string& name) const {
  for (std::size_t i = 0; i < messages_.size(); ++i) {
    if (messages_[i].name == name) return static_cast<int>(i);
  }
  return -1;
}

FormatTable::FormatTable(nb::handle plan) {
  format_.framing = meant_by(framings, plan.attr("framing"), "framing");
  format_.opening = read_mark(plan.attr("opening"));
  format_.closing = read_mark(plan.attr("closing"));
  format_.sends_opening = nb::cast<bool>(plan.attr("sends_opening"));
  format_.stuffing = meant_by(stuffings, plan.attr("stuffing"), "stuffing");
  const nb::object escapes = plan.attr("escapes");
  if (!escapes.is_none()) {
    format_.escapes.escape = nb::cast<std::uint8_t>(escapes.attr("escape"));
    format_.escapes.starts = nb::cast<std::uint8_t>(plan.attr("starts"));
    format_.escapes.exclusive_or = nb::cast<std::uint8_t>(escapes.attr("exclusive_or"));
    for (nb::handle pair : escapes.attr("pairs")) {
      const std::size_t i = format_.escapes.count++;
      format_.escapes.plain.at(i) = nb::cast<std::uint8_t>(nb::object(pair[0]));
      format_.escapes.code.at(i) = nb::cast<std::uint8_t>(nb::object(pair[1]));
    }
  }
  format_.deliver_unknown = nb::cast<bool>(plan.attr("deliver_unknown"));
  const nb::object insertion = plan.attr("insertion");
  if (!insertion.is_none()) {
    for (nb::handle byte : nb::object(insertion.attr("after"))) {
      format_.insertion.after.at(format_.insertion.size++) = nb::cast<std::uint8_t>(byte);
    }
    format_.insertion.byte = nb::cast<std::uint8_t>(insertion.attr("byte"));
  }
  format_.length_on_wire = nb::cast<bool>(plan.attr("length_on_wire"));
  format_.skips_failed = nb::cast<bool>(plan.attr("skips_failed"));
  format_.plain_front = nb::cast<std::uint8_t>(plan.attr("plain_front"));
  format_.plain_back = nb::cast<std::uint8_t>(plan.attr("plain_back"));
  format_.decimal_bytes = nb::cast<std::uint8_t>(plan.attr("decimal_bytes"));
  format_.max_payload = nb::cast<std::uint16_t>(plan.attr("max_payload"));
  format_.no_id = nb::cast<std::uint32_t>(plan.attr("no_id"));
  format_.sequence_place = read_place(plan.attr("sequence"));
  format_.sequence_per_message = nb::cast<bool>(plan.attr("sequence_per_message"));
  format_.peer_place = read_place(plan.attr("peer"));
  format_.own_forms = nb::cast<std::uint8_t>(plan.attr("own_forms"));
  format_.form_count = 0;
  std::size_t exclusions = 0;
  for (nb::handle form : plan.attr("forms")) {
    Form& one = format_.forms.at(format_.form_count++);
    one = read_form(form);
    one.first_exclusion = static_cast<std::uint8_t>(exclusions);
    for (nb::handle exclusion : form.attr("exclusions")) {
      format_.exclusions.at(exclusions++) = read_exclusion(exclusion);
      ++one.exclusion_count;
    }
  }
  nb::list meanings;
  for (nb::handle field : plan.attr("header")) meanings.append(field.attr("value"));
  header_ = read_numbers(meanings);
  for (nb::handle algorithm : plan.attr("algorithms")) {
    format_.algorithms.at(format_.algorithm_count++) = read_algorithm(algorithm);
  }
  const bool matches = nb::cast<bool>(plan.attr("matches"));
  const nb::object id_place = plan.attr("id_place");
  if (!id_place.is_none()) id_place_ = nb::cast<int>(id_place);
  for (nb::handle message : plan.attr("messages")) {
    if (matches || id_place_ >= 0) match_tables_.push_back(read_tests(message.attr("tests")));
    payload_tables_.push_back(read_rules(message.attr("rules")));
    rows_.push_back(
        {nb::cast<std::uint32_t>(message.attr("id")),
         {nb::cast<std::int16_t>(message.attr("index")), nb::cast<std::uint16_t>(message.attr("min_payload")),
          nb::cast<std::uint16_t>(message.attr("max_payload")), nb::cast<std::uint8_t>(message.attr("seed"))},
         nb::cast<bool>(message.attr("only_expected")),
         payload_tables_.back().rules(),
         matches ? match_tables_.back().view() : MatchTests{}});
  }
  tables_ = std::make_unique<RuntimeTables>(format_, rows_.data(), rows_.size(), CrcMethod::automatic, matches,
                                            nb::cast<bool>(plan.attr("matches_late")));
}

const MatchTable* FormatTable::match_of(std::size_t message) const {
  for (std::size_t row = 0; row < match_tables_.size(); ++row) {
    if (rows_[row].shape.index == static_cast<std::int16_t>(message)) return &match_tables_[row];
  }
  return nullptr;
}

std::uint32_t FormatTable::id_of(std::size_t message) const {
  for (const MessageRow& row : rows_) {
    if (row.shape.index == static_cast<std::int16_t>(message)) return row.id;
  }
  return format_.no_id;
}

}  // namespace wirebond::engine
