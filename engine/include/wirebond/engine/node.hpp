// A value as a tree, and its bytes: MessagePack (msgpack.org). So tables come in, and values pass between languages.
#pragma once

#include <cstddef>
#include <cstdint>
#include <limits>
#include <stdexcept>
#include <string>
#include <type_traits>
#include <utility>
#include <variant>
#include <vector>

namespace wirebond::engine {

/// None, bool, integer, float, text (UTF-8), bytes, list or map. The keys of a map are texts, in their order.
class Node {
 public:
  using Bytes = std::vector<std::uint8_t>;
  using List = std::vector<Node>;
  using Map = std::vector<std::pair<std::string, Node>>;

 private:
  [[noreturn]] static void refuse(const char* wanted) {
    throw std::logic_error(std::string("a table of the engine has no ") + wanted + " where one is expected");
  }

  template <class Kind>
  const Kind& get(const char* kind) const {
    const Kind* const found = std::get_if<Kind>(&value_);
    if (found == nullptr) refuse(kind);
    return *found;
  }
  template <class Visit>
  auto visit_integer(Visit visit) const {
    if (const auto* const number = std::get_if<std::int64_t>(&value_)) return visit(*number);
    return visit(get<std::uint64_t>("integer"));
  }

 public:
  Node() = default;
  Node(bool value) : value_(value) {}
  Node(double value) : value_(value) {}
  Node(std::string value) : value_(std::move(value)) {}
  Node(const char* value) : value_(std::string(value)) {}
  Node(Bytes value) : value_(std::move(value)) {}
  Node(List value) : value_(std::move(value)) {}
  Node(Map value) : value_(std::move(value)) {}
  template <class Integer, std::enable_if_t<std::is_integral_v<Integer> && !std::is_same_v<Integer, bool>, int> = 0>
  Node(Integer value) {
    if constexpr (std::is_signed_v<Integer>) {
      value_ = static_cast<std::int64_t>(value);
    } else {
      set_natural(value);
    }
  }

  bool is_none() const { return std::holds_alternative<std::monostate>(value_); }
  bool is_bool() const { return std::holds_alternative<bool>(value_); }
  bool is_integer() const {
    return std::holds_alternative<std::int64_t>(value_) || std::holds_alternative<std::uint64_t>(value_);
  }
  bool is_negative() const {
    const auto* const number = std::get_if<std::int64_t>(&value_);
    return number != nullptr && *number < 0;
  }
  bool is_float() const { return std::holds_alternative<double>(value_); }
  bool is_text() const { return std::holds_alternative<std::string>(value_); }
  bool is_bytes() const { return std::holds_alternative<Bytes>(value_); }
  bool is_list() const { return std::holds_alternative<List>(value_); }
  bool is_map() const { return std::holds_alternative<Map>(value_); }

  /// Return an integer of this type, or a bool or a double. Throws std::logic_error if it is none or does not fit: a
  /// table is our own, so that is our mistake.
  template <class Value>
  Value as() const {
    if constexpr (std::is_same_v<Value, bool>) {
      return get<bool>("bool");
    } else if constexpr (std::is_floating_point_v<Value>) {
      if (const auto* const number = std::get_if<double>(&value_)) return static_cast<Value>(*number);
      return visit_integer([](auto number) { return static_cast<Value>(number); });
    } else {
      return visit_integer([](auto number) {
        const auto fitting = static_cast<Value>(number);
        if (static_cast<decltype(number)>(fitting) != number || (fitting < 0) != (number < 0))
          refuse("fitting integer");
        return fitting;
      });
    }
  }
  /// Return an integer in two's complement of 64 bits.
  std::uint64_t bits() const {
    return visit_integer([](auto number) { return static_cast<std::uint64_t>(number); });
  }
  const std::string& text() const { return get<std::string>("text"); }
  const Bytes& bytes() const { return get<Bytes>("bytes"); }
  const List& list() const { return get<List>("list"); }
  const Map& map() const { return get<Map>("map"); }
  List& list() { return get_own<List>("list"); }
  Map& map() { return get_own<Map>("map"); }

  /// Return the value of this key. Throws std::logic_error if there is none, or this is not a map.
  const Node& operator[](const char* key) const;
  /// Return an element of a list. Throws std::out_of_range if there is none.
  template <class Place, std::enable_if_t<std::is_integral_v<Place>, int> = 0>
  const Node& operator[](Place place) const {
    return list().at(static_cast<std::size_t>(place));
  }
  /// Return the value of this key; null if there is none.
  const Node* find(const std::string& key) const;
  /// Append to a map.
  Node& add(std::string key, Node value) {
    map().emplace_back(std::move(key), std::move(value));
    return map().back().second;
  }

 private:
  void set_natural(std::uint64_t value) {
    if (value <= static_cast<std::uint64_t>(std::numeric_limits<std::int64_t>::max())) {
      value_ = static_cast<std::int64_t>(value);
    } else {
      value_ = value;
    }
  }
  template <class Kind>
  Kind& get_own(const char* kind) {
    Kind* const found = std::get_if<Kind>(&value_);
    if (found == nullptr) refuse(kind);
    return *found;
  }

  /// An integer is an std::uint64_t only beyond the range of the other.
  std::variant<std::monostate, bool, std::int64_t, std::uint64_t, double, std::string, Bytes, List, Map> value_;
};

/// Return the one value that these bytes are. Throws std::invalid_argument if they are none, or more, or too deep.
Node unpacked(const std::uint8_t* bytes, std::size_t size);

/// Append the value's bytes. Texts have to be UTF-8.
void pack(const Node& node, std::vector<std::uint8_t>& out);

}  // namespace wirebond::engine
