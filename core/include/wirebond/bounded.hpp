// A string of bytes or characters of varying size, in place. Encoding of the characters is not looked at.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <cstring>
#include <string_view>
#include <type_traits>

namespace wirebond {

/// Bytes before the first `end` among the `most + 1` bytes at `from`; `most + 1` where it is not among them. Any thread
/// or interrupt.
inline std::size_t size_before(const std::uint8_t* from, std::size_t most, std::uint8_t end) {
  const void* const found = std::memchr(from, end, most + 1);
  return found == nullptr ? most + 1 : static_cast<std::size_t>(static_cast<const std::uint8_t*>(found) - from);
}

/// Is `byte` one of these `size` elements? Any thread or interrupt.
inline bool has_byte(const void* from, std::size_t size, std::uint8_t byte) {
  return size != 0 && std::memchr(from, byte, size) != nullptr;
}

/// At most `Capacity` elements of one byte. Plain data: copy it, compare `size` first. Not terminated by a zero.
template <class Element, std::size_t Capacity>
struct Bounded {
  static_assert(sizeof(Element) == 1, "an element is one wire byte");
  static_assert(Capacity <= 0xFFFF, "no frame carries so much");

  std::uint16_t size = 0;
  std::array<Element, Capacity> data{};

  static constexpr std::size_t capacity = Capacity;

  /// Take a copy of `count` elements. False where they do not fit: nothing is changed then.
  bool assign(const Element* from, std::size_t count) {
    if (count > Capacity) return false;
    if (count != 0) std::memcpy(data.data(), from, count);
    size = static_cast<std::uint16_t>(count);
    return true;
  }

  bool assign(std::basic_string_view<Element> text) { return assign(text.data(), text.size()); }

  /// The elements in use; valid while this object is.
  std::basic_string_view<Element> view() const { return {data.data(), size}; }
};

}  // namespace wirebond
