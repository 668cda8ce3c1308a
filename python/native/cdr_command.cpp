// Converts bytes (CDR) of a ROS 2 topic to the frame of a command, with a plan made once from the mapping.
#include "cdr_command.hpp"

#include <nanobind/stl/string.h>

#include <algorithm>
#include <cmath>
#include <cstring>

#include "python_values.hpp"

namespace wirebond::engine {

namespace {

constexpr std::size_t encapsulation_bytes = 4;
constexpr double exact_integers = 9007199254740992.0;  // 2^53: a double distinguishes all integers up to here

std::size_t size_of(char code) {
  switch (code) {
    case '?':
    case 'b':
    case 'B': return 1;
    case 'h':
    case 'H': return 2;
    case 'i':
    case 'I':
    case 'f': return 4;
    default: return 8;
  }
}

nb::object number_of(char code, std::uint64_t raw) {
  const unsigned bits = static_cast<unsigned>(8 * size_of(code));
  switch (code) {
    case '?': return nb::borrow(raw != 0 ? Py_True : Py_False);
    case 'f': {
      const auto low = static_cast<std::uint32_t>(raw);
      float value;
      std::memcpy(&value, &low, sizeof value);
      return steal(PyFloat_FromDouble(static_cast<double>(value)));
    }
    case 'd': {
      double value;
      std::memcpy(&value, &raw, sizeof value);
      return steal(PyFloat_FromDouble(value));
    }
    case 'b':
    case 'h':
    case 'i':
    case 'q': return steal(PyLong_FromLongLong(from_twos_complement(raw, bits)));
    default: return steal(PyLong_FromUnsignedLongLong(raw));
  }
}

}  // namespace

/// Walks through the bytes of one message, whose lengths are unchecked. Every step returns false at their end.
class CdrCommand::Walk {
 public:
  Walk(const std::uint8_t* data, std::size_t size, ByteOrder order, std::vector<nb::object>& slots)
      : data_(data), size_(size), order_(order), slots_(slots) {}

  bool all(const std::vector<Part>& parts) {
    for (const Part& part : parts) {
      if (!(part.times == Times::one ? one(part) : several(part))) return false;
    }
    return true;
  }

 private:
  std::size_t left() const { return size_ - at_; }

  bool align(std::size_t size) {
    const std::size_t padding = (size - at_ % size) % size;
    if (padding > left()) return false;
    at_ += padding;
    return true;
  }

  bool count(std::uint32_t& out) {
    if (!align(4) || left() < 4) return false;
    out = static_cast<std::uint32_t>(load_bytes(data_ + at_, 4, order_));
    at_ += 4;
    return true;
  }

  bool one(const Part& part) {
    if (part.code == 0) return all(part.inside);
    return part.code == 's' ? text(part) : numbers(part, 1);
  }

  /// Skip numbers whose places are known without reading each.
  bool numbers(const Part& part, std::size_t count) {
    const std::size_t size = size_of(part.code);
    if (!align(size) || left() / size < count) return false;
    if (part.slot >= 0) keep(part, at_);
    for (const auto& [index, picked] : part.picked) keep(picked, at_ + index * size);
    at_ += count * size;
    return true;
  }

  void keep(const Part& part, std::size_t at) {
    slots_[static_cast<std::size_t>(part.slot)] =
        number_of(part.code, load_bytes(data_ + at, static_cast<std::uint8_t>(size_of(part.code)), order_));
  }

  bool text(const Part& part) {
    std::uint32_t size = 0;
    if (!count(size) || size > left()) return false;
    const auto length = static_cast<Py_ssize_t>(std::max<std::uint32_t>(size, 1) - 1);
    nb::object found = nb::steal(PyUnicode_DecodeUTF8(reinterpret_cast<const char*>(data_ + at_), length, nullptr));
    if (!found.is_valid()) {
      PyErr_Clear();
      return false;
    }
    if (part.slot >= 0) slots_[static_cast<std::size_t>(part.slot)] = std::move(found);
    at_ += size;
    return true;
  }

  bool several(const Part& part) {
    std::uint32_t number = part.count;
    if (part.times == Times::sequence && !count(number)) return false;
    if (number > left()) return false;  // an element has at least one byte
    if (!part.picked.empty() && part.picked.back().first >= number) return false;
    if (part.code != 0 && part.code != 's') return number == 0 || numbers(part, number);
    auto picked = part.picked.begin();
    for (std::uint32_t index = 0; index < number; ++index) {
      const bool is_picked = picked != part.picked.end() && picked->first == index;
      if (!one(is_picked ? (picked++)->second : part)) return false;
    }
    return true;
  }

  const std::uint8_t* data_;
  std::size_t size_;
  ByteOrder order_;
  std::vector<nb::object>& slots_;
  std::size_t at_ = 0;
};

CdrCommand::Part CdrCommand::read_part(nb::handle part) {
  Part out;
  const std::string kind = nb::cast<std::string>(nb::str(part.attr("kind")));
  out.times = kind == "one" ? Times::one : kind == "array" ? Times::array : Times::sequence;
  const std::string code = nb::cast<std::string>(part.attr("code"));
  out.code = code.empty() ? '\0' : code[0];
  out.count = nb::cast<std::uint32_t>(part.attr("count"));
  out.slot = nb::cast<int>(part.attr("slot"));
  for (nb::handle each : part.attr("inside")) out.inside.push_back(read_part(each));
  for (nb::handle each : part.attr("picked")) {
    const auto pair = nb::cast<nb::tuple>(each);
    out.picked.emplace_back(nb::cast<std::uint32_t>(nb::object(pair[0])), read_part(nb::object(pair[1])));
  }
  return out;
}

std::unique_ptr<CdrCommand> CdrCommand::make(std::shared_ptr<const ProtocolTable> protocol,
                                             std::shared_ptr<const FormatTable> format, nb::handle plan,
                                             nb::dict bounds) {
  auto command = std::make_unique<CdrCommand>();
  const int message = protocol->find(nb::cast<std::string>(plan.attr("message")));
  if (message < 0) return nullptr;
  command->message_ = static_cast<std::size_t>(message);
  for (nb::handle part : plan.attr("parts")) command->parts_.push_back(read_part(part));
  for (nb::handle each : plan.attr("values")) {
    Value value;
    value.name = each.attr("name");
    value.slot = nb::cast<std::size_t>(each.attr("slot"));
    value.scale = nb::cast<double>(each.attr("scale"));
    value.offset = nb::cast<double>(each.attr("offset"));
    value.is_linear = value.scale != 1.0 || value.offset != 0.0;
    value.has_bounds = bounds.contains(value.name);
    if (value.has_bounds) {
      const auto pair = nb::cast<nb::tuple>(bounds[value.name]);
      value.least = nb::cast<double>(nb::float_(nb::object(pair[0])));
      value.greatest = nb::cast<double>(nb::float_(nb::object(pair[1])));
    }
    command->slots_ = std::max(command->slots_, value.slot + 1);
    command->values_.push_back(std::move(value));
  }
  command->constants_ = nb::cast<nb::dict>(nb::object(plan.attr("constants")));
  command->header_ = default_header(*format);
  command->protocol_ = std::move(protocol);
  command->format_ = std::move(format);
  return command;
}

/// Return the value for the message's field; invalid if it is not finite, out of its range, or too large to compare.
nb::object CdrCommand::fitting(const Value& value, const nb::object& found) {
  if (PyUnicode_Check(found.ptr())) return found;
  if (!value.has_bounds) return {};
  const double number = PyFloat_AsDouble(found.ptr());
  if (!value.is_linear) {
    const bool is_exact = PyFloat_Check(found.ptr()) || std::fabs(number) <= exact_integers;
    return is_exact && number >= value.least && number <= value.greatest ? found : nb::object();
  }
  const double scaled = number * value.scale;
  const double given = scaled + value.offset;
  return given >= value.least && given <= value.greatest ? nb::object(nb::float_(given)) : nb::object();
}

nb::list CdrCommand::frames(nb::list messages, std::size_t first) const {
  nb::list out;
  for (; first < messages.size(); ++first) {
    const nb::object found = frame(nb::cast<nb::bytes>(messages[first]));
    if (!found.is_valid()) break;
    out.append(found);
  }
  return out;
}

nb::object CdrCommand::frame(nb::bytes data) const {
  const auto* const bytes = static_cast<const std::uint8_t*>(data.data());
  if (data.size() < encapsulation_bytes || bytes[0] != 0 || bytes[1] > 1) return {};
  std::vector<nb::object> slots(slots_);
  Walk walk(bytes + encapsulation_bytes, data.size() - encapsulation_bytes,
            bytes[1] == 1 ? ByteOrder::little : ByteOrder::big, slots);
  if (!walk.all(parts_)) return {};
  nb::dict fields = nb::steal<nb::dict>(steal(PyDict_Copy(constants_.ptr())).release());
  for (const Value& value : values_) {
    const nb::object given = fitting(value, slots[value.slot]);
    if (!given.is_valid()) return {};
    fields[value.name] = given;
  }
  try {
    const std::vector<std::uint8_t> wire = seal_frame(
        *format_, *protocol_, message_, encode_fields<PythonValues>(protocol_->messages()[message_], fields), header_);
    return nb::bytes(reinterpret_cast<const char*>(wire.data()), wire.size());
  } catch (const MessageError&) {  // Python reports why
    return {};
  } catch (nb::python_error& error) {
    if (!error.matches(PyExc_Exception)) throw;
    return {};
  }
}

}  // namespace wirebond::engine
