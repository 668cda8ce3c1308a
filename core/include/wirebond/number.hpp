// Converts a message's numbers for the wire: rejects those that are not finite, rounds to the nearest wire integer.
// Ranges belong to the protocol.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <cstring>
#include <limits>
#include <type_traits>
#include <utility>

#include "wirebond/bytes.hpp"

namespace wirebond {

/// Check that the value is neither NaN nor infinite. Reads the bits, so that -ffast-math cannot assume the answer.
WIREBOND_INLINE bool is_finite(float value) {
  constexpr std::uint32_t exponent = 0x7F800000u;
  std::uint32_t bits;
  std::memcpy(&bits, &value, sizeof bits);
  return (bits & exponent) != exponent;
}

WIREBOND_INLINE bool is_finite(double value) {
  constexpr std::uint64_t exponent = 0x7FF0000000000000u;
  std::uint64_t bits;
  std::memcpy(&bits, &value, sizeof bits);
  return (bits & exponent) != exponent;
}

namespace detail {

/// Return a word whose top bit is set if the exponent has no zero bit: the value is not finite. Its other bits mean
/// nothing.
WIREBOND_INLINE std::uint32_t exponent_overflow(float value) {
  std::uint32_t bits;
  std::memcpy(&bits, &value, sizeof bits);
  return (bits & 0x7F800000u) + 0x00800000u;
}

WIREBOND_INLINE std::uint32_t exponent_overflow(double value) {
  std::uint64_t bits;
  std::memcpy(&bits, &value, sizeof bits);
  return (static_cast<std::uint32_t>(bits >> 32) & 0x7FF00000u) + 0x00100000u;
}

template <class Real, std::size_t Size, std::size_t... I>
WIREBOND_INLINE std::uint32_t exponent_overflows(const std::array<Real, Size>& values, std::index_sequence<I...>) {
  return (exponent_overflow(values[I]) | ...);
}

}  // namespace detail

/// Check that all values are finite. One test for all, without a branch: three instructions per float on a Cortex-M4.
template <class Real, std::size_t Size>
WIREBOND_INLINE bool all_finite(const std::array<Real, Size>& values) {
  std::uint32_t overflows = 0;
  if constexpr (Size <= 8) {
    overflows = detail::exponent_overflows(values, std::make_index_sequence<Size>{});
  } else {
    for (const Real value : values) overflows |= detail::exponent_overflow(value);
  }
  return overflows >> 31 == 0;
}

/// Round `value` to the nearest integer of `Bytes` wire bytes, halves away from zero. Returns false if `value` is not
/// finite or the nearest integer does not fit; `wire` is then unchanged. `Real` decides the arithmetic: with float no
/// double is used. It holds every integer of its mantissa exactly, so wide integers need double.
template <unsigned Bytes, class Wire, class Real>
WIREBOND_INLINE bool nearest(Real value, Wire& wire) {
  static_assert(std::is_integral_v<Wire> && Bytes <= sizeof(Wire), "the integer needs room for the wire bytes");
  static_assert(std::is_floating_point_v<Real>, "only float and double are rounded");
  using Limits = std::numeric_limits<Wire>;
  constexpr unsigned unused_bits = 8 * (sizeof(Wire) - Bytes);
  constexpr Real half = static_cast<Real>(0.5);
  constexpr Real least = static_cast<Real>(Limits::min() >> unused_bits);
  constexpr Real low = least - half;  // the half is lost where the mantissa ends at whole numbers: then `least` fits
  constexpr Real high = static_cast<Real>(Limits::max() >> unused_bits) + half;
  if (!is_finite(value) || value < low || (value == low && low != least) || value >= high) return false;
  // Adding a half first would round twice: 0.49999997f + 0.5f is 1.
  using Wide = std::conditional_t<(sizeof(Wire) < 4), std::int32_t, Wire>;
  Wide whole = static_cast<Wide>(value);
  const Real rest = value - static_cast<Real>(whole);
  if (rest >= half) {
    ++whole;
  } else if (rest <= -half) {
    --whole;
  }
  wire = static_cast<Wire>(whole);
  return true;
}

/// Return the integer nearest to `value`, as `nearest` does; 0 if that fails.
template <class Wire, class Real>
WIREBOND_INLINE Wire nearest_or_zero(Real value) {
  Wire wire = 0;
  static_cast<void>(nearest<sizeof(Wire)>(value, wire));
  return wire;
}

/// Store the nearest integer; pairs with `load_integer`. Returns false as `nearest` does, and then stores nothing.
template <class Wire, ByteOrder Order = ByteOrder::little, unsigned Bytes = sizeof(Wire), class Real>
WIREBOND_INLINE bool store_nearest(std::uint8_t* to, Real value) {
  Wire wire;
  return nearest<Bytes>(value, wire) && store_integer<Wire, Order, Bytes>(to, wire);
}

/// Store a float. Returns false if it is not finite, and then stores nothing.
template <class Real, ByteOrder Order = ByteOrder::little>
WIREBOND_INLINE bool store_finite(std::uint8_t* to, Real value) {
  if (!is_finite(value)) return false;
  store<Real, Order>(to, value);
  return true;
}

}  // namespace wirebond
