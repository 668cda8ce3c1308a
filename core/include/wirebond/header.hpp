// Header fields as a struct: converts between the struct of a generated namespace and the numbers of a frame. No
// message.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <type_traits>

#include "wirebond/examine.hpp"
#include "wirebond/format.hpp"
#include "wirebond/placed_number.hpp"
#include "wirebond/source.hpp"
#include "wirebond/unroll.hpp"

namespace wirebond {

/// Header of frames without header fields.
struct NoHeader {};

namespace detail {

template <class Source, class = void>
struct HeaderType {
  using type = NoHeader;
};
template <class Source>
struct HeaderType<Source, std::void_t<typename Source::Header>> {
  using type = typename Source::Header;
};

}  // namespace detail

/// Struct with the header fields of the source's frames. A generated source provides it as `Header`, and its sender's
/// defaults as `static constexpr Header header()`. The struct's namespace supplies
///
///   bool write_header(const Header&, std::uint64_t* numbers);   // false: a value is out of range, or has no name
///   void read_header(const std::uint64_t* numbers, Header&);
///   Violation violations(const Header&);
///
/// over the wire's numbers, in the order of `HeaderField::place`.
template <class Source>
using HeaderOf = typename detail::HeaderType<Source>::type;
template <class Source>
inline constexpr bool has_header = !std::is_same_v<HeaderOf<Source>, NoHeader>;

namespace detail {

/// Number of header fields of the protocol; a generated source counts those of the other end's frames, too, because its
/// Header includes them.
template <class Source, class = void>
inline constexpr std::size_t named_header_fields = 0;
template <class Source>
inline constexpr std::size_t named_header_fields<Source, std::void_t<decltype(Source::header_defaults)>> =
    Source::header_defaults.size();
template <class Source>
constexpr std::size_t count_header_fields() {
  std::size_t count = named_header_fields<Source>;
  for (std::size_t i = 0; i < Source{}.format().form_count; ++i) {
    const Form& form = Source{}.format().forms[i];
    for (std::size_t f = 0; f < form.header_count; ++f) {
      if (form.header[f].place >= count) count = form.header[f].place + std::size_t{1};
    }
  }
  return count;
}
template <class Source>
using HeaderNumbers = std::array<std::uint64_t, count_header_fields<Source>()>;

template <class Source>
constexpr HeaderNumbers<Source> make_default_numbers() {
  HeaderNumbers<Source> numbers{};
  if constexpr (named_header_fields<Source> != 0) return Source::header_defaults;
  for (std::size_t i = 0; i < Source{}.format().form_count; ++i) {
    const Form& form = Source{}.format().forms[i];
    for (std::size_t f = 0; f < form.header_count; ++f) numbers[form.header[f].place] = form.header[f].default_value;
  }
  return numbers;
}
/// Default header values of the source's sender.
template <class Source>
inline constexpr HeaderNumbers<Source> default_numbers = make_default_numbers<Source>();

/// Call fn(field) for each header field of the frame's form.
template <class Source, class Fn>
WIREBOND_INLINE void each_header_field(const Frame& frame, Fn&& fn) {
  constexpr Source source{};
  every<true, part_counts<Source>.forms>(0, source.format().form_count, [&](std::size_t i) WIREBOND_INLINE_LAMBDA {
    if (frame.form != i) return true;
    const Form& form = source.format().forms[i];
    every<true, part_counts<Source>.header_fields>(0, form.header_count, [&](std::size_t f) WIREBOND_INLINE_LAMBDA {
      fn(form.header[f]);
      return true;
    });
    return false;
  });
}

/// Build a sender's header values; those that differ from the defaults are marked as given.
template <class Source>
WIREBOND_INLINE HeaderValues values_of(const HeaderNumbers<Source>& numbers) {
  std::uint32_t given = 0;
  every<true, max_header_fields>(0, numbers.size(), [&](std::size_t i) WIREBOND_INLINE_LAMBDA {
    if (numbers[i] != default_numbers<Source>[i]) given |= std::uint32_t{1} << i;
    return true;
  });
  return {numbers.data(), given};
}

/// Header values changed to those that the message's frames have (`settle_match`), and which of them count as given for
/// that reason.
template <class Source>
struct SettledNumbers : HeaderNumbers<Source> {
  std::uint32_t settled = 0;
};

template <class Source>
WIREBOND_INLINE HeaderValues values_of(const SettledNumbers<Source>& numbers) {
  HeaderValues values = values_of<Source>(static_cast<const HeaderNumbers<Source>&>(numbers));
  values.given |= numbers.settled;
  return values;
}

/// Whether the argument after the message is the source's Header. False for wire numbers and for no argument.
template <class Source, class... Given>
inline constexpr bool is_header = false;
template <class Source, class Given>
inline constexpr bool is_header<Source, Given> = has_header<Source>&& std::is_same_v<Given, HeaderOf<Source>>;
/// Whether the argument is already these numbers, by index.
template <class Source, class... Given>
inline constexpr bool is_numbers = false;
template <class Source, class Given>
inline constexpr bool is_numbers<Source, Given> = std::is_same_v<Given, HeaderNumbers<Source>>;

}  // namespace detail

/// Return the header of a frame from `Source`. A field that the frame's form lacks has its default. The frame's
/// pointers must still be valid: call it inside the handler.
template <class Source>
WIREBOND_INLINE HeaderOf<Source> header_of(const Frame& frame) {
  static_assert(has_header<Source>, "frames of this protocol have no header field");
  auto numbers = detail::default_numbers<Source>;
  detail::each_header_field<Source>(frame, [&](const HeaderField& field) WIREBOND_INLINE_LAMBDA {
    numbers[field.place] = detail::read_wide(field.number, frame.bytes, frame.size);
  });
  HeaderOf<Source> header = Source::header();
  read_header(numbers.data(), header);
  return header;
}

}  // namespace wirebond
