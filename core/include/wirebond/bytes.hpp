// Bytes and numbers only: loads and stores in a given byte order, at any alignment.
#pragma once

#if __cplusplus < 201703L
#error Wirebond needs C++17: compile with -std=c++17 or newer
#endif

#include <array>
#include <cstddef>
#include <cstdint>
#include <cstring>
#include <limits>
#include <type_traits>

// Forced inline only if the compiler optimises: at -O0 each copy of a function would keep its own variables on the
// stack, and fold nothing. No macro distinguishes -Og from -O1; there, and in instrumented builds, the two macros may
// be defined from outside as `inline` and empty: code becomes small, and slower.
#if defined(WIREBOND_INLINE) && defined(WIREBOND_INLINE_LAMBDA)
#elif defined(__GNUC__) && defined(__OPTIMIZE__)
#define WIREBOND_INLINE inline __attribute__((always_inline))
#define WIREBOND_INLINE_LAMBDA __attribute__((always_inline))
#else
#define WIREBOND_INLINE inline
#define WIREBOND_INLINE_LAMBDA
#endif
// For functions inlined for speed, but called if the compiler optimises for size.
#if defined(__OPTIMIZE_SIZE__)
#define WIREBOND_QUICK inline
#else
#define WIREBOND_QUICK WIREBOND_INLINE
#endif
#if defined(__GNUC__)
#define WIREBOND_NOINLINE __attribute__((noinline))
#else
#define WIREBOND_NOINLINE
#endif

namespace wirebond {

enum class ByteOrder : std::uint8_t { little, big };

/// Read an unsigned integer of `Bytes` (1 to 8) wire bytes at `from`. Any thread or interrupt; never fails.
template <unsigned Bytes, ByteOrder Order>
WIREBOND_INLINE std::uint64_t load_bytes(const std::uint8_t* from) {
  static_assert(Bytes >= 1 && Bytes <= 8, "a wire integer has 1 to 8 bytes");
  std::uint64_t value = 0;
  for (unsigned i = 0; i < Bytes; ++i) {
    const unsigned place = Order == ByteOrder::little ? i : Bytes - 1 - i;
    value |= static_cast<std::uint64_t>(from[i]) << (8 * place);
  }
  return value;
}

/// Read one whose width and order are known only at run time.
WIREBOND_INLINE std::uint64_t load_bytes(const std::uint8_t* from, unsigned bytes, ByteOrder order) {
  std::uint64_t value = 0;
  if (order == ByteOrder::little) {
    for (unsigned i = bytes; i-- > 0;) value = (value << 8) | from[i];
  } else {
    for (unsigned i = 0; i < bytes; ++i) value = (value << 8) | from[i];
  }
  return value;
}

/// Store the low `bytes` bytes of `value` at `to`. Higher bytes are dropped: the caller has checked the range.
WIREBOND_INLINE void store_bytes(std::uint8_t* to, std::uint64_t value, unsigned bytes, ByteOrder order) {
  for (unsigned i = 0; i < bytes; ++i) {
    const unsigned place = order == ByteOrder::little ? i : bytes - 1 - i;
    to[i] = static_cast<std::uint8_t>(value >> (8 * place));
  }
}

namespace detail {
template <std::size_t Size>
struct UnsignedOf;
template <>
struct UnsignedOf<1> {
  using type = std::uint8_t;
};
template <>
struct UnsignedOf<2> {
  using type = std::uint16_t;
};
template <>
struct UnsignedOf<4> {
  using type = std::uint32_t;
};
template <>
struct UnsignedOf<8> {
  using type = std::uint64_t;
};
}  // namespace detail

/// Read a number of type `T` (integer or IEEE 754 float) in wire order. Compiles to one load where order and alignment
/// allow.
template <class T, ByteOrder Order = ByteOrder::little>
WIREBOND_INLINE T load(const std::uint8_t* from) {
  using Bits = typename detail::UnsignedOf<sizeof(T)>::type;
  Bits bits;
#if defined(__BYTE_ORDER__) && __BYTE_ORDER__ == __ORDER_LITTLE_ENDIAN__
  if constexpr (Order == ByteOrder::little) {
    std::memcpy(&bits, from, sizeof bits);
  } else
#endif
  {
    bits = static_cast<Bits>(load_bytes<sizeof(T), Order>(from));
  }
  T value;
  std::memcpy(&value, &bits, sizeof value);
  return value;
}

/// Store a number; pairs with `load`.
template <class T, ByteOrder Order = ByteOrder::little>
WIREBOND_INLINE void store(std::uint8_t* to, T value) {
  using Bits = typename detail::UnsignedOf<sizeof(T)>::type;
  Bits bits;
  std::memcpy(&bits, &value, sizeof bits);
#if defined(__BYTE_ORDER__) && __BYTE_ORDER__ == __ORDER_LITTLE_ENDIAN__
  if constexpr (Order == ByteOrder::little) {
    std::memcpy(to, &bits, sizeof bits);
  } else
#endif
  {
    store_bytes(to, bits, sizeof bits, Order);
  }
}

/// Read consecutive numbers; one copy if the machine's order is the wire's.
template <class T, std::size_t Size, ByteOrder Order = ByteOrder::little>
WIREBOND_INLINE void load_array(const std::uint8_t* from, std::array<T, Size>& to) {
#if defined(__BYTE_ORDER__) && __BYTE_ORDER__ == __ORDER_LITTLE_ENDIAN__
  if constexpr (Order == ByteOrder::little) {
    std::memcpy(to.data(), from, sizeof to);
  } else
#endif
  {
    for (std::size_t i = 0; i < Size; ++i) to[i] = load<T, Order>(from + i * sizeof(T));
  }
}

/// Store consecutive numbers; pairs with `load_array`.
template <class T, std::size_t Size, ByteOrder Order = ByteOrder::little>
WIREBOND_INLINE void store_array(std::uint8_t* to, const std::array<T, Size>& from) {
#if defined(__BYTE_ORDER__) && __BYTE_ORDER__ == __ORDER_LITTLE_ENDIAN__
  if constexpr (Order == ByteOrder::little) {
    std::memcpy(to, from.data(), sizeof from);
  } else
#endif
  {
    for (std::size_t i = 0; i < Size; ++i) store<T, Order>(to + i * sizeof(T), from[i]);
  }
}

/// Read a two's complement or unsigned integer of `Bytes` wire bytes, extended to `T`.
template <class T, ByteOrder Order = ByteOrder::little, unsigned Bytes = sizeof(T)>
WIREBOND_INLINE T load_integer(const std::uint8_t* from) {
  static_assert(std::is_integral_v<T> && Bytes <= sizeof(T), "the integer needs room for the wire bytes");
  if constexpr (Bytes == sizeof(T)) {
    return load<T, Order>(from);
  } else {
    constexpr unsigned unused_bits = 8 * (sizeof(T) - Bytes);
    using Bits = std::make_unsigned_t<T>;
    const Bits bits = static_cast<Bits>(load_bytes<Bytes, Order>(from));
    return static_cast<T>(static_cast<T>(static_cast<Bits>(bits << unused_bits)) >> unused_bits);
  }
}

/// Store an integer; pairs with `load_integer`. Returns false if `value` does not fit; nothing is stored then.
template <class T, ByteOrder Order = ByteOrder::little, unsigned Bytes = sizeof(T)>
WIREBOND_INLINE bool store_integer(std::uint8_t* to, T value) {
  static_assert(std::is_integral_v<T> && Bytes <= sizeof(T), "the integer needs room for the wire bytes");
  if constexpr (Bytes == sizeof(T)) {
    store<T, Order>(to, value);
  } else {
    constexpr unsigned unused_bits = 8 * (sizeof(T) - Bytes);
    if (value < (std::numeric_limits<T>::min() >> unused_bits)) return false;
    if (value > (std::numeric_limits<T>::max() >> unused_bits)) return false;
    store_bytes(to, static_cast<std::uint64_t>(value), Bytes, Order);
  }
  return true;
}

}  // namespace wirebond
