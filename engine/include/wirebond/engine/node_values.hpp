// Values as nodes: for a language that has none of its own here, such as JavaScript.
#pragma once

#include <cmath>
#include <cstddef>
#include <cstdint>
#include <limits>
#include <optional>
#include <string>
#include <string_view>
#include <utility>

#include "wirebond/engine/element.hpp"
#include "wirebond/engine/errors.hpp"
#include "wirebond/engine/node.hpp"
#include "wirebond/engine/text.hpp"

namespace wirebond::engine {

/// See fields.hpp. A whole number may come as a float: JavaScript has one kind of number.
struct NodeValues {
  using Value = Node;
  using Ref = const Node&;
  using List = Node::List;
  using Map = Node::Map;

  static constexpr const char* map_name = "an object";

  // ---- making
  static Node none() { return {}; }
  static Node boolean(bool value) { return Node(value); }
  static Node floating(double value) { return Node(value); }
  static Node integer(std::int64_t value) { return Node(value); }
  static Node natural(std::uint64_t value) { return Node(value); }
  static Node text(std::string_view bytes) { return Node(with_replacements(bytes)); }
  static Node bytes(std::string_view bytes) { return Node(Node::Bytes(bytes.begin(), bytes.end())); }
  static Node enumerator(const FieldTable& field, std::size_t i) { return Node(field.enumerators[i].first); }
  static Node flag(const FieldTable& field, std::size_t i) { return Node(field.flags[i].first); }
  static List make_list(std::size_t size) { return List(size); }
  static void put(List& list, std::size_t i, Node&& value) { list[i] = std::move(value); }
  static void append(List& list, Node&& value) { list.push_back(std::move(value)); }
  static Map make_map(std::size_t size) {
    Map map;
    map.reserve(size);
    return map;
  }
  static void set(Map& map, const FieldTable& field, Node&& value) { map.emplace_back(field.name, std::move(value)); }
  static Node made(List&& list) { return Node(std::move(list)); }
  static Node made(Map&& map) { return Node(std::move(map)); }
  static Node default_value(const FieldTable& field) { return field.default_value; }

  // ---- reading
  static bool is_none(Ref value) { return value.is_none(); }
  static bool is_integer(Ref value) { return index(value).has_value(); }
  static bool is_sequence(Ref value) { return value.is_list(); }
  static bool is_several(Ref value) { return value.is_list(); }
  static bool is_map(Ref value) { return value.is_map(); }
  static bool is_name(const FieldTable& field, Ref key) { return key.is_text() && key.text() == field.name; }
  static bool is_enumerator(const FieldTable& field, std::size_t i, Ref value) {
    return value.is_text() && value.text() == field.enumerators[i].first;
  }
  static bool is_flag(const FieldTable& field, std::size_t i, Ref value) {
    return value.is_text() && value.text() == field.flags[i].first;
  }
  static std::size_t size(Ref list) { return list.list().size(); }
  static std::size_t map_size(Ref map) { return map.map().size(); }
  static const Node& item(Ref list, std::size_t i) { return list[i]; }
  static std::optional<Node> get(Ref map, const FieldTable& field) {
    const Node* const found = map.find(field.name);
    return found == nullptr ? std::nullopt : std::optional<Node>(*found);
  }
  template <class Each>
  static void each(Ref list, Each each) {
    for (const Node& one : list.list()) each(one);
  }
  template <class Each>
  static void each_key(Ref map, Each each) {
    for (const auto& [key, value] : map.map()) each(Node(key));
  }
  template <class Each>
  static void each_item(Ref map, Each each) {
    for (const auto& [key, value] : map.map()) each(Node(key), value);
  }

  static std::optional<bool> as_bool(Ref value) {
    if (value.is_bool()) return value.as<bool>();
    const std::optional<std::int64_t> bit = as_signed(value);
    return bit && (*bit == 0 || *bit == 1) ? std::optional<bool>(*bit == 1) : std::nullopt;
  }
  static double number(Ref value, const Path& path) {
    if (value.is_float() || value.is_integer()) return value.as<double>();
    if (value.is_bool()) return value.as<bool>() ? 1 : 0;
    throw MessageError(path.text() + " is " + shown(value) + " (" + type_name(value) + "); expected a number");
  }
  static std::optional<std::int64_t> as_signed(Ref value) {
    const std::optional<Node> whole = index(value);
    if (!whole || (!whole->is_negative() && whole->bits() >> 63 != 0)) return std::nullopt;
    return static_cast<std::int64_t>(whole->bits());
  }
  static std::optional<std::uint64_t> as_unsigned(Ref value) {
    const std::optional<Node> whole = index(value);
    return !whole || whole->is_negative() ? std::nullopt : std::optional<std::uint64_t>(whole->bits());
  }
  /// Return the value as an integer, if it is a whole number that 64 bits hold.
  static std::optional<Node> index(Ref value) {
    if (value.is_integer()) return value;
    if (value.is_bool()) return Node(value.as<bool>() ? 1 : 0);
    if (!value.is_float()) return std::nullopt;
    const double number = value.as<double>();
    constexpr double beyond = 18446744073709551616.0;  // 2^64
    if (number != std::floor(number) || !(number >= -beyond / 2 && number < beyond)) return std::nullopt;
    return number < 0 ? Node(static_cast<std::int64_t>(number)) : Node(static_cast<std::uint64_t>(number));
  }
  static Node whole(double number) { return Node(number); }

  static std::string shown(Ref value) {
    if (value.is_none()) return "null";
    if (value.is_bool()) return value.as<bool>() ? "true" : "false";
    if (value.is_integer())
      return value.is_negative() ? std::to_string(value.as<std::int64_t>()) : std::to_string(value.bits());
    if (value.is_float()) return number_text(value.as<double>());
    if (value.is_text()) return quoted(value.text());
    return std::string(type_name(value));
  }
  static const char* type_name(Ref value) {
    if (value.is_none()) return "nothing";
    if (value.is_bool()) return "a truth value";
    if (value.is_integer() || value.is_float()) return "a number";
    if (value.is_text()) return "a text";
    if (value.is_bytes()) return "bytes";
    return value.is_list() ? "a list" : "an object";
  }

  /// The bytes of a text, or of bytes; those may be written as hexadecimal digits.
  class Characters {
   public:
    Characters(const FieldTable& field, Ref value, const Path& path);
    std::string_view view() const { return bytes_; }

   private:
    std::string bytes_;
  };
};

}  // namespace wirebond::engine
