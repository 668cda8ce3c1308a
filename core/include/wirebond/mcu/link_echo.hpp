// A link on a line that echoes: its runs are kept until they are heard or given up. Bytes and times: no frame, no port.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>

#include "wirebond/echo.hpp"

namespace wirebond::detail {

/// Return the smallest power of two that is at least `bytes`.
constexpr std::size_t power_of_two(std::size_t bytes) {
  std::size_t power = 1;
  while (power < bytes) power *= 2;
  return power;
}

/// For `echo: true`. The UART's interrupt keeps runs, `poll` hears. `longest_run`: bytes; four such runs fit.
template <bool echoes, std::size_t longest_run>
class LinkEcho {
 public:
  bool keep(const std::uint8_t* bytes, std::size_t size) { return echo_.keep(bytes, size); }
  void sent() { echo_.sent(); }
  void refused() { echo_.refused(); }

  template <class Pass>
  void hear(const std::uint8_t* bytes, std::size_t size, Pass&& pass) {
    echo_.hear(bytes, size, pass);
  }

  /// Note that `poll` has read all bytes that came by `now_us`. While the line does not send, and no part of an
  /// expected run was heard for `timeout_us`, the run is given up.
  template <class Pass>
  void poll(std::uint32_t now_us, bool sends, std::uint32_t timeout_us, Pass&& pass) {
    const Echo::Count progress = echo_.progress();
    const bool is_quiet = echo_.waits() && !sends && progress == progress_;
    if (!is_quiet || !is_quiet_) quiet_since_us_ = now_us;
    is_quiet_ = is_quiet;
    progress_ = progress;
    if (is_quiet && now_us - quiet_since_us_ >= timeout_us) echo_.give_up(pass);
  }

  void forget() { echo_.forget(); }

  bool waits() const { return echo_.waits(); }
  bool holds() const { return echo_.held() != 0; }
  std::uint32_t quiet_since_us() const { return quiet_since_us_; }
  std::uint32_t echoed() const { return echo_.echoed(); }
  std::uint32_t collisions() const { return echo_.collisions(); }

 private:
  std::array<std::uint8_t, power_of_two(4 * (longest_run + Echo::piece_overhead))> memory_;
  Echo echo_{memory_.data(), memory_.size()};
  std::uint32_t quiet_since_us_ = 0;  ///< the first poll that found a quiet line while a run is expected
  bool is_quiet_ = false;
  Echo::Count progress_ = 0;
};

/// For a line that does not echo: takes no byte, no instruction.
template <std::size_t longest_run>
class LinkEcho<false, longest_run> {
 public:
  static std::uint32_t echoed() { return 0; }
  static std::uint32_t collisions() { return 0; }
};

}  // namespace wirebond::detail
