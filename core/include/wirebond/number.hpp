// Numbers of a message on their way to the wire: finite or not, the nearest wire integer. Ranges are the protocol's.
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

/// Neither NaN nor infinite. Reads the bits, so that -ffast-math cannot take the answer for granted.
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

/// Its top bit is set where the exponent has no zero bit: the value is not finite. Others say nothing.
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

/// Is each of them finite? One question for all, without a branch: three instructions a float on a Cortex-M4.
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

/// The integer of `Bytes` wire bytes nearest to `value`, halves away from zero. False where `value` is not finite or
/// the nearest integer has no room; `wire` is then untouched. `Real` decides the arithmetic: with float no double is
/// used. It holds every integer of its mantissa exactly, so wide integers want double.
template <unsigned Bytes, class Wire, class Real>
WIREBOND_INLINE bool nearest(Real value, Wire& wire) {
  static_assert(std::is_integral_v<Wire> && Bytes <= sizeof(Wire), "the integer needs room for the wire bytes");
  static_assert(std::is_floating_point_v<Real>, "only float and double are rounded");
  using Limits = std::numeric_limits<Wire>;
  constexpr unsigned unused_bits = 8 * (sizeof(Wire) - Bytes);
  constexpr Real half = static_cast<Real>(0.5);
  constexpr Real least = static_cast<Real>(Limits::min() >> unused_bits);
  constexpr Real low =
      least - half;  // the half is lost where the mantissa ends at whole numbers: then `least` has room
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

/// Store the nearest integer; pair of `load_integer`. False as for `nearest`: nothing is stored then.
template <class Wire, ByteOrder Order = ByteOrder::little, unsigned Bytes = sizeof(Wire), class Real>
WIREBOND_INLINE bool store_nearest(std::uint8_t* to, Real value) {
  Wire wire;
  return nearest<Bytes>(value, wire) && store_integer<Wire, Order, Bytes>(to, wire);
}

/// Store a float. False where it is not finite: nothing is stored then.
template <class Real, ByteOrder Order = ByteOrder::little>
WIREBOND_INLINE bool store_finite(std::uint8_t* to, Real value) {
  if (!is_finite(value)) return false;
  store<Real, Order>(to, value);
  return true;
}

}  // namespace wirebond
