// Header values and the choice of a form, with a sentence for each refusal of the core.
#include "wirebond/engine/header.hpp"

#include <algorithm>
#include <cstdio>
#include <string>

#include "wirebond/encoder.hpp"
#include "wirebond/engine/element.hpp"
#include "wirebond/engine/errors.hpp"

namespace wirebond::engine {

namespace {

/// How the forms of a frame fit a message and header values.
struct Answer {
  std::vector<std::size_t> forms;  ///< those that can carry it unless the payload's size prevents that
  bool agreed = false;             ///< the header values allow one
  bool id_differs = false;         ///< one of those has an id but the message has none, or the other way round
  std::int64_t most_id = -1;       ///< maximum id that fits in them
};

Answer ask_forms(const FrameFormat& format, std::uint32_t id, std::size_t payload, const GivenHeader& header,
                 int wanted) {
  Answer answer;
  for (std::size_t i = 0; i < format.form_count; ++i) {
    const Form& form = format.forms[i];
    if (wanted >= 0 && i != static_cast<std::size_t>(wanted)) continue;
    if (!agrees(form, header.view())) continue;
    answer.agreed = true;
    if (form.id.present()) answer.most_id = std::max(answer.most_id, form.id.most());
    if (format.no_id != 0 && form.id.present() == (id == format.no_id)) {
      answer.id_differs = true;
    } else if (carries_id(format, form, id) && !is_excluded(format, form, id, payload, header.values.data())) {
      answer.forms.push_back(i);
    }
  }
  return answer;
}

/// Return why none of these forms can carry the payload.
std::string refusal(const FormatTable& format, const MessageTable& message, std::size_t payload,
                    const std::vector<std::size_t>& forms) {
  const std::size_t bound = format.format().max_payload;
  const Form& form = format.format().forms[forms.front()];
  if (payload + form.prefix + form.suffix == 0) {
    return message.name + " is empty, and so is its frame: a receiver would not notice it";
  }
  const std::string begin = "payload of " + message.name + " has " + std::to_string(payload) + " bytes";
  if (payload > bound) return begin + "; this frame carries at most " + std::to_string(bound);
  std::int64_t most = 0;
  for (const std::size_t index : forms) most = std::max(most, most_payload(format.format().forms[index]));
  if (static_cast<std::int64_t>(payload) > most) {
    return begin + "; with this header the frame's length can express at most " + std::to_string(most);
  }
  for (const std::size_t index : forms) {
    const Form& one = format.format().forms[index];
    if (one.payload_unit > 1 && (one.trims_zeros || payload % one.payload_unit != one.payload_rest)) {
      return begin + ", and with them the frame's check has no whole number of words of " +
             std::to_string(one.payload_unit) + " bytes, which it refuses";
    }
  }
  return begin + ", which the frame's length cannot express: it counts by " + std::to_string(form.length_unit);
}

std::string number_text(std::uint64_t number) {
  char text[40];
  std::snprintf(text, sizeof text, "%llu (0x%02llX)", static_cast<unsigned long long>(number),
                static_cast<unsigned long long>(number));
  return text;
}

/// Describe the values that a group of tests allows: those from `first` to the one without `or_next`.
std::string allowed_text(const std::vector<MatchTest>& tests, std::size_t first) {
  std::string text;
  for (std::size_t i = first;; ++i) {
    const MatchTest& test = tests[i];
    text += (i == first ? "" : ", ") + number_text(test.low);
    if (test.high != test.low) text += " to " + number_text(test.high);
    if (!test.or_next) break;
  }
  return text;
}

/// Read the number that a test uses, of the payload to send. Returns false if the payload has none there.
bool sent_number(const MatchTest& test, const std::vector<std::uint8_t>& payload, std::uint64_t& number) {
  number = payload.size();
  return test.of == MatchOf::size || detail::payload_number(payload.data(), payload.size(), false, test.at, test.bytes,
                                                            test.order, test.shift, number);
}

/// Set the header values of the message's frames where their defaults differ, and check the given ones. Returns the id
/// to send.
std::uint32_t settle_match(const FormatTable& format, const MessageTable& message, std::size_t index,
                           const std::vector<std::uint8_t>& payload, GivenHeader& header) {
  std::uint32_t id = format.id_of(index);
  const MatchTable* const match = format.match_of(index);
  const std::uint32_t no_id = format.format().no_id;
  const auto id_place = static_cast<std::size_t>(format.id_place());
  const bool has_ids = format.id_place() >= 0 && (no_id == 0 || id != no_id);
  for (std::size_t first = 0; match != nullptr && first < match->tests.size(); ++first) {
    const std::size_t begin = first;
    const MatchTest& test = match->tests[begin];
    while (match->tests[first].or_next) ++first;
    const auto allows = [&](std::uint64_t number) {
      for (std::size_t i = begin; i <= first; ++i) {
        if (match->tests[i].allows(number)) return true;
      }
      return false;
    };
    if (test.of == MatchOf::payload || test.of == MatchOf::size) {
      std::uint64_t number = 0;
      const bool is_there = sent_number(test, payload, number);
      if (is_there && allows(number)) continue;
      const std::string what =
          test.of == MatchOf::size
              ? "the payload of " + message.name + " has " + std::to_string(payload.size()) + " bytes"
              : message.name + "." + match->names[begin] + " is " + number_text((number & test.mask));
      throw MessageError(what + "; its frames are identified by " + allowed_text(match->tests, begin) + " there");
    }
    if (test.of == MatchOf::id && !has_ids) continue;
    const std::size_t place = test.of == MatchOf::id ? id_place : test.place;
    std::uint64_t& value = header.values[place];
    if (!allows(value)) {
      if ((header.given >> place & 1u) != 0) {
        throw MessageError("header." + format.header()[place].name + " is " + number_text(value) + "; frames of " +
                           message.name + " have " + allowed_text(match->tests, begin) +
                           (test.is_one ? ", which is sent by itself: leave it out" : ""));
      }
      value = (value & ~test.mask) | test.low;
    }
    header.given |= std::uint32_t{1} << place;
    if (test.of == MatchOf::id) id = static_cast<std::uint32_t>(value);
  }
  return id;
}

[[noreturn]] void refuse_header(const FormatTable& format, const MessageTable& message, const GivenHeader& header,
                                std::uint32_t id, std::size_t payload, const Answer& answer) {
  if (answer.id_differs) {
    const bool has_id = id != format.format().no_id;
    throw MessageError(message.name + (has_id ? " has the id " + std::to_string(id) : " has no id") +
                       ", and a frame with these header values has " + (has_id ? "none" : "one") +
                       "; give header values that ask for " + (has_id ? "one" : "none") +
                       ", or take another `when` for the id in the protocol file");
  }
  if (answer.most_id >= 0 && id > answer.most_id) {
    throw MessageError(message.name + " has the id " + number_text(id) +
                       ", and a frame with these header values has room for ids up to " +
                       std::to_string(answer.most_id) + "; give header values that ask for a wider one");
  }
  if (answer.agreed) {
    throw MessageError("no form of the frame carries " + message.name + " with " + std::to_string(payload) +
                       " payload bytes and these header values; see the conditions (`when`) in the protocol file");
  }
  std::string names;
  for (std::size_t i = 0; i < format.header().size(); ++i) {
    if (((header.given >> i) & 1u) == 0) continue;
    const std::string& name = format.header()[i].name;
    names += (names.empty() ? "" : ", ") + name + (name == "magic" ? " " + number_text(header.values[i]) : "");
  }
  throw MessageError("no form of the frame has the header fields " + names +
                     " together; see the magics and the conditions (`when`) in the protocol file");
}

}  // namespace

void add_header_violations(const FormatTable& format, std::size_t form, const std::uint64_t* bits,
                           std::vector<std::string>& out) {
  const Form& shape = format.format().forms[form];
  for (std::size_t i = 0; i < shape.header_count; ++i) {
    const FieldTable& field = format.header()[shape.header[i].place];
    const std::string fault = fault_of(field, bits[i]);
    if (!fault.empty()) out.push_back("header." + field.name + fault);
  }
}

GivenHeader default_header(const FormatTable& format) {
  GivenHeader out;
  for (std::size_t i = format.format().form_count; i-- > 0;) {  // the first form, sent by default, has precedence
    const Form& form = format.format().forms[i];
    for (std::size_t j = 0; j < form.header_count; ++j) out.values[form.header[j].place] = form.header[j].default_value;
  }
  return out;
}

std::vector<std::uint8_t> seal_frame(const FormatTable& format, const ProtocolTable& protocol, std::size_t index,
                                     const std::vector<std::uint8_t>& payload, const GivenHeader& asked, int form) {
  const FrameFormat& shape = format.format();
  const RuntimeSource source = format.source();
  GivenHeader header = asked;
  const std::uint32_t id = settle_match(format, protocol.messages()[index], index, payload, header);
  std::vector<std::uint8_t> buffer;
  std::size_t size = 0;
  const auto seal_in = [&](std::size_t number) {
    const std::size_t lead = payload_lead(source, number);
    buffer.resize(lead + payload.size() + max_wire_bytes(shape));
    std::copy(payload.begin(), payload.end(), buffer.begin() + static_cast<std::ptrdiff_t>(lead));
    size = seal(source, buffer.data(), buffer.size(), id, payload.size(), number, header.values.data());
  };
  if (form >= 0) {
    const Form& one = shape.forms[static_cast<std::size_t>(form)];
    if (agrees(one, header.view()) && carries_id(shape, one, id) && carries(one, payload.size()) &&
        !is_excluded(shape, one, id, payload.size(), header.values.data())) {
      seal_in(static_cast<std::size_t>(form));
    }
  } else {
    detail::with_own_form(source, id, payload.size(), seal_in, header.view());
  }
  if (size != 0) {
    buffer.resize(size);
    return buffer;
  }
  const MessageTable& message = protocol.messages()[index];
  const Answer answer = ask_forms(shape, id, payload.size(), header, form);
  if (answer.forms.empty()) refuse_header(format, message, header, id, payload.size(), answer);
  throw MessageError(refusal(format, message, payload.size(), answer.forms));
}

}  // namespace wirebond::engine
