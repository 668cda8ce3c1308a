// Between a generated C API and the C++ core: one value seen from both languages. For generated .cpp files only.
#pragma once

#include <cstddef>
#include <cstdint>
#include <cstring>
#include <new>
#include <type_traits>
#include <utility>

#include "wirebond/address.hpp"
#include "wirebond/deadline.hpp"
#include "wirebond/mcu/c_api.h"
#include "wirebond/receiver.hpp"
#include "wirebond/status.hpp"
#include "wirebond/violation.hpp"

namespace wirebond::c {

static_assert(static_cast<int>(Status::ok) == WIREBOND_OK);
static_assert(static_cast<int>(Status::out_of_range) == WIREBOND_OUT_OF_RANGE);
static_assert(static_cast<int>(Status::too_small) == WIREBOND_TOO_SMALL);
static_assert(static_cast<int>(Status::queue_full) == WIREBOND_QUEUE_FULL);
static_assert(static_cast<int>(Status::link_down) == WIREBOND_LINK_DOWN);
static_assert(static_cast<int>(Cause::no_start) == WIREBOND_NO_START);
static_assert(static_cast<int>(Cause::constant_mismatch) == WIREBOND_CONSTANT_MISMATCH);
static_assert(static_cast<int>(Cause::length_out_of_range) == WIREBOND_LENGTH_OUT_OF_RANGE);
static_assert(static_cast<int>(Cause::unknown_message) == WIREBOND_UNKNOWN_MESSAGE);
static_assert(static_cast<int>(Cause::header_check_mismatch) == WIREBOND_HEADER_CHECK_MISMATCH);
static_assert(static_cast<int>(Cause::check_mismatch) == WIREBOND_CHECK_MISMATCH);
static_assert(static_cast<int>(Cause::bad_stuffing) == WIREBOND_BAD_STUFFING);
static_assert(static_cast<int>(Cause::incomplete) == WIREBOND_INCOMPLETE);
static_assert(cause_count == WIREBOND_CAUSE_COUNT);
static_assert(static_cast<int>(Addressee::own) == WIREBOND_ADDRESSEE_OWN);
static_assert(static_cast<int>(Addressee::all) == WIREBOND_ADDRESSEE_ALL);
static_assert(static_cast<int>(Addressee::another) == WIREBOND_ADDRESSEE_ANOTHER);
static_assert(static_cast<int>(Violation::not_finite) == WIREBOND_NOT_FINITE);
static_assert(static_cast<int>(Violation::unknown_enum) == WIREBOND_UNKNOWN_ENUM);
static_assert(static_cast<int>(Violation::out_of_range) == WIREBOND_VALUE_OUT_OF_RANGE);
static_assert(static_cast<int>(Violation::clamped) == WIREBOND_CLAMPED);
static_assert(static_cast<int>(Violation::wrong_count) == WIREBOND_WRONG_COUNT);

/// Convert a value to the other language's struct. Every member is at the same place in both: the generated file
/// asserts that.
template <class To, class From>
To same(const From& from) {
  static_assert(sizeof(To) == sizeof(From), "the two languages lay this struct out differently");
  static_assert(std::is_trivially_copyable_v<To> && std::is_trivially_copyable_v<From>);
  union Room {  // a union, because some structs of C++ have no default values
    Room() {}
    To to;
  } room;
  std::memcpy(static_cast<void*>(&room), &from, sizeof room);
  return room.to;
}

inline wirebond_status_t to_c(Status status) { return static_cast<wirebond_status_t>(status); }

inline wirebond_addressee_t to_c(Addressee addressee) { return static_cast<wirebond_addressee_t>(addressee); }

inline wirebond_frame_t to_c(const Frame& frame) {
  return {frame.wire, frame.wire_size, frame.payload, frame.payload_size, frame.id};
}

inline wirebond_violations_t to_c(const Violations& counts) {
  return {counts.not_finite, counts.unknown_enum, counts.out_of_range,
          counts.clamped,    counts.wrong_count,  counts.rejected};
}

inline wirebond_sequence_counts_t to_c(const SequenceCounts<std::uint32_t>& counts) {
  return {counts.numbered, counts.gaps, counts.repeats, counts.restarts};
}

inline wirebond_not_acted_t to_c(const NotActed<std::uint32_t>& counts) { return {counts.late, counts.held_back}; }

/// Return the byte account of a receiver. `Account`: a struct of C, for receivers or links.
template <class Account, class Receiver>
Account bytes_of(const Receiver& receiver) {
  const auto& from = receiver.account();
  Account account{};
  account.bytes = receiver.bytes();
  account.frame_bytes = from.frame_bytes;
  account.fill_bytes = from.fill_bytes;
  account.pending_bytes = static_cast<std::uint32_t>(receiver.pending());
  for (std::size_t cause = 0; cause < cause_count; ++cause)
    account.discarded_bytes[cause] = from.discarded_bytes[cause];
  account.frames = from.frames;
  account.unknown_frames = from.unknown_frames;
  return account;
}

template <class Source>
wirebond_account_t account_of(const Receiver<Source>& receiver) {
  auto account = bytes_of<wirebond_account_t>(receiver);
  for (std::size_t cause = 0; cause < cause_count; ++cause) {
    account.rejected_candidates[cause] = receiver.account().rejected_candidates[cause];
  }
  return account;
}

/// Make an object in memory that C provides for it. It needs no destructor, so C may drop or reuse that memory.
template <class Object, class Storage, class... Arguments>
void construct(Storage& storage, Arguments&&... arguments) {
  static_assert(sizeof(Object) <= sizeof storage, "enlarge the object's ..._BYTES macro in wirebond/mcu/c_api.h");
  static_assert(alignof(Object) <= alignof(Storage), "the storage's union lacks the strictest member type");
  static_assert(std::is_trivially_destructible_v<Object>);
  ::new (static_cast<void*>(&storage)) Object(std::forward<Arguments>(arguments)...);
}

/// Return the object that `construct` made there.
template <class Object, class Storage>
Object& object_in(Storage& storage) {
  return *std::launder(reinterpret_cast<Object*>(&storage));
}
template <class Object, class Storage>
const Object& object_in(const Storage& storage) {
  return *std::launder(reinterpret_cast<const Object*>(&storage));
}

/// Asks the deadlines about received messages, if C passed any.
template <class Deadlines>
struct Watch {
  Deadlines* deadlines = nullptr;

  template <class IsStop>
  MayAct may_act(std::int16_t message, std::uint32_t came_us, std::uint32_t now_us, IsStop&& is_stop) {
    return deadlines == nullptr ? MayAct::yes : deadlines->may_act(message, came_us, now_us, is_stop);
  }
  void seen(std::int16_t message, std::uint32_t now_us) {
    if (deadlines != nullptr) deadlines->seen(message, now_us);
  }
};

/// Replaces the deadlines of an end that has none.
struct NoDeadlines {
  template <class IsStop>
  MayAct may_act(std::int16_t, std::uint32_t, std::uint32_t, IsStop&&) {
    return MayAct::yes;
  }
  void seen(std::int16_t, std::uint32_t) {}
};

/// State of a receiver of the C API. `Calls` passes messages to the functions from C.
template <class Source, class Calls, class Deadlines = NoDeadlines>
struct ReceiverObject {
  explicit ReceiverObject(const Calls& to) : calls(to) {}

  Receiver<Source> receiver{};
  Calls calls;
  Watch<Deadlines> watch{};
};

}  // namespace wirebond::c
