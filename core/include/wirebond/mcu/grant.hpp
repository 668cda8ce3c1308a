// A sender's memory between reserve and commit, or the reason why it got none. No queue.
#pragma once

#include <cstddef>
#include <cstdint>

#include "wirebond/bytes.hpp"

namespace wirebond {

/// Why a frame was not accepted.
enum class Refusal : std::uint8_t {
  none,
  full,       ///< no free memory, because finished frames wait for the line
  held,       ///< no free memory, because an unfinished frame is before frames that have left
  range,      ///< a field was out of range
  down,       ///< the link is down
  abandoned,  ///< the grant was given back without a commit
};
inline constexpr std::size_t refusal_count = 6;  ///< including `none`

/// Memory for one frame, or the reason why there is none. Its holder writes the frame to data()[0 .. size()) and then
/// calls `commit`; a grant that ends otherwise is given back, and the frame counts as refused. Hold only one grant at a
/// time, as briefly as possible: frames after it leave, but their memory is not reused before this one is finished.
/// `Owner`: a queue with `Ticket {std::uint8_t* data; … size; …}`, `commit(ticket, used)` and `abandon(ticket, why)`.
template <class Owner>
class [[nodiscard]] Grant {
 public:
  using Ticket = typename Owner::Ticket;

  explicit Grant(Refusal refusal) : refusal_(refusal) {}
  Grant(Owner& owner, const Ticket& ticket) : owner_(&owner), ticket_(ticket) {}
  Grant(Grant&& other) noexcept : owner_(other.owner_), ticket_(other.ticket_), refusal_(other.refusal_) {
    other.owner_ = nullptr;
  }
  Grant(const Grant&) = delete;
  Grant& operator=(const Grant&) = delete;
  Grant& operator=(Grant&&) = delete;
  WIREBOND_QUICK ~Grant() { give_back(); }

  bool ok() const { return owner_ != nullptr; }
  Refusal refusal() const { return refusal_; }  ///< `none` if it was granted

  std::uint8_t* data() const { return ticket_.data; }           ///< contiguous; its contents are undefined
  std::size_t size() const { return ok() ? ticket_.size : 0; }  ///< bytes

  /// Commit the first `used` bytes, 1 .. size(), as the frame, and end the grant. Any other `used` makes no frame: the
  /// grant is given back.
  WIREBOND_QUICK void commit(std::size_t used) {
    if (owner_ == nullptr) return;
    if (used == 0 || used > ticket_.size) return give_back();
    owner_->commit(ticket_, used);
    owner_ = nullptr;
  }

  /// End the grant without a frame. Does nothing if it has ended already.
  WIREBOND_QUICK void give_back(Refusal why = Refusal::abandoned) {
    if (owner_ == nullptr) return;
    owner_->abandon(ticket_, why);
    owner_ = nullptr;
  }

 private:
  Owner* owner_ = nullptr;
  Ticket ticket_{};
  Refusal refusal_ = Refusal::none;
};

}  // namespace wirebond
