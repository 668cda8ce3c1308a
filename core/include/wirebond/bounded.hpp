// A string of bytes or characters of varying size, in place. Ignores the encoding of the characters.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <cstring>
#include <string_view>
#include <type_traits>

namespace wirebond {

/// Count the bytes before the first `end` among the `most + 1` bytes at `from`; `most + 1` if there is none. Any thread
/// or interrupt.
inline std::size_t size_before(const std::uint8_t* from, std::size_t most, std::uint8_t end) {
  const void* const found = std::memchr(from, end, most + 1);
  return found == nullptr ? most + 1 : static_cast<std::size_t>(static_cast<const std::uint8_t*>(found) - from);
}

/// Check whether `byte` is among these `size` elements. Any thread or interrupt.
inline bool has_byte(const void* from, std::size_t size, std::uint8_t byte) {
  return size != 0 && std::memchr(from, byte, size) != nullptr;
}

/// Check whether these two bytes are adjacent among `size` elements. Any thread or interrupt.
inline bool has_pair(const void* from, std::size_t size, std::uint8_t first, std::uint8_t second) {
  const auto* const bytes = static_cast<const std::uint8_t*>(from);
  for (std::size_t i = 1; i < size; ++i) {
    if (bytes[i - 1] == first && bytes[i] == second) return true;
  }
  return false;
}

/// Holds at most `Capacity` elements of one byte. Plain data: copy it, compare `size` first. Not terminated by a zero.
template <class Element, std::size_t Capacity>
struct Bounded {
  static_assert(sizeof(Element) == 1, "an element is one wire byte");
  static_assert(Capacity <= 0xFFFF, "no frame carries so much");

  std::uint16_t size = 0;
  std::array<Element, Capacity> data{};

  static constexpr std::size_t capacity = Capacity;

  /// Copy `count` elements. Returns false if they do not fit; nothing is changed then.
  bool assign(const Element* from, std::size_t count) {
    if (count > Capacity) return false;
    if (count != 0) std::memcpy(data.data(), from, count);
    size = static_cast<std::uint16_t>(count);
    return true;
  }

  bool assign(std::basic_string_view<Element> text) { return assign(text.data(), text.size()); }

  /// View the elements in use; valid while this object is.
  std::basic_string_view<Element> view() const { return {data.data(), size}; }
};

}  // namespace wirebond
