// Message records of an MCAP file in bulk: where they lie. Knows no channel's meaning; trusts no length.
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

// MCAP, "Records": an opcode, a length of eight bytes, and that many bytes. Of a message these begin with channel,
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
    if (place > view.size() || size > view.size() - place) throw std::invalid_argument("a place lies outside");
    out.insert(out.end(), view.data() + place, view.data() + place + size);
  }
  return nb::bytes(reinterpret_cast<const char*>(out.data()), out.size());
}

}  // namespace wirebond::engine
