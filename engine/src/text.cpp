// Numbers and bytes in sentences, written as Python writes them; and UTF-8.
#include "wirebond/engine/text.hpp"

#include <charconv>
#include <cmath>
#include <cstdio>
#include <cstdlib>

namespace wirebond::engine {

namespace {

/// Return how many bytes the character at the front has; 0 if none is there. `wrong`: bytes to replace then.
std::size_t character(std::string_view bytes, std::size_t& wrong) {
  const auto at = [&](std::size_t i) { return static_cast<unsigned char>(bytes[i]); };
  wrong = 1;
  const unsigned first = at(0);
  if (first < 0x80) return 1;
  const std::size_t size = first < 0xC2 ? 0 : first < 0xE0 ? 2 : first < 0xF0 ? 3 : first < 0xF5 ? 4 : 0;
  if (size == 0) return 0;
  for (std::size_t i = 1; i < size; ++i, ++wrong) {
    if (i == bytes.size()) return 0;
    // The second byte's range leaves out longer forms than needed, halves of UTF-16 pairs, and numbers beyond Unicode.
    const unsigned least = i != 1 ? 0x80 : first == 0xE0 ? 0xA0 : first == 0xF0 ? 0x90 : 0x80;
    const unsigned most = i != 1 ? 0xBF : first == 0xED ? 0x9F : first == 0xF4 ? 0x8F : 0xBF;
    if (at(i) < least || at(i) > most) return 0;
  }
  return size;
}

/// Append a character (Latin-1) as a quoted text has it.
void append_quoted(std::string& out, unsigned char character, char quote) {
  const bool is_printable = (character >= 0x20 && character < 0x7F) || (character > 0xA0 && character != 0xAD);
  if (character == '\\' || character == static_cast<unsigned char>(quote)) {
    out += '\\';
    out += static_cast<char>(character);
  } else if (character == '\n' || character == '\r' || character == '\t') {
    out += character == '\n' ? "\\n" : character == '\r' ? "\\r" : "\\t";
  } else if (!is_printable) {
    char text[5];
    std::snprintf(text, sizeof text, "\\x%02x", character);
    out += text;
  } else if (character < 0x80) {
    out += static_cast<char>(character);
  } else {
    out += static_cast<char>(0xC0 | character >> 6);
    out += static_cast<char>(0x80 | (character & 0x3F));
  }
}

/// Return the first characters of a UTF-8 text.
std::string_view first_characters(std::string_view text, std::size_t count) {
  std::size_t at = 0;
  for (; at < text.size() && count != 0; --count) {
    ++at;
    while (at < text.size() && (static_cast<unsigned char>(text[at]) & 0xC0) == 0x80) ++at;
  }
  return text.substr(0, at);
}

}  // namespace

std::string number_text(double value) {
  if (std::isnan(value)) return "nan";
  if (std::isinf(value)) return value < 0 ? "-inf" : "inf";
  char text[32];
  const auto end = std::to_chars(text, text + sizeof text, value, std::chars_format::scientific).ptr;
  // Sign, digits and exponent of `-1.25e-07`.
  std::string_view written(text, static_cast<std::size_t>(end - text));
  const std::size_t mark = written.find('e');
  const int exponent = std::atoi(std::string(written.substr(mark + 1)).c_str());
  const bool is_negative = written[0] == '-';
  std::string digits;
  for (const char one : written.substr(0, mark)) {
    if (one >= '0' && one <= '9') digits += one;
  }
  std::string out = is_negative ? "-" : "";
  if (exponent < -4 || exponent >= 16) {
    out += digits.substr(0, 1) + (digits.size() > 1 ? "." + digits.substr(1) : "");
    return out.append(written.substr(mark));
  }
  if (exponent < 0) return out + "0." + std::string(static_cast<std::size_t>(-exponent - 1), '0') + digits;
  const auto whole = static_cast<std::size_t>(exponent) + 1;
  if (digits.size() <= whole) return out + digits + std::string(whole - digits.size(), '0');
  return out + digits.substr(0, whole) + "." + digits.substr(whole);
}

std::string hex_text(std::uint64_t value) {
  char text[19];
  std::snprintf(text, sizeof text, "0x%llX", static_cast<unsigned long long>(value));
  return text;
}

std::string hex_text(std::string_view bytes) {
  std::string text;
  for (const char byte : bytes) {
    char one[6];
    std::snprintf(one, sizeof one, "0x%02X", static_cast<unsigned>(static_cast<unsigned char>(byte)));
    text += (text.empty() ? "" : " ") + std::string(one);
  }
  return text;
}

std::string quoted(std::string_view characters) {
  constexpr std::size_t most = 80;
  const bool has_single = characters.find('\'') != std::string_view::npos;
  const char quote = has_single && characters.find('"') == std::string_view::npos ? '"' : '\'';
  std::string out(1, quote);
  for (const char one : characters) append_quoted(out, static_cast<unsigned char>(one), quote);
  out += quote;
  if (first_characters(out, most).size() == out.size()) return out;
  return std::string(first_characters(out, most - 3)) + "...";
}

bool is_utf8(std::string_view bytes) {
  std::size_t wrong = 0;
  while (!bytes.empty()) {
    const std::size_t size = character(bytes, wrong);
    if (size == 0) return false;
    bytes.remove_prefix(size);
  }
  return true;
}

std::string with_replacements(std::string_view bytes) {
  std::string out;
  std::size_t wrong = 0;
  while (!bytes.empty()) {
    const std::size_t size = character(bytes, wrong);
    if (size == 0) {
      out += "\xEF\xBF\xBD";
    } else {
      out += bytes.substr(0, size);
    }
    bytes.remove_prefix(size == 0 ? wrong : size);
  }
  return out;
}

}  // namespace wirebond::engine
