// Elements of a varying number, in place. What an element is does not matter here; strings are bounded.hpp's.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>

namespace wirebond {

/// At most `Capacity` elements. Plain data: copy it; elements behind `size` mean nothing.
template <class Element, std::size_t Capacity>
struct List {
  static_assert(Capacity <= 0xFFFF, "no frame carries so much");

  std::uint16_t size = 0;
  std::array<Element, Capacity> data{};

  static constexpr std::size_t capacity = Capacity;

  /// Put a copy of `element` behind the others. False where there is no room: nothing is changed then.
  constexpr bool push_back(const Element& element) {
    if (size >= Capacity) return false;
    data[size] = element;
    ++size;
    return true;
  }

  /// Elements in use, `Capacity` at most, whatever was written to `size`.
  constexpr std::size_t used() const { return size < Capacity ? size : Capacity; }

  constexpr Element& operator[](std::size_t index) { return data[index]; }
  constexpr const Element& operator[](std::size_t index) const { return data[index]; }
  constexpr Element* begin() { return data.data(); }
  constexpr Element* end() { return data.data() + used(); }
  constexpr const Element* begin() const { return data.data(); }
  constexpr const Element* end() const { return data.data() + used(); }
};

}  // namespace wirebond
