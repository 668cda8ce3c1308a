// Converts a stream of bytes to Message objects for Python. Waits for nothing, opens nothing; time is an argument.
#pragma once

#include <nanobind/nanobind.h>

#include <cstdint>
#include <memory>
#include <optional>
#include <vector>

#include "objects.hpp"
#include "wirebond/engine/account.hpp"
#include "wirebond/engine/batch.hpp"
#include "wirebond/engine/protocol.hpp"
#include "wirebond/engine/sequence_book.hpp"
#include "wirebond/host/addressing.hpp"

namespace wirebond::engine {

/// One message for Python. Fields are decoded at their first use.
class Message {
 public:
  /// `stamper`: a function that returns the host's time for a message's time stamp; empty or None: there is none.
  Message(std::shared_ptr<const Batch> batch, const Event& event, nb::object stamper)
      : batch_(std::move(batch)), event_(event), stamper_(std::move(stamper)) {}

  nb::object name() const;
  nb::object sender() const;
  nb::bytes raw() const;
  nb::bytes payload() const;
  nb::object fields();
  nb::object field(nb::str name);
  nb::list violations() const;
  nb::object header() const;
  nb::object stamp() { return stamped(0); }
  nb::object stamp_error() { return stamped(1); }
  std::uint32_t id() const { return event_.id; }
  std::uint64_t offset() const { return event_.offset; }
  double time() const { return event_.time; }

  const Event& event() const { return event_; }
  const Batch& batch() const { return *batch_; }

  /// Call `visit` with each Python object that it keeps.
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

/// Return messages of a batch as a Python list. Needs the GIL.
nb::list to_list(const std::shared_ptr<Batch>& batch, const std::vector<Event>& events, const nb::object& stamper);

/// A format with its deframer. One thread at a time.
class Decoder {
 public:
  Decoder(std::shared_ptr<const ProtocolTable> protocol, std::shared_ptr<const FormatTable> format,
          double idle_seconds);

  nb::list feed(nb::handle bytes, nb::handle time);
  /// Process many reads at once: `idle` and `feed` for each. `places` (u64) and `sizes` (u32) locate their bytes in
  /// `buffer`, `times` (f64) are their starts. Returns the messages, and for each the index of its read (u32). Without
  /// `keep` they are only counted.
  nb::tuple feed_reads(nb::handle buffer, nb::handle places, nb::handle sizes, nb::handle times, bool keep);
  /// `address`: of the header field at `place` of the format's list; replies from others are foreign then.
  void expect(std::int16_t message, int place, std::optional<std::uint64_t> address);
  nb::list idle(nb::handle time);
  nb::list finish();
  /// Set the stamper of later messages; see Message.
  void set_stamper(nb::object stamper) { stamper_ = std::move(stamper); }
  /// See `account_node`.
  nb::object stats() const {
    const HostAccount& account = deframer_.account();
    return to_object(account_node(account, account.unlisted.found(), deframer_.bytes(), deframer_.pending(), *protocol_,
                                  counts_, *format_, sequence_.account(), foreign_));
  }

 private:
  double seconds(nb::handle time);
  std::uint64_t microseconds(double time);
  std::shared_ptr<Batch> new_batch() const;
  /// One sink for all functions that feed. It has a name because the deframer is compiled again for each type of sink,
  /// which takes ten seconds each time.
  struct Recording;

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

/// Read-only view of a bytes-like object, released with this object. Bytes that are not adjacent are copied.
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
