// A stream of bytes to Message objects for Python. Waits for nothing, opens nothing; time is an argument.
#pragma once

#include <nanobind/nanobind.h>

#include <cstdint>
#include <memory>
#include <optional>
#include <vector>

#include "protocol.hpp"
#include "sequence_book.hpp"
#include "wirebond/host/addressing.hpp"
#include "wirebond/stream_deframer.hpp"
#include "wirebond/unlisted.hpp"

namespace wirebond::engine {

/// The bytes of all messages of one call, kept alive by the messages that point into it.
struct Batch {
  std::shared_ptr<const ProtocolTable> protocol;
  std::shared_ptr<const FormatTable> format;
  std::vector<std::uint8_t> bytes;
  std::vector<std::uint64_t> headers;  ///< bits of the header fields that a frame has, for formats that have them
};

/// One frame that passed, before any Python object exists. Places are indices into Batch::bytes.
struct Event {
  std::uint32_t wire_at = 0;
  std::uint32_t wire_size = 0;
  std::uint32_t payload_at = 0;
  std::uint32_t payload_size = 0;
  std::uint32_t id = 0;
  std::int16_t message = -1;
  std::uint8_t form = 0;
  std::uint32_t header_at = 0;
  std::uint64_t offset = 0;
  double time = 0;
};

/// Append the frame's bytes to the batch and describe it. No GIL needed.
Event record(const Frame& frame, double time, Batch& batch);

/// What Python sees of one message. Fields are decoded when they are first asked for.
class Message {
 public:
  /// `stamper`: a function that gives the host's time of a message's time stamp; empty or None: there is none.
  Message(std::shared_ptr<const Batch> batch, const Event& event, nb::object stamper)
      : batch_(std::move(batch)), event_(event), stamper_(std::move(stamper)) {}

  nb::object name() const;
  nb::object sender() const;
  nb::bytes raw() const;
  nb::bytes payload() const;
  nb::object fields();
  nb::object field(nb::str name);
  nb::list violations() const;
  nb::dict header() const;
  nb::object stamp() { return stamped(0); }
  nb::object stamp_error() { return stamped(1); }
  std::uint32_t id() const { return event_.id; }
  std::uint64_t offset() const { return event_.offset; }
  double time() const { return event_.time; }

  const Event& event() const { return event_; }
  const Batch& batch() const { return *batch_; }

  /// Called with each Python object that it keeps.
  template <class Visit>
  void visit(Visit&& visit) {
    visit(fields_);
    visit(stamper_);
    visit(stamp_);
  }

 private:
  const MessageTable* table() const {
    return event_.message < 0 ? nullptr : &batch_->protocol->messages()[static_cast<std::size_t>(event_.message)];
  }
  const std::uint8_t* payload_bytes() const { return batch_->bytes.data() + event_.payload_at; }

  nb::object stamped(std::size_t place);

  std::shared_ptr<const Batch> batch_;
  Event event_;
  nb::object fields_;
  nb::object stamper_;
  nb::object stamp_;  ///< time and error, once they are known
};

/// Messages of a batch as a Python list. Needs the GIL.
nb::list to_list(const std::shared_ptr<Batch>& batch, const std::vector<Event>& events, const nb::object& stamper);

/// Frames of these that are for another address: counted, and given to nobody.
struct ForeignCounts {
  std::uint64_t frames = 0;
  std::uint64_t bytes = 0;

  void add(const Frame& frame) {
    frames += 1;
    bytes += frame.wire_size;
  }
};

using HostDeframer = StreamDeframer<RuntimeSource, std::uint64_t, HostAccount>;

/// Statistics as a dict: bytes, frames, frame_bytes, unknown_frames, fill_bytes, pending_bytes, discarded_bytes and
/// rejected_candidates by cause, messages by name, sequence; unlisted: how many by (id, bytes).
nb::dict account_dict(const ByteAccount<std::uint64_t>& account, const UnlistedKinds& unlisted, std::uint64_t bytes,
                      std::uint64_t pending, const ProtocolTable& protocol, const std::vector<std::uint64_t>& counts,
                      const FormatTable& format, const SequenceAccount& sequence, const ForeignCounts& foreign = {});

/// A format with its deframer. One thread at a time.
class Decoder {
 public:
  Decoder(std::shared_ptr<const ProtocolTable> protocol, std::shared_ptr<const FormatTable> format,
          double idle_seconds);

  nb::list feed(nb::handle bytes, nb::handle time);
  /// Many reads at once: `idle` and `feed` for each. `places` (u64) and `sizes` (u32) say where their bytes lie in
  /// `buffer`, `times` (f64) when they began. Returns the messages, and for each the index of its read (u32). Without
  /// `keep` they are only counted.
  nb::tuple feed_reads(nb::handle buffer, nb::handle places, nb::handle sizes, nb::handle times, bool keep);
  /// `address`: of the header field at `place` of the format's list; replies from others are foreign then.
  void expect(std::int16_t message, int place, std::optional<std::uint64_t> address);
  nb::list idle(nb::handle time);
  nb::list finish();
  /// For the messages from here on; see Message.
  void set_stamper(nb::object stamper) { stamper_ = std::move(stamper); }
  nb::dict stats() const {
    const HostAccount& account = deframer_.account();
    return account_dict(account, account.unlisted.found(), deframer_.bytes(), deframer_.pending(), *protocol_, counts_,
                        *format_, sequence_.account(), foreign_);
  }

 private:
  double seconds(nb::handle time);
  std::uint64_t microseconds(double time);
  template <class Step>
  nb::list collect(double time, Step step);

  std::shared_ptr<const ProtocolTable> protocol_;
  std::shared_ptr<const FormatTable> format_;
  std::vector<std::uint8_t> workspace_;
  HostDeframer deframer_;
  std::vector<std::uint64_t> counts_;  ///< by message
  SequenceBook sequence_;
  HostAddressing addressing_;
  ForeignCounts foreign_;
  double latest_ = 0;
  nb::object stamper_;
};

/// Read-only view of a bytes-like object, released with this object. Bytes that do not lie together are copied.
class BufferView {
 public:
  explicit BufferView(nb::handle object);
  ~BufferView() { PyBuffer_Release(&view_); }
  BufferView(const BufferView&) = delete;
  BufferView& operator=(const BufferView&) = delete;

  const std::uint8_t* data() const { return data_; }
  std::size_t size() const { return static_cast<std::size_t>(view_.len); }

 private:
  Py_buffer view_{};
  const std::uint8_t* data_ = nullptr;
  std::vector<std::uint8_t> gathered_;
};

}  // namespace wirebond::engine
