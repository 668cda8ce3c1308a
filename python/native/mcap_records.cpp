// Message records of an MCAP file in bulk: finds and makes them. Knows no channel's meaning; trusts no length.
#include "mcap_records.hpp"

#include <algorithm>
#include <cstdint>
#include <cstring>
#include <stdexcept>
#include <vector>

#include "decoder.hpp"
#include "wirebond/bytes.hpp"

namespace wirebond::engine {

namespace {

// MCAP, "Records": an opcode, a length of eight bytes, and that many bytes. Those of a message begin with channel,
// sequence number, log time and publish time. Numbers are little-endian.
constexpr std::uint8_t message_opcode = 0x05;
constexpr std::size_t record_head = 9;
constexpr std::size_t message_head = 2 + 4 + 8 + 8;
constexpr std::size_t most_records = 1'000'000;

template <unsigned Size>
std::uint64_t little(const std::uint8_t* at) {
  return load_bytes<Size, ByteOrder::little>(at);
}

template <class T>
nb::bytes bytes_of(const std::vector<T>& values) {
  return nb::bytes(reinterpret_cast<const char*>(values.data()), values.size() * sizeof(T));
}

}  // namespace

nb::tuple message_records(nb::handle buffer, std::size_t at, std::size_t end) {
  const BufferView view(buffer);
  end = std::min(end, view.size());
  std::vector<std::uint16_t> channels;
  std::vector<std::uint64_t> logged;
  std::vector<std::uint64_t> published;
  std::vector<std::uint64_t> places;
  std::vector<std::uint32_t> sizes;
  while (at < end && end - at >= record_head + message_head && channels.size() < most_records) {
    const std::uint8_t* const record = view.data() + at;
    const std::uint64_t size = little<8>(record + 1);
    if (record[0] != message_opcode || size < message_head || size > end - at - record_head) break;
    if (size - message_head > UINT32_MAX) break;
    channels.push_back(static_cast<std::uint16_t>(little<2>(record + record_head)));
    logged.push_back(little<8>(record + record_head + 6));
    published.push_back(little<8>(record + record_head + 14));
    places.push_back(at + record_head + message_head);
    sizes.push_back(static_cast<std::uint32_t>(size - message_head));
    at += record_head + static_cast<std::size_t>(size);
  }
  return nb::make_tuple(at, bytes_of(channels), bytes_of(logged), bytes_of(published), bytes_of(places),
                        bytes_of(sizes));
}

nb::bytes gathered(nb::handle buffer, nb::handle places, nb::handle sizes) {
  const BufferView view(buffer);
  const BufferView at(places);
  const BufferView of(sizes);
  const std::size_t count = std::min(at.size() / sizeof(std::uint64_t), of.size() / sizeof(std::uint32_t));
  std::vector<std::uint8_t> out;
  for (std::size_t i = 0; i < count; ++i) {
    std::uint64_t place = 0;
    std::uint32_t size = 0;
    std::memcpy(&place, at.data() + i * sizeof place, sizeof place);
    std::memcpy(&size, of.data() + i * sizeof size, sizeof size);
    if (place > view.size() || size > view.size() - place) throw std::invalid_argument("a place is outside the data");
    out.insert(out.end(), view.data() + place, view.data() + place + size);
  }
  return nb::bytes(reinterpret_cast<const char*>(out.data()), out.size());
}

namespace {

/// Numbers of one buffer.
template <class T>
class Numbers {
 public:
  explicit Numbers(nb::handle buffer) : view_(buffer) {}
  std::size_t size() const { return view_.size() / sizeof(T); }
  T operator[](std::size_t i) const {
    T value;
    std::memcpy(&value, view_.data() + i * sizeof value, sizeof value);
    return value;
  }

 private:
  BufferView view_;
};

/// Appends records to a buffer.
class Records {
 public:
  void add(std::uint16_t channel, std::uint64_t logged, std::uint64_t published, const void* data, std::size_t size) {
    const std::size_t at = bytes_.size();
    bytes_.resize(at + record_head + message_head + size);
    std::uint8_t* to = bytes_.data() + at;
    *to = message_opcode;
    const auto put = [&to](std::size_t place, std::uint64_t value, unsigned width) {
      for (unsigned i = 0; i < width; ++i) to[place + i] = static_cast<std::uint8_t>(value >> (8 * i));
    };
    put(1, message_head + size, 8);
    put(record_head, channel, 2);
    put(record_head + 2, 0, 4);
    put(record_head + 6, logged, 8);
    put(record_head + 14, published, 8);
    if (size != 0) std::memcpy(to + record_head + message_head, data, size);
    places_.push_back(at);
    channels_.push_back(channel);
    logged_.push_back(logged);
  }

  nb::tuple take() const {
    return nb::make_tuple(bytes_of(bytes_), bytes_of(places_), bytes_of(channels_), bytes_of(logged_));
  }

 private:
  std::vector<std::uint8_t> bytes_;
  std::vector<std::uint64_t> places_;
  std::vector<std::uint16_t> channels_;
  std::vector<std::uint64_t> logged_;
};

}  // namespace

nb::tuple packed_records(nb::handle buffer, nb::tuple pieces, nb::tuple decoded, nb::list payloads) {
  if (pieces.size() != 5 || decoded.size() != 4) throw std::invalid_argument("five buffers, and four");
  const BufferView view(buffer);
  const Numbers<std::uint16_t> channels(pieces[0]);
  const Numbers<std::uint64_t> logged(pieces[1]);
  const Numbers<std::uint64_t> published(pieces[2]);
  const Numbers<std::uint64_t> places(pieces[3]);
  const Numbers<std::uint32_t> sizes(pieces[4]);
  const Numbers<std::uint32_t> behind(decoded[0]);
  const Numbers<std::uint16_t> their_channels(decoded[1]);
  const Numbers<std::uint64_t> their_logged(decoded[2]);
  const Numbers<std::uint64_t> their_published(decoded[3]);
  const std::size_t count = channels.size();
  const std::size_t more = payloads.size();
  if (std::min({logged.size(), published.size(), places.size(), sizes.size()}) < count ||
      std::min({behind.size(), their_channels.size(), their_logged.size(), their_published.size()}) < more) {
    throw std::invalid_argument("buffers of different lengths");
  }
  Records records;
  std::size_t next = 0;
  const auto add_decoded = [&](std::size_t after) {
    for (; next < more && behind[next] <= after; ++next) {
      char* data = nullptr;
      Py_ssize_t size = 0;
      if (PyBytes_AsStringAndSize(nb::object(payloads[next]).ptr(), &data, &size) != 0) throw nb::python_error();
      records.add(their_channels[next], their_logged[next], their_published[next], data,
                  static_cast<std::size_t>(size));
    }
  };
  for (std::size_t i = 0; i < count; ++i) {
    const std::uint64_t place = places[i];
    const std::uint32_t size = sizes[i];
    if (place > view.size() || size > view.size() - place) throw std::invalid_argument("a place is outside the data");
    records.add(channels[i], logged[i], published[i], view.data() + place, size);
    add_decoded(i);
  }
  add_decoded(SIZE_MAX);
  return records.take();
}

}  // namespace wirebond::engine
