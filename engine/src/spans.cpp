// A walk through a payload that notes where each value is.
#include "wirebond/engine/spans.hpp"

#include <cstddef>
#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "wirebond/engine/fields.hpp"
#include "wirebond/engine/node_values.hpp"
#include "wirebond/engine/walk.hpp"

namespace wirebond::engine {

namespace {

/// Return how many bytes the field has at least, all its elements included.
std::size_t least_bytes(const FieldTable& field) {
  if (field.is_characters()) return field.count != 0 ? field.count : static_cast<std::size_t>(field.ends_with >= 0);
  switch (field.repeat) {
    case Repeat::listed: return 0;
    case Repeat::packed: return (std::size_t{field.count} * field.width + 7) / 8;
    case Repeat::once: return field.stride;
    case Repeat::fixed: break;
  }
  return field.stride * field.count;
}

/// The values of one payload.
class Values {
 public:
  Values(const std::uint8_t* payload, std::size_t spare, std::vector<Span>& out) : walk_{payload, spare}, out_(out) {}

  void add(const std::vector<FieldTable>& fields, std::size_t place, const std::string& prefix, unsigned level) {
    Counts counts;
    for (const FieldTable& field : fields) {
      const std::size_t here = place + field.at;
      if (field.counts) counts.tell(field, walk_.at(here));
      const std::size_t index = out_.size();
      const std::size_t before = walk_.shift;
      out_.push_back({prefix + field.name, level, here + walk_.shift, 0});
      if (field.kind == FieldKind::structure) {
        add_elements(field, here, counts.promised(field), level);
      } else {
        static_cast<void>(decode_field<NodeValues>(field, here, field.is_variable ? counts.promised(field) : 0, walk_));
      }
      out_[index].size = least_bytes(field) + walk_.shift - before;
    }
  }

 private:
  void add_elements(const FieldTable& field, std::size_t here, std::uint64_t promised, unsigned level) {
    const std::string name = out_.back().name;
    if (field.repeat == Repeat::once) {
      add(field.fields, here, name + ".", level + 1);
      return;
    }
    const auto element = [&](std::size_t i, std::size_t at) {
      const std::string path = name + "[" + std::to_string(i) + "]";
      const std::size_t index = out_.size();
      const std::size_t before = walk_.shift;
      out_.push_back({path, level + 1, at + walk_.shift, 0});
      add(field.fields, at, path + ".", level + 2);
      out_[index].size = field.stride + walk_.shift - before;
    };
    if (field.repeat == Repeat::listed) {
      walk_.elements(field, here, promised, element);
      return;
    }
    for (std::size_t i = 0; i < field.count; ++i) element(i, here + i * field.stride);
  }

  Walk walk_;
  std::vector<Span>& out_;
};

}  // namespace

std::optional<Place> payload_on_wire(const Batch& batch, const Event& event) {
  const FrameFormat& format = batch.format->format();
  if (format.stuffing != Stuffing::none) return std::nullopt;
  const Form& form = format.forms[event.form];
  const std::uint8_t* const wire = batch.bytes.data() + event.wire_at;
  const std::uint8_t* const end = wire + event.wire_size;
  Place place{form.prefix, event.wire_size - form.prefix - form.suffix};
  if (!has_marks(format)) return place;
  const Mark& opening = format.opening;
  const Mark& closing = format.closing;
  if (opening.stands_at(wire, event.wire_size)) {
    place.at += opening.size;
    place.size -= opening.size;
  }
  if (closing.stands_at(end - closing.size, closing.size)) place.size -= closing.size;
  return place;
}

std::vector<Span> spans_of(const Batch& batch, const Event& event) {
  std::vector<Span> out;
  if (event.message < 0) return out;
  const MessageTable& message = batch.protocol->messages()[static_cast<std::size_t>(event.message)];
  Values(batch.bytes.data() + event.payload_at, event.payload_size - message.min_payload, out)
      .add(message.fields, 0, "", 1);
  return out;
}

}  // namespace wirebond::engine
