// Received payloads by message, one after the other.
#include "wirebond/engine/rows.hpp"

#include <algorithm>
#include <utility>

namespace wirebond::engine {

namespace {

void take_header(const FormatTable& format, const Frame& frame, Rows& rows) {
  if (format.header().empty()) return;
  const std::size_t begin = rows.header.size();
  rows.header.resize(begin + format.header().size());
  const Form& form = format.format().forms[frame.form];
  for (std::size_t i = 0; i < form.header_count; ++i) {
    rows.header[begin + form.header[i].place] = detail::read_wide(form.header[i].number, frame.bytes, frame.size);
  }
}

}  // namespace

std::size_t row_bytes(const MessageTable& message) {
  return message.max_payload != message.min_payload ? 0 : message.min_payload;
}

Rows& rows_for(Capture& capture, const Frame& frame) {
  return frame.message < 0 ? capture.unknown : capture.messages[static_cast<std::size_t>(frame.message)];
}

void take_row(const ProtocolTable& protocol, const FormatTable& format, const Frame& frame, std::uint64_t offset,
              const double* time, Capture& to) {
  SeenNumber seen;
  if (see_number(format.format(), frame, seen)) to.numbers.push_back(seen);
  Rows& rows = rows_for(to, frame);
  rows.offsets.push_back(offset);
  if (time != nullptr) rows.times.push_back(*time);
  take_header(format, frame, rows);
  if (frame.message < 0) {
    rows.ids.push_back(frame.id);
    return;
  }
  const MessageTable& message = protocol.messages()[static_cast<std::size_t>(frame.message)];
  const std::size_t sent = frame.payload_size;
  const bool varies = row_bytes(message) == 0;
  const std::size_t kept = varies ? std::max(sent, message.min_payload) : message.min_payload;
  rows.payloads.insert(rows.payloads.end(), frame.payload, frame.payload + std::min(sent, kept));
  if (sent < kept) rows.payloads.insert(rows.payloads.end(), kept - sent, 0);  // restore trimmed zeros
  if (varies) rows.ends.push_back(rows.payloads.size());
}

void Rows::append(Rows&& other, std::size_t first, std::size_t row_bytes, std::size_t header_fields) {
  if (offsets.empty() && first == 0) {
    *this = std::move(other);
    return;
  }
  const auto from = static_cast<std::ptrdiff_t>(first);
  offsets.insert(offsets.end(), other.offsets.begin() + from, other.offsets.end());
  const auto of_header = static_cast<std::ptrdiff_t>(first * header_fields);
  header.insert(header.end(), other.header.begin() + of_header, other.header.end());
  if (!other.ids.empty()) ids.insert(ids.end(), other.ids.begin() + from, other.ids.end());
  const std::size_t skipped = row_bytes != 0 || other.ends.empty() ? first * row_bytes : other.begin_of(first);
  for (std::size_t row = first; row < other.ends.size(); ++row) {
    ends.push_back(payloads.size() + other.ends[row] - skipped);
  }
  payloads.insert(payloads.end(), other.payloads.begin() + static_cast<std::ptrdiff_t>(skipped), other.payloads.end());
}

}  // namespace wirebond::engine
