// What a sender holds between reserve and commit, and why it may hold nothing. No queue.
#pragma once

#include <cstddef>
#include <cstdint>

#include "wirebond/bytes.hpp"

namespace wirebond {

/// Why a frame was not accepted.
enum class Refusal : std::uint8_t {
  none,
  full,       ///< no room, because finished frames wait for the line
  held,       ///< no room, because frames that left lie behind one that its sender has not finished
  range,      ///< a field was out of range
  down,       ///< the link is down
  abandoned,  ///< the grant was given back without a commit
};
inline constexpr std::size_t refusal_count = 6;  ///< `none` among them

/// Room for one frame, or the reason why there is none. Whoever holds it writes the frame to data()[0 .. size()) and
/// then calls `commit`; a grant that ends without that is given back, and the frame counts as refused.
/// A sender holds one grant at a time, for as short a time as it can: frames behind it leave, but the room that they
/// leave is not used again before this one is finished.
/// `Owner` is a queue with `Ticket {std::uint8_t* data; … size; …}`, `commit(ticket, used)` and `abandon(ticket, why)`.
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
  Refusal refusal() const { return refusal_; }  ///< `none` where it was granted

  std::uint8_t* data() const { return ticket_.data; }           ///< contiguous; nothing is known of what lies there
  std::size_t size() const { return ok() ? ticket_.size : 0; }  ///< bytes

  /// The frame is the first `used` bytes, 1 .. size(). Ends the grant. Where `used` is anything else there is no frame:
  /// the grant is given back.
  WIREBOND_QUICK void commit(std::size_t used) {
    if (owner_ == nullptr) return;
    if (used == 0 || used > ticket_.size) return give_back();
    owner_->commit(ticket_, used);
    owner_ = nullptr;
  }

  /// End the grant without a frame. Nothing happens where it has ended already.
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
