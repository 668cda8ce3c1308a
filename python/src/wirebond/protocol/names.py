"""The names that a protocol file may use, and their forms in generated code."""

from __future__ import annotations

import keyword
import re
from collections.abc import Iterable

PATTERN = r"^[A-Za-z][A-Za-z0-9]*(_[A-Za-z0-9]+)*$"
PATH_PATTERN = r"^[A-Za-z][A-Za-z0-9]*(_[A-Za-z0-9]+)*(\.[A-Za-z][A-Za-z0-9]*(_[A-Za-z0-9]+)*)*$"
PROTOCOL_PATTERN = r"^[a-z][a-z0-9]*(_[a-z0-9]+)*$"  # becomes a namespace and names of files
MAX_LENGTH = 64

_SHAPE = re.compile(PATTERN)
_PROTOCOL_SHAPE = re.compile(PROTOCOL_PATTERN)
_NEW_WORD = re.compile(r"(?<=[a-z])(?=[A-Z])|(?<=[A-Z0-9])(?=[A-Z][a-z])")

_CPP_KEYWORDS = frozenset(
    (  # noqa: SIM905  (as text it stays a table)
        "alignas alignof and and_eq asm auto bitand bitor bool break case catch char char8_t char16_t "
        "char32_t class compl concept const consteval constexpr constinit const_cast continue co_await "
        "co_return co_yield decltype default delete do double dynamic_cast else enum explicit export "
        "extern false float for friend goto if inline int long mutable namespace new noexcept not not_eq "
        "nullptr operator or or_eq private protected public register reinterpret_cast requires return "
        "short signed sizeof static static_assert static_cast struct switch template this thread_local "
        "throw true try typedef typeid typename union unsigned using virtual void volatile wchar_t while "
        "xor xor_eq "
        "typeof typeof_unqual"  # of GNU C and C++, in which compilers read unless they are given -std=c++17
    ).split()
)
# In lower case: those of usual headers, then those that GNU compilers define by themselves for one system or processor.
_MACROS = frozenset({"assert", "errno", "stdin", "stdout", "stderr"}) | {
    "linux", "unix", "i386", "mips", "sparc", "sun", "m68k", "mc68000", "hppa", "hpux", "vax",
}  # fmt: skip
_NAMESPACES = frozenset({"std", "wirebond"})


def fault(name: str) -> str:
    """Return the fault of a name and its correction; empty if there is none. Keywords of languages are allowed."""
    if not _SHAPE.match(name) or name.endswith("\n"):
        return "is not a name; a name has letters, digits and single underscores, a letter first"
    if len(name) > MAX_LENGTH:
        return f"is longer than {MAX_LENGTH} characters; take a shorter name"
    return ""


def path_fault(path: str) -> str:
    """Check names joined by dots, as `fault`: a field within a struct, or among bits."""
    return next((found for name in path.split(".") if (found := fault(name))), "")


def protocol_fault(name: str) -> str:
    """Check a protocol's name, as `fault`: it becomes a namespace and names of files."""
    if name in _NAMESPACES:
        return (
            f"is a reserved word in C++, and the protocol's name becomes a namespace; write for example `{name}_link`"
        )
    if fault(name) or not _PROTOCOL_SHAPE.match(name):
        return fault(name) or (
            "cannot be a protocol's name, because it becomes a namespace and names of files: lower case, a letter "
            f"first; write `{code_name(name)}`"
        )
    if name in _CPP_KEYWORDS:
        return f"is a keyword of C++, and code is generated from it; write for example `{name}_value`"
    if keyword.iskeyword(name):
        return f"is a keyword of Python; write for example `{name}_value`"
    if name in _MACROS:
        return f"is a macro in C and C++ headers; write for example `{name}_value`"
    return ""


# ---- the names of generated code: lower case, words with `_` between them


def code_name(name: str) -> str:
    """Return the form of a name in generated code: `MotorSpeed`, `motorSpeed` and `Motor_Speed` all become
    `motor_speed`, and `RPM` becomes `rpm`."""
    return _NEW_WORD.sub("_", name).lower()


def identifier(name: str) -> str:
    """Return the same as an identifier of C++ and C: `class` becomes `class_`."""
    found = code_name(name)
    return found + "_" if found in _CPP_KEYWORDS | _MACROS else found


def python_identifier(name: str) -> str:
    """Return the same as an identifier of Python."""
    found = code_name(name)
    return found + "_" if keyword.iskeyword(found) else found


def meeting(names: Iterable[str]) -> list[tuple[str, str]]:
    """Return names that are equal in generated code, each with the earlier one."""
    first: dict[str, str] = {}
    pairs = []
    for name in names:
        other = first.setdefault(code_name(name), name)
        if other != name:
            pairs.append((name, other))
    return pairs


def meeting_fault(name: str, other: str) -> str:
    return f"`{name}` and `{other}` are both `{code_name(name)}` in generated code; rename one"


def action_fault(name: str) -> str:
    """Return the fault in the name of a deadline's action, which becomes a function of the firmware's handler."""
    if code_name(name) == "parameters":  # core/include/wirebond/mcu/link.hpp; the others overload
        return f"is the function by which a handler gives its parameters; write for example `{name}_expire`"
    return ""


def type_name(name: str) -> str:
    """Return the name of the C++ struct for a message: `status_query` becomes `StatusQuery`, and `NAV_PVT` `NavPvt`."""
    return "".join(word[:1].upper() + word[1:] for word in code_name(name).split("_"))
