// The rules of a payload's fields that need no value of a language.
#include "wirebond/engine/fields.hpp"

#include <cstdio>

namespace wirebond::engine {

namespace {

using Sentences = std::vector<std::string>;

void validate_all(const std::vector<FieldTable>& fields, std::size_t place, Walk& walk, const Path& path,
                  Sentences& out);

void add(Sentences& out, const Path& path, const std::string& fault) {
  if (!fault.empty()) out.push_back(path.text() + fault);
}

/// Check a list or string for which the payload promises more than it has, or more than the protocol allows.
void validate_promises(const FieldTable& field, const Counts& counts, std::size_t found, const Path& path,
                       Sentences& out) {
  for (const Counter& counter : field.counters) {
    const std::uint64_t told = counts.told(counter);
    const std::uint64_t step = counter.step;
    if (told == found * step) continue;
    const std::string limit = told % step != 0 ? "has " + std::to_string(step) + " for each element"
                              : told / step > field.max_count
                                  ? "has at most " + std::to_string(field.max_count * step)
                                  : "has " + std::to_string(found * step) + " in this payload";
    const Path counting{path.parent, counter.name};
    out.push_back(counting.text() + " says " + std::to_string(told) + unit_of(field, counter) + ", and " + path.text() +
                  " " + limit);
  }
}

/// Report a string without the byte that ends it. `most`: bytes among which it may come.
void add_missing_end(const FieldTable& field, std::size_t most, const Path& path, Sentences& out) {
  char end[8];
  std::snprintf(end, sizeof end, "0x%02X", static_cast<unsigned>(field.ends_with) & 0xFFu);
  add(out, path,
      std::string(" does not end with ") + end + " within " + std::to_string(most + 1) +
          (most == 0 ? " byte" : " bytes"));
}

void validate_string(const FieldTable& field, std::size_t place, const Counts& counts, Walk& walk, const Path& path,
                     Sentences& out) {
  const char* const at = reinterpret_cast<const char*>(walk.at(place));
  const std::size_t most = std::min<std::size_t>(walk.spare, field.max_count);
  const std::size_t size = field.count != 0 ? field.count : walk.string_size(field, place, counts.promised(field));
  validate_promises(field, counts, size, path, out);
  if (field.ends_with >= 0 && at[size] != static_cast<char>(field.ends_with)) add_missing_end(field, most, path, out);
  if (field.kind == FieldKind::text && !is_utf8(std::string_view(at, size))) add(out, path, " is not UTF-8");
}

void validate_characters(const FieldTable& field, std::size_t place, Walk& walk, const Path& path, Sentences& out) {
  const std::size_t most = std::min<std::size_t>(walk.spare, field.max_count);
  const Spelled found = read_characters(field, place, walk);
  if (!found.is_ended) {
    add_missing_end(field, most, path, out);
  } else if (!found.raw) {
    add(out, path,
        " is " + quoted(std::string_view(reinterpret_cast<const char*>(found.at), found.size)) + ", which is no " +
            std::to_string(field.width) + "-bit number in " + (field.digits->base == 16 ? "hex" : "decimal") +
            " digits");
  } else {
    add(out, path, fault_of(field, *found.raw));
  }
}

void validate_element(const FieldTable& field, std::size_t place, std::size_t index, Walk& walk, const Path& path,
                      Sentences& out) {
  if (field.kind == FieldKind::structure) {
    validate_all(field.fields, place + index * field.stride, walk, path, out);
  } else {
    add(out, path, fault_of(field, load_raw(field, walk.at(place), index)));
  }
}

void validate_all(const std::vector<FieldTable>& fields, std::size_t place, Walk& walk, const Path& path,
                  Sentences& out) {
  Counts counts;
  for (const FieldTable& field : fields) {
    const std::size_t here = place + field.at;
    if (field.counts) counts.tell(field, walk.at(here));
    const std::uint64_t promised = field.is_variable ? counts.promised(field) : 0;
    const Path own{&path, field.name};
    if (field.digits) {
      validate_characters(field, here, walk, own, out);
    } else if (field.is_string()) {
      validate_string(field, here, counts, walk, own, out);
    } else if (field.repeat == Repeat::listed) {
      const std::size_t found = walk.elements(field, here, promised, [&](std::size_t i, std::size_t at) {
        const Path element{&path, field.name, static_cast<std::ptrdiff_t>(i)};
        validate_element(field, at, 0, walk, element, out);
      });
      validate_promises(field, counts, found, own, out);
    } else if (field.repeat == Repeat::once) {
      validate_element(field, here, 0, walk, own, out);
    } else {
      for (std::uint32_t i = 0; i < field.count; ++i) {
        const Path element{&path, field.name, static_cast<std::ptrdiff_t>(i)};
        validate_element(field, here, i, walk, element, out);
      }
    }
  }
}

}  // namespace

std::vector<std::string> find_violations(const MessageTable& message, const std::uint8_t* payload, std::size_t size) {
  Sentences out;
  Walk walk{payload, size - message.min_payload};
  validate_all(message.fields, 0, walk, Path{nullptr, message.name}, out);
  return out;
}

void count_in(const FieldTable& field, std::vector<Count>& counts, std::size_t found, const Path& path, Build& build) {
  for (const Counter& counter : field.counters) {
    Count& count = counts[counter.slot];
    const std::uint64_t tells = found * counter.step;
    if (!count.number) {
      count.number = tells;
      store_raw(*count.field, build.payload.data() + count.at, 0, tells);
    }
    if (*count.number == tells) continue;
    const Path counting{path.parent, counter.name};
    throw MessageError(counting.text() + " is " + std::to_string(*count.number) + ", and " + path.text() +
                       ", which it counts, has " + std::to_string(tells) + unit_of(field, counter) +
                       (count.is_given ? "; leave " + counter.name + " out, it is counted" : ""));
  }
}

void check_string(const FieldTable& field, std::string_view data, const Path& path) {
  const std::size_t most = field.count != 0 ? field.count : field.max_count;
  if (data.size() > most) {
    throw MessageError(path.text() + " has " + std::to_string(data.size()) + " bytes; it holds at most " +
                       std::to_string(most));
  }
  const bool is_padded = field.kind == FieldKind::text && field.count != 0;
  if (field.ends_with >= 0 || is_padded) {
    const std::size_t end = data.find(static_cast<char>(is_padded ? 0 : field.ends_with));
    if (end != std::string_view::npos) {
      throw MessageError(path.text() + " would end at its byte " + std::to_string(end) +
                         (is_padded ? ", a zero, with which shorter texts are padded; leave that out"
                                    : ", which is the one that ends it on the wire; leave that out"));
    }
  }
  for (const std::string& mark : field.excludes) {
    const std::size_t at = data.find(mark);
    if (at != std::string_view::npos) {
      throw MessageError(path.text() + " has at its byte " + std::to_string(at) + " the bytes that " +
                         "end or begin a frame on the wire (" + hex_text(std::string_view(mark)) + "); leave them out");
    }
  }
}

void write_characters(const FieldTable& field, std::size_t place, std::uint64_t raw, Build& build) {
  const auto number = magnitude_of_raw(field, raw);
  const std::size_t size = field.count != 0 ? field.count : wirebond::detail::size_of_magnitude(*field.digits, number);
  if (field.count == 0) build.insert(place, size);
  wirebond::detail::write_magnitude(*field.digits, build.at(place), size, number);
  if (field.count != 0) return;
  build.shift += size;
  build.note_shift(field);
  if (field.ends_with >= 0) *build.at(place) = static_cast<std::uint8_t>(field.ends_with);
}

bool may_be_left_out(const FieldTable& field) {
  if (field.has_default || field.is_string() || field.slot >= 0) return true;
  if (field.kind != FieldKind::structure || field.repeat == Repeat::listed) return false;
  return std::all_of(field.fields.begin(), field.fields.end(), may_be_left_out);
}

void write_constants(const MessageTable& message, Build& build) {
  for (const PayloadConstant& constant : message.constants) {
    const std::size_t shift = constant.behind == 0 ? 0 : build.shifts[constant.behind - 1u];
    build.payload[constant.at + shift] |= constant.value;
  }
}

}  // namespace wirebond::engine
