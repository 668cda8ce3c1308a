// Errors that a UART finds in received bytes, by kind, for ports that keep reception running. Flags and counts: no
// register, no link.
#pragma once

#include <cstdint>
#include <type_traits>
#include <utility>

namespace wirebond {

/// Errors in a port's status register since the last query. A flag means one or more such bytes.
struct LineErrors {
  bool framing = false;  ///< no stop bit: another baud rate, or a disturbed cable
  bool noise = false;    ///< samples of one bit disagree
  bool overrun = false;  ///< DMA did not fetch a byte in time, so it is lost
  bool parity = false;

  constexpr bool any() const { return framing || noise || overrun || parity; }
};

namespace detail {

/// Whether this port reports them with `LineErrors take_line_errors()`, which returns and clears them.
template <class Port, class = void>
struct TellsLineErrors : std::false_type {};
template <class Port>
struct TellsLineErrors<Port, std::void_t<decltype(std::declval<Port&>().take_line_errors())>> : std::true_type {};

/// How often a query found each kind, modulo 2^32. Written by the UART's interrupt.
template <bool tells>
class LineErrorCounts {
 public:
  void count(const LineErrors& errors) {
    framing_ += errors.framing ? 1 : 0;
    noise_ += errors.noise ? 1 : 0;
    overruns_ += errors.overrun ? 1 : 0;
    parity_ += errors.parity ? 1 : 0;
  }
  std::uint32_t framing() const { return framing_; }
  std::uint32_t noise() const { return noise_; }
  std::uint32_t overruns() const { return overruns_; }
  std::uint32_t parity() const { return parity_; }

 private:
  std::uint32_t framing_ = 0;
  std::uint32_t noise_ = 0;
  std::uint32_t overruns_ = 0;
  std::uint32_t parity_ = 0;
};

/// For ports that do not report them: takes no byte.
template <>
class LineErrorCounts<false> {
 public:
  std::uint32_t framing() const { return 0; }
  std::uint32_t noise() const { return 0; }
  std::uint32_t overruns() const { return 0; }
  std::uint32_t parity() const { return 0; }
};

}  // namespace detail

}  // namespace wirebond
