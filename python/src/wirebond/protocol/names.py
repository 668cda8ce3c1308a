"""Which names a protocol file may give, so that generated C++ and Python can use them as they are."""

from __future__ import annotations

import keyword
import re

PATTERN = r"^[a-z][a-z0-9]*(_[a-z0-9]+)*$"
MAX_LENGTH = 64

_SHAPE = re.compile(PATTERN)

_CPP_KEYWORDS = frozenset(
    (  # noqa: SIM905  (as text it stays a table)
        "alignas alignof and and_eq asm auto bitand bitor bool break case catch char char8_t char16_t "
        "char32_t class compl concept const consteval constexpr constinit const_cast continue co_await "
        "co_return co_yield decltype default delete do double dynamic_cast else enum explicit export "
        "extern false float for friend goto if inline int long mutable namespace new noexcept not not_eq "
        "nullptr operator or or_eq private protected public register reinterpret_cast requires return "
        "short signed sizeof static static_assert static_cast struct switch template this thread_local "
        "throw true try typedef typeid typename union unsigned using virtual void volatile wchar_t while "
        "xor xor_eq"
    ).split()
)
_MACROS = frozenset({"assert", "errno", "linux", "unix", "stdin", "stdout", "stderr"})  # of usual headers, lower case
_NAMESPACES = frozenset({"std", "wirebond"})


def fault(name: str) -> str:
    """What is wrong with a name and what would be right; empty if nothing is."""
    if not _SHAPE.match(name) or name.endswith("\n"):
        return "is not a name; a name is lower case: letters, digits and single underscores, a letter first"
    if len(name) > MAX_LENGTH:
        return f"is longer than {MAX_LENGTH} characters; take a shorter name"
    if name in _CPP_KEYWORDS:
        return f"is a keyword of C++, and code is generated from it; write for example `{name}_value`"
    if keyword.iskeyword(name):
        return f"is a keyword of Python; write for example `{name}_value`"
    if name in _MACROS:
        return f"is a macro in C and C++ headers; write for example `{name}_value`"
    return ""


def protocol_fault(name: str) -> str:
    """As `fault`, for a protocol's name, which becomes a namespace."""
    if name in _NAMESPACES:
        return f"is taken in C++, where the protocol's name becomes a namespace; write for example `{name}_link`"
    return fault(name)


def action_fault(name: str) -> str:
    """What is wrong with the name of a deadline's action, which becomes a function of the firmware's handler."""
    if name == "parameters":  # core/include/wirebond/mcu/link.hpp; the others overload
        return f"is the function by which a handler gives its parameters; write for example `{name}_expire`"
    return ""


def type_name(name: str) -> str:
    """The name of the C++ struct for a message: `status_query` becomes `StatusQuery`."""
    return "".join(word[:1].upper() + word[1:] for word in name.split("_"))
