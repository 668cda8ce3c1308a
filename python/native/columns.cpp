// A whole capture to numpy columns, without a Python object per message.
#include "columns.hpp"

#include <nanobind/ndarray.h>

#include <algorithm>
#include <cstring>
#include <vector>

#include "decoder.hpp"
#include "fields.hpp"

namespace wirebond::engine {

namespace {

/// Payloads of one message, packed one behind the other.
struct Rows {
  std::vector<std::uint64_t> offsets;
  std::vector<std::uint32_t> ids;                ///< unknown frames only
  std::vector<std::uint8_t> payloads;            ///< min_payload bytes a row
  std::vector<std::vector<std::uint8_t>> tails;  ///< the rest, for messages that end in a string without fixed size
};

template <class T>
nb::object make_array(std::vector<T>&& values, std::size_t rows, const FieldTable* field) {
  auto* const owned = new std::vector<T>(std::move(values));
  const nb::capsule owner(owned, [](void* p) noexcept { delete static_cast<std::vector<T>*>(p); });
  if (field != nullptr && field->is_array) {
    const std::size_t shape[2] = {rows, field->count};
    return nb::cast(nb::ndarray<nb::numpy, T>(owned->data(), 2, shape, owner));
  }
  const std::size_t shape[1] = {rows};
  return nb::cast(nb::ndarray<nb::numpy, T>(owned->data(), 1, shape, owner));
}

template <class T, class Read>
nb::object column_of(const FieldTable& field, const Rows& rows, std::size_t stride, Read read) {
  const std::size_t count = rows.offsets.size();
  std::vector<T> out;
  out.reserve(count * field.count);
  const std::uint8_t* row = rows.payloads.data() + field.at;
  for (std::size_t i = 0; i < count; ++i, row += stride) {
    for (std::uint32_t element = 0; element < field.count; ++element) {
      out.push_back(static_cast<T>(read(row + static_cast<std::size_t>(element) * field.size)));
    }
  }
  return make_array(std::move(out), count, &field);
}

nb::object number_column(const FieldTable& field, const Rows& rows, std::size_t stride) {
  const auto raw = [&](const std::uint8_t* at) { return load_bytes(at, field.size, field.order); };
  const auto two = [&](const std::uint8_t* at) { return load_signed(field, at); };
  const auto scale = [&](double wire) { return wire * field.numerator / field.denominator + field.offset; };
  switch (field.kind) {
    case FieldKind::boolean:
      return column_of<std::uint8_t>(field, rows, stride, [&](const std::uint8_t* at) { return raw(at) != 0 ? 1 : 0; })
          .attr("view")("bool");
    case FieldKind::floating:
      if (field.scaled) {
        return column_of<double>(field, rows, stride,
                                 [&](const std::uint8_t* at) { return scale(load_float(field, at)); });
      }
      if (field.size == 4) {
        return column_of<float>(field, rows, stride, [&](const std::uint8_t* at) { return load_float(field, at); });
      }
      return column_of<double>(field, rows, stride, [&](const std::uint8_t* at) { return load_float(field, at); });
    case FieldKind::unsigned_integer:
      if (field.scaled) {
        return column_of<double>(field, rows, stride,
                                 [&](const std::uint8_t* at) { return scale(static_cast<double>(raw(at))); });
      }
      if (field.size == 1) return column_of<std::uint8_t>(field, rows, stride, raw);
      if (field.size == 2) return column_of<std::uint16_t>(field, rows, stride, raw);
      if (field.size <= 4) return column_of<std::uint32_t>(field, rows, stride, raw);
      return column_of<std::uint64_t>(field, rows, stride, raw);
    default:
      if (field.scaled) {
        return column_of<double>(field, rows, stride,
                                 [&](const std::uint8_t* at) { return scale(static_cast<double>(two(at))); });
      }
      if (field.size == 1) return column_of<std::int8_t>(field, rows, stride, two);
      if (field.size == 2) return column_of<std::int16_t>(field, rows, stride, two);
      if (field.size <= 4) return column_of<std::int32_t>(field, rows, stride, two);
      return column_of<std::int64_t>(field, rows, stride, two);
  }
}

nb::object string_column(const MessageTable& message, const FieldTable& field, const Rows& rows) {
  nb::list out;
  std::vector<std::uint8_t> payload;
  for (std::size_t i = 0; i < rows.offsets.size(); ++i) {
    const auto* const row = rows.payloads.data() + i * message.min_payload;
    payload.assign(row, row + message.min_payload);
    if (!rows.tails.empty()) payload.insert(payload.end(), rows.tails[i].begin(), rows.tails[i].end());
    out.append(decode_fields(message, payload.data(), payload.size())[field.key]);
  }
  return out;
}

}  // namespace

nb::dict decode_columns(const std::shared_ptr<const ProtocolTable>& protocol, const FormatTable& format,
                        nb::handle capture) {
  const BufferView view(capture);
  std::vector<Rows> tables(protocol->messages().size());
  Rows unknown;
  std::vector<std::uint8_t> workspace(workspace_bytes(format.format()));
  HostDeframer deframer(format.source(), workspace.data(), 0);
  const auto sink = [&](const Frame& frame) {
    if (frame.message < 0) {
      unknown.offsets.push_back(frame.offset);
      unknown.ids.push_back(frame.id);
      return;
    }
    const auto index = static_cast<std::size_t>(frame.message);
    const MessageTable& message = protocol->messages()[index];
    Rows& rows = tables[index];
    rows.offsets.push_back(frame.offset);
    const std::size_t sent = std::min(frame.payload_size, message.min_payload);  // less: zeros were trimmed
    rows.payloads.insert(rows.payloads.end(), frame.payload, frame.payload + sent);
    rows.payloads.insert(rows.payloads.end(), message.min_payload - sent, 0);
    if (message.max_payload != message.min_payload) {
      rows.tails.emplace_back(frame.payload + sent, frame.payload + frame.payload_size);
    }
  };
  {
    const nb::gil_scoped_release release;  // the capture is held by its buffer view
    deframer.feed(view.data(), view.size(), 0, sink);
    deframer.give_up(sink);
  }

  std::vector<std::uint64_t> counts;
  nb::dict messages;
  for (std::size_t i = 0; i < tables.size(); ++i) {
    const MessageTable& message = protocol->messages()[i];
    Rows& rows = tables[i];
    counts.push_back(rows.offsets.size());
    if (rows.offsets.empty()) continue;
    nb::dict fields;
    for (const FieldTable& field : message.fields) {
      const bool is_string = field.kind == FieldKind::text || field.kind == FieldKind::bytes;
      fields[field.key] =
          is_string ? string_column(message, field, rows) : number_column(field, rows, message.min_payload);
    }
    nb::dict table;
    const std::size_t count = rows.offsets.size();
    table["fields"] = fields;
    table["offset"] = make_array(std::move(rows.offsets), count, nullptr);
    messages[message.key] = table;
  }
  if (!unknown.offsets.empty()) {
    const std::size_t count = unknown.offsets.size();
    nb::dict fields;
    fields["id"] = make_array(std::move(unknown.ids), count, nullptr);
    nb::dict table;
    table["fields"] = fields;
    table["offset"] = make_array(std::move(unknown.offsets), count, nullptr);
    messages["unknown"] = table;
  }
  nb::dict out;
  out["messages"] = messages;
  out["stats"] = account_dict(deframer, *protocol, counts);
  return out;
}

}  // namespace wirebond::engine
