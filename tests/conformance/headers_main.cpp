// Encodes and decodes frames with header values by one protocol's generated code. For tests that compare this with the
// engine; headers.py compiles it and writes header_rows.hpp.
//
//   headers < lines      each `MESSAGE_INDEX NUMBER...`, the wire's numbers of all header fields in the file's order
//
// For each line: `frame HEX` or `refused`; and where there is a frame, `header NUMBER...`: what a receiver's handler
// finds, `none`: the frame's message reached no handler.
//
// Given by headers.py: PROTOCOL_HEADER, PROTOCOL (its namespace), SENDER (FromHost or FromMcu).
#include <array>
#include <cstdint>
#include <cstdio>
#include <sstream>
#include <string>
#include <vector>

#include PROTOCOL_HEADER

#include "wirebond/receiver.hpp"

namespace {

using Sender = PROTOCOL::SENDER;
using Header = Sender::Header;
using Numbers = wirebond::detail::HeaderNumbers<Sender>;
using Frame = std::vector<std::uint8_t>;

template <class Message>
Frame encoded(const Header& header) {
  Frame frame(Message::Info::max_frame_bytes);
  std::size_t size = 0;
  const auto status = wirebond::encode_frame<Sender>(Message{}, frame.data(), frame.size(), size, header);
  frame.resize(status == wirebond::Status::ok ? size : 0);
  return frame;
}

struct Printer {
  template <class Message>
  void on(const Message&, const Header& header) {
    Numbers numbers{};
    const bool is_right = write_header(header, numbers.data());
    std::printf(is_right ? "header" : "wrong");
    for (const std::uint64_t number : numbers) std::printf(" %llu", static_cast<unsigned long long>(number));
    std::puts("");
    came = true;
  }
  bool came = false;
};

template <class Source>
void take(const Frame& frame) {
  wirebond::Receiver<Source> receiver;
  if constexpr (wirebond::names_receiver<Source>) receiver.listen_to_all();
  Printer printer;
  receiver.feed(frame.data(), frame.size(), 0, printer);
  receiver.idle(2 * Source::idle_us, printer);
  if (!printer.came) std::puts("none");
}

#include "header_rows.hpp"  // Frame encoded(int index, const Header&)

}  // namespace

int main() {
  char line[1024];
  while (std::fgets(line, sizeof line, stdin) != nullptr) {
    std::istringstream words(line);
    int index = -1;
    Numbers numbers{};
    words >> index;
    for (std::uint64_t& number : numbers) words >> number;
    Header header = Sender::header();
    read_header(numbers.data(), header);
    const Frame frame = encoded(index, header);
    if (frame.empty()) {
      std::puts("refused");
      continue;
    }
    std::printf("frame ");
    for (const std::uint8_t byte : frame) std::printf("%02x", byte);
    std::puts("");
    take<Sender>(frame);
  }
  return 0;
}
