// Elements of varying number, in place, of any type. For strings see bounded.hpp.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>

namespace wirebond {

/// Holds at most `Capacity` elements. Plain data: copy it; elements after `size` mean nothing.
template <class Element, std::size_t Capacity>
struct List {
  static_assert(Capacity <= 0xFFFF, "no frame carries so much");

  std::uint16_t size = 0;
  std::array<Element, Capacity> data{};

  static constexpr std::size_t capacity = Capacity;

  /// Append a copy of `element`. Returns false if the list is full; nothing is changed then.
  constexpr bool push_back(const Element& element) {
    if (size >= Capacity) return false;
    data[size] = element;
    ++size;
    return true;
  }

  /// Return the number of elements in use: at most `Capacity`, whatever was written to `size`.
  constexpr std::size_t used() const { return size < Capacity ? size : Capacity; }

  constexpr Element& operator[](std::size_t index) { return data[index]; }
  constexpr const Element& operator[](std::size_t index) const { return data[index]; }
  constexpr Element* begin() { return data.data(); }
  constexpr Element* end() { return data.data() + used(); }
  constexpr const Element* begin() const { return data.data(); }
  constexpr const Element* end() const { return data.data() + used(); }
};

}  // namespace wirebond
