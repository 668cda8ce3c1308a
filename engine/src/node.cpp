// A value as a tree, and its bytes: the part of MessagePack without extensions.
#include "wirebond/engine/node.hpp"

#include <cstring>

#include "wirebond/bytes.hpp"

namespace wirebond::engine {

namespace {

constexpr unsigned most_depth = 64;  // of lists in lists; protocols have fewer

class Reader {
 public:
  Reader(const std::uint8_t* bytes, std::size_t size) : next_(bytes), end_(bytes + size) {}

  Node whole() {
    Node node = one();
    if (next_ != end_) throw std::invalid_argument("bytes follow the value");
    return node;
  }

 private:
  Node one() {
    const auto first = static_cast<std::uint8_t>(number(1));
    if (first <= 0x7F) return Node(first);
    if (first <= 0x8F) return map(first & 0x0Fu);
    if (first <= 0x9F) return list(first & 0x0Fu);
    if (first <= 0xBF) return text(first & 0x1Fu);
    if (first >= 0xE0) return Node(static_cast<std::int8_t>(first));
    switch (first) {
      case 0xC0: return {};
      case 0xC2: return Node(false);
      case 0xC3: return Node(true);
      case 0xC4:
      case 0xC5:
      case 0xC6: return bytes(number(1u << (first - 0xC4u)));
      case 0xCA: return Node(static_cast<double>(as<float>(static_cast<std::uint32_t>(number(4)))));
      case 0xCB: return Node(as<double>(number(8)));
      case 0xCC:
      case 0xCD:
      case 0xCE:
      case 0xCF: return Node(number(1u << (first - 0xCCu)));
      case 0xD0: return Node(static_cast<std::int8_t>(number(1)));
      case 0xD1: return Node(static_cast<std::int16_t>(number(2)));
      case 0xD2: return Node(static_cast<std::int32_t>(number(4)));
      case 0xD3: return Node(static_cast<std::int64_t>(number(8)));
      case 0xD9:
      case 0xDA:
      case 0xDB: return text(number(1u << (first - 0xD9u)));
      case 0xDC:
      case 0xDD: return list(number(2u << (first - 0xDCu)));
      case 0xDE:
      case 0xDF: return map(number(2u << (first - 0xDEu)));
      default: throw std::invalid_argument("a value of no known kind");
    }
  }

  template <class Float, class Bits>
  static Float as(Bits bits) {
    static_assert(sizeof(Float) == sizeof(Bits));
    Float value;
    std::memcpy(&value, &bits, sizeof value);
    return value;
  }

  const std::uint8_t* take(std::uint64_t size) {
    if (size > static_cast<std::uint64_t>(end_ - next_)) throw std::invalid_argument("a value is cut short");
    const std::uint8_t* const from = next_;
    next_ += size;
    return from;
  }

  std::uint64_t number(unsigned size) {
    return load_bytes(take(size), static_cast<std::uint8_t>(size), ByteOrder::big);
  }

  Node bytes(std::uint64_t size) {
    const std::uint8_t* const from = take(size);
    return Node(Node::Bytes(from, from + size));
  }

  std::string characters(std::uint64_t size) {
    const auto* const from = reinterpret_cast<const char*>(take(size));
    return std::string(from, static_cast<std::size_t>(size));
  }

  Node text(std::uint64_t size) { return Node(characters(size)); }

  Node list(std::uint64_t count) {
    const Deeper deeper(depth_);
    Node::List out;
    for (; count != 0; --count) out.push_back(one());
    return Node(std::move(out));
  }

  Node map(std::uint64_t count) {
    const Deeper deeper(depth_);
    Node::Map out;
    for (; count != 0; --count) {
      Node key = one();
      if (!key.is_text()) throw std::invalid_argument("a key is not text");
      std::string name = key.text();
      out.emplace_back(std::move(name), one());
    }
    return Node(std::move(out));
  }

  /// Counts lists in lists.
  struct Deeper {
    explicit Deeper(unsigned& depth) : depth_(depth) {
      if (++depth_ > most_depth) throw std::invalid_argument("lists lie too deep in lists");
    }
    ~Deeper() { --depth_; }
    Deeper(const Deeper&) = delete;
    Deeper& operator=(const Deeper&) = delete;

   private:
    unsigned& depth_;
  };

  const std::uint8_t* next_;
  const std::uint8_t* end_;
  unsigned depth_ = 0;
};

class Writer {
 public:
  explicit Writer(std::vector<std::uint8_t>& out) : out_(out) {}

  void write(const Node& node) {
    if (node.is_none()) {
      put(0xC0);
    } else if (node.is_bool()) {
      put(node.as<bool>() ? 0xC3 : 0xC2);
    } else if (node.is_integer()) {
      write_integer(node);
    } else if (node.is_float()) {
      std::uint64_t bits = 0;
      const double value = node.as<double>();
      std::memcpy(&bits, &value, sizeof bits);
      put(0xCB, bits, 8);
    } else if (node.is_text()) {
      const std::string& text = node.text();
      put(0xDB, text.size(), 4);
      out_.insert(out_.end(), text.begin(), text.end());
    } else if (node.is_bytes()) {
      const Node::Bytes& bytes = node.bytes();
      put(0xC6, bytes.size(), 4);
      out_.insert(out_.end(), bytes.begin(), bytes.end());
    } else if (node.is_list()) {
      put(0xDD, node.list().size(), 4);
      for (const Node& one : node.list()) write(one);
    } else {
      put(0xDF, node.map().size(), 4);
      for (const auto& [key, value] : node.map()) {
        write(Node(key));
        write(value);
      }
    }
  }

 private:
  void put(std::uint8_t kind) { out_.push_back(kind); }

  void put(std::uint8_t kind, std::uint64_t number, std::uint8_t size) {
    put(kind);
    out_.resize(out_.size() + size);
    store_bytes(out_.data() + out_.size() - size, number, size, ByteOrder::big);
  }

  void write_integer(const Node& node) {
    const std::uint64_t bits = node.bits();
    if (bits <= 0x7F) return put(static_cast<std::uint8_t>(bits));
    put(node.is_negative() ? 0xD3 : 0xCF, bits, 8);
  }

  std::vector<std::uint8_t>& out_;
};

}  // namespace

const Node& Node::operator[](const char* key) const {
  const Node* const found = find(key);
  if (found == nullptr) throw std::logic_error(std::string("a table of the engine has no '") + key + "'");
  return *found;
}

const Node* Node::find(const std::string& key) const {
  for (const auto& [name, value] : map()) {
    if (name == key) return &value;
  }
  return nullptr;
}

Node unpacked(const std::uint8_t* bytes, std::size_t size) { return Reader(bytes, size).whole(); }

void pack(const Node& node, std::vector<std::uint8_t>& out) { Writer(out).write(node); }

}  // namespace wirebond::engine
