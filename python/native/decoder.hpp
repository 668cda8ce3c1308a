// Received messages as Python sees them.
#pragma once

#include <nanobind/nanobind.h>

#include <cstdint>
#include <memory>
#include <optional>
#include <vector>

#include "objects.hpp"
#include "wirebond/engine/decoder.hpp"

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
nb::list to_list(const Arrivals& arrivals, const nb::object& stamper);

/// Register `Decoder` with Python.
void bind_decoder(nb::module_& m);

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
