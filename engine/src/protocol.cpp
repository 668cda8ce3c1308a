// Reads a protocol's messages and a plan into tables. The loader has validated both: a surprise here is our own
// mistake.
#include "wirebond/engine/protocol.hpp"

#include <utility>

#include "wirebond/engine/words.hpp"

namespace wirebond::engine {

namespace {

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

Position read_position(const Node& position) {
  return {position["offset"].as<std::int16_t>(), position["from_end"].as<bool>()};
}

Number read_number(const Node& number) {
  Number out;
  if (number.is_none()) return out;
  out.at = read_position(number["at"]);
  out.bytes = number["bytes"].as<std::uint8_t>();
  out.order = byte_order_of(number["order"]);
  out.shift = number["shift"].as<std::uint8_t>();
  out.mask = number["mask"].as<std::uint64_t>();
  return out;
}

/// Read an index in the list of header fields; None: there is no such field.
std::uint8_t read_place(const Node& place) { return place.is_none() ? no_header_field : place.as<std::uint8_t>(); }

constexpr std::pair<const char*, Subject> subjects[] = {
    {"field", Subject::field}, {"id", Subject::id}, {"size", Subject::size}};

Exclusion read_exclusion(const Node& exclusion) {
  return {meant_by(subjects, exclusion["subject"], "subject of a condition"),
          exclusion["place"].as<std::uint8_t>(),
          exclusion["on_receive"].as<bool>(),
          read_number(exclusion["number"]),
          exclusion["low"].as<std::uint64_t>(),
          exclusion["high"].as<std::uint64_t>()};
}

Mark read_mark(const Node& bytes) {
  const Node::Bytes& mark = bytes.bytes();
  if (mark.empty()) return {};
  return {static_cast<std::uint8_t>(mark.size()), mark[0], mark.size() == 2 ? mark[1] : std::uint8_t{0}};
}

Form read_form(const Node& plan) {
  Form form;
  form.prefix = plan["prefix"].as<std::uint16_t>();
  form.suffix = plan["suffix"].as<std::uint16_t>();
  form.prefix_constants = plan["prefix_constants"].as<std::uint8_t>();
  form.header_checks = plan["header_checks"].as<std::uint8_t>();
  form.payload_size = meant_by(payload_rules, plan["payload"], "payload rule");
  form.length_unit = plan["length_unit"].as<std::uint8_t>();
  form.length_bias = plan["length_bias"].as<std::int32_t>();
  form.payload_unit = plan["payload_unit"].as<std::uint8_t>();
  form.payload_rest = plan["payload_rest"].as<std::uint8_t>();
  form.fixed_payload = plan["fixed_payload"].as<std::uint16_t>();
  form.trims_zeros = plan["trims_zeros"].as<bool>();
  form.length = read_number(plan["length"]);
  form.id = read_number(plan["id"]);
  form.id_mask = plan["id_mask"].as<std::uint32_t>();
  form.id_value = plan["id_value"].as<std::uint32_t>();
  for (const Node& constant : plan["constants"].list()) {
    form.constants.at(form.constant_count++) = {read_position(constant["at"]), constant["mask"].as<std::uint8_t>(),
                                                constant["value"].as<std::uint8_t>()};
  }
  for (const Node& check : plan["checks"].list()) {
    CheckRule& rule = form.checks.at(form.check_count++);
    rule.algorithm = check["algorithm"].as<std::uint8_t>();
    std::size_t number = 0;
    for (const Node& ends : check["ranges"].list()) {
      const CheckRange range{read_position(ends[0]), read_position(ends[1])};
      if (number++ == 0) {
        rule.from = range.from;
        rule.to = range.to;
      } else {
        rule.more.at(rule.more_count++) = range;
      }
    }
    rule.run = read_number(check["run"]);
    rule.covers_run = check["covers_run"].as<bool>();
    rule.at = read_position(check["at"]);
    rule.bytes = check["bytes"].as<std::uint8_t>();
    rule.order = byte_order_of(check["order"]);
    rule.shift = check["shift"].as<std::uint8_t>();
    rule.seeded = check["seeded"].as<bool>();
    rule.as_hex = check["as_hex"].as<bool>();
    rule.on_wire = check["on_wire"].as<bool>();
    rule.continues = check["continues"].as<std::int8_t>();
  }
  for (const Node& field : plan["header"].list()) {
    form.header.at(form.header_count++) = {read_number(field["number"]),
                                           field["default"].as<std::uint64_t>(),
                                           field["place"].as<std::uint8_t>(),
                                           field["fixed_mask"].as<std::uint64_t>(),
                                           field["fixed_value"].as<std::uint64_t>(),
                                           field["is_magic"].as<bool>()};
  }
  return form;
}

std::vector<PayloadConstant> read_constants(const Node& constants) {
  std::vector<PayloadConstant> out;
  for (const Node& constant : constants.list()) {
    out.push_back({constant["at"].as<std::uint16_t>(), constant["behind"].as<std::uint8_t>(),
                   constant["mask"].as<std::uint8_t>(), constant["value"].as<std::uint8_t>()});
  }
  return out;
}

PayloadTable read_rules(const Node& rules) {
  PayloadTable out;
  out.constants = read_constants(rules["constants"]);
  for (const Node& count : rules["counts"].list()) {
    const Node& with = count["agrees_with"];
    const std::int8_t agrees = with.is_none() ? std::int8_t{-1} : with.as<std::int8_t>();
    out.counts.push_back({count["at"].as<std::uint16_t>(), count["behind"].as<std::uint8_t>(),
                          count["bytes"].as<std::uint8_t>(), byte_order_of(count["order"]),
                          count["shift"].as<std::uint8_t>(), count["mask"].as<std::uint64_t>(),
                          count["unit"].as<std::uint16_t>(), count["most"].as<std::uint16_t>(),
                          count["step"].as<std::uint16_t>(), agrees});
  }
  out.most_beside = rules["most_beside"].as<std::uint16_t>();
  return out;
}

constexpr std::pair<const char*, MatchOf> match_subjects[] = {
    {"id", MatchOf::id}, {"header", MatchOf::header}, {"payload", MatchOf::payload}, {"size", MatchOf::size}};

MatchTable read_tests(const Node& tests) {
  MatchTable out;
  for (const Node& test : tests.list()) {
    MatchTest one;
    one.of = meant_by(match_subjects, test["of"], "subject of a match");
    one.place = test["place"].as<std::uint8_t>();
    one.or_next = test["or_next"].as<bool>();
    one.is_one = test["is_one"].as<bool>();
    one.bytes = test["bytes"].as<std::uint8_t>();
    one.order = byte_order_of(test["order"]);
    one.shift = test["shift"].as<std::uint8_t>();
    one.at = test["at"].as<std::uint16_t>();
    one.mask = test["mask"].as<std::uint64_t>();
    one.low = test["low"].as<std::uint64_t>();
    one.high = test["high"].as<std::uint64_t>();
    out.tests.push_back(one);
    out.names.push_back(test["name"].text());
  }
  return out;
}

CheckAlgorithm read_algorithm(const Node& algorithm) {
  CheckAlgorithm out;
  out.kind = meant_by(check_kinds, algorithm["kind"], "kind of check");
  out.modulus = algorithm["modulus"].as<std::uint16_t>();
  out.negate = algorithm["negate"].as<bool>();
  out.width_bits = algorithm["width"].as<std::uint8_t>();
  out.reflect_in = algorithm["refin"].as<bool>();
  out.reflect_out = algorithm["refout"].as<bool>();
  out.poly = algorithm["poly"].as<std::uint64_t>();
  out.init = algorithm["init"].as<std::uint64_t>();
  out.xor_out = algorithm["xorout"].as<std::uint64_t>();
  out.unit = algorithm["unit"].as<std::uint8_t>();
  out.unit_is_little = byte_order_of(algorithm["unit_order"]) == ByteOrder::little;
  out.odd_tail = meant_by(odd_tails, algorithm["odd"], "rule for an incomplete word");
  out.end_around = algorithm["end_around"].as<bool>();
  out.plus = algorithm["plus"].as<std::uint64_t>();
  out.keep = algorithm["kept"].as<std::uint64_t>();
  out.bcd = algorithm["bcd"].as<bool>();
  for (const Node& values : algorithm["avoided"].list()) {
    out.avoided.at(out.avoided_count++) = {values[0].as<std::uint8_t>(), values[1].as<std::uint8_t>()};
  }
  out.avoided_plus = algorithm["avoided_plus"].as<std::uint8_t>();
  return out;
}

}  // namespace

ProtocolTable::ProtocolTable(const Node& protocol) : name_(protocol["name"].text()) {
  for (const Node& message : protocol["messages"].list()) {
    MessageTable table;
    table.name = message["name"].text();
    table.sender = message["sender"].text();
    table.min_payload = message["min_payload"].as<std::size_t>();
    table.max_payload = message["max_payload"].as<std::size_t>();
    table.fields = read_steps(message["steps"]);
    table.constants = read_constants(message["constants"]);
    messages_.push_back(std::move(table));
  }
}

int ProtocolTable::find(const std::string& name) const {
  for (std::size_t i = 0; i < messages_.size(); ++i) {
    if (messages_[i].name == name) return static_cast<int>(i);
  }
  return -1;
}

FormatTable::FormatTable(const Node& plan) {
  format_.framing = meant_by(framings, plan["framing"], "framing");
  format_.opening = read_mark(plan["opening"]);
  format_.closing = read_mark(plan["closing"]);
  format_.sends_opening = plan["sends_opening"].as<bool>();
  format_.stuffing = meant_by(stuffings, plan["stuffing"], "stuffing");
  const Node& escapes = plan["escapes"];
  if (!escapes.is_none()) {
    format_.escapes.escape = escapes["escape"].as<std::uint8_t>();
    format_.escapes.starts = plan["starts"].as<std::uint8_t>();
    format_.escapes.exclusive_or = escapes["exclusive_or"].as<std::uint8_t>();
    for (const Node& pair : escapes["pairs"].list()) {
      const std::size_t i = format_.escapes.count++;
      format_.escapes.plain.at(i) = pair[0].as<std::uint8_t>();
      format_.escapes.code.at(i) = pair[1].as<std::uint8_t>();
    }
  }
  format_.deliver_unknown = plan["deliver_unknown"].as<bool>();
  const Node& insertion = plan["insertion"];
  if (!insertion.is_none()) {
    for (const std::uint8_t byte : insertion["after"].bytes()) {
      format_.insertion.after.at(format_.insertion.size++) = byte;
    }
    format_.insertion.byte = insertion["byte"].as<std::uint8_t>();
  }
  format_.length_on_wire = plan["length_on_wire"].as<bool>();
  format_.skips_failed = plan["skips_failed"].as<bool>();
  format_.plain_front = plan["plain_front"].as<std::uint8_t>();
  format_.plain_back = plan["plain_back"].as<std::uint8_t>();
  format_.decimal_bytes = plan["decimal_bytes"].as<std::uint8_t>();
  format_.max_payload = plan["max_payload"].as<std::uint16_t>();
  format_.no_id = plan["no_id"].as<std::uint32_t>();
  format_.sequence_place = read_place(plan["sequence"]);
  format_.sequence_per_message = plan["sequence_per_message"].as<bool>();
  format_.peer_place = read_place(plan["peer"]);
  format_.own_forms = plan["own_forms"].as<std::uint8_t>();
  format_.form_count = 0;
  std::size_t exclusions = 0;
  for (const Node& form : plan["forms"].list()) {
    Form& one = format_.forms.at(format_.form_count++);
    one = read_form(form);
    one.first_exclusion = static_cast<std::uint8_t>(exclusions);
    for (const Node& exclusion : form["exclusions"].list()) {
      format_.exclusions.at(exclusions++) = read_exclusion(exclusion);
      ++one.exclusion_count;
    }
  }
  header_ = read_numbers(plan["header"]);
  for (const Node& algorithm : plan["algorithms"].list()) {
    format_.algorithms.at(format_.algorithm_count++) = read_algorithm(algorithm);
  }
  const bool matches = plan["matches"].as<bool>();
  const Node& id_place = plan["id_place"];
  if (!id_place.is_none()) id_place_ = id_place.as<int>();
  for (const Node& message : plan["messages"].list()) {
    if (matches || id_place_ >= 0) match_tables_.push_back(read_tests(message["tests"]));
    payload_tables_.push_back(read_rules(message["rules"]));
    rows_.push_back({message["id"].as<std::uint32_t>(),
                     {message["index"].as<std::int16_t>(), message["min_payload"].as<std::uint16_t>(),
                      message["max_payload"].as<std::uint16_t>(), message["seed"].as<std::uint8_t>()},
                     message["only_expected"].as<bool>(),
                     payload_tables_.back().rules(),
                     matches ? match_tables_.back().view() : MatchTests{}});
  }
  tables_ = std::make_unique<RuntimeTables>(format_, rows_.data(), rows_.size(), CrcMethod::automatic, matches,
                                            plan["matches_late"].as<bool>());
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
