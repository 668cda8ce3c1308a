// Received frames as they were, until a language asks for their values.
#include "wirebond/engine/batch.hpp"

namespace wirebond::engine {

Event record(const Frame& frame, double time, Batch& batch) {
  std::vector<std::uint8_t>& bytes = batch.bytes;
  Event event;
  event.wire_at = static_cast<std::uint32_t>(bytes.size());
  event.wire_size = static_cast<std::uint32_t>(frame.wire_size);
  bytes.insert(bytes.end(), frame.wire, frame.wire + frame.wire_size);
  event.payload_size = static_cast<std::uint32_t>(frame.payload_size);
  const Form& form = batch.format->format().forms[frame.form];
  std::size_t padding = 0;
  if (form.trims_zeros && frame.message >= 0) {
    const std::size_t whole = batch.protocol->messages()[static_cast<std::size_t>(frame.message)].min_payload;
    padding = whole > frame.payload_size ? whole - frame.payload_size : 0;
  }
  const bool in_place = frame.payload >= frame.wire && frame.payload < frame.wire + frame.wire_size && padding == 0;
  if (in_place) {
    event.payload_at = event.wire_at + static_cast<std::uint32_t>(frame.payload - frame.wire);
  } else {  // unstuffed elsewhere, or zeros to restore
    event.payload_at = static_cast<std::uint32_t>(bytes.size());
    bytes.insert(bytes.end(), frame.payload, frame.payload + frame.payload_size);
    bytes.insert(bytes.end(), padding, 0);
    event.payload_size += static_cast<std::uint32_t>(padding);
  }
  event.form = frame.form;
  event.header_at = static_cast<std::uint32_t>(batch.headers.size());
  for (std::size_t i = 0; i < form.header_count; ++i) {
    batch.headers.push_back(detail::read_wide(form.header[i].number, frame.bytes, frame.size));
  }
  event.id = frame.id;
  event.message = frame.message;
  event.offset = frame.offset;
  event.time = time;
  return event;
}

}  // namespace wirebond::engine
