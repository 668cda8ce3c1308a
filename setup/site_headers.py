"""The reference of C++ and C: the documented declarations of public headers, as pages of the documentation's site.

tree-sitter parses the headers. A declaration is listed with the `///` comment before it or behind it, as it is written,
without its body. Private members, and what has no comment, is left out.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import tree_sitter_cpp
from tree_sitter import Language, Node, Parser

ROOT = Path(__file__).resolve().parents[1]
CPP = {
    "A link on a microcontroller": (
        "core/include/wirebond/mcu/link.hpp",
        "core/include/wirebond/mcu/link_sending.hpp",
        "core/include/wirebond/mcu/link_receiving.hpp",
        "core/include/wirebond/mcu/link_counters.hpp",
        "core/include/wirebond/mcu/buffers.hpp",
        "core/include/wirebond/mcu/subscription.hpp",
        "core/include/wirebond/mcu/driver_enable.hpp",
        "core/include/wirebond/mcu/why.hpp",
    ),
    "Frames without a link": (
        "core/include/wirebond/receiver.hpp",
        "core/include/wirebond/message.hpp",
        "core/include/wirebond/handler.hpp",
        "core/include/wirebond/deadline.hpp",
        "core/include/wirebond/sequence.hpp",
        "core/include/wirebond/violation.hpp",
        "core/include/wirebond/status.hpp",
    ),
    "Ports": (
        "ports/stm32_hal/include/wirebond/stm32_hal/uart.hpp",
        "ports/stm32_ll/include/wirebond/stm32_ll/uart.hpp",
        "ports/gd32_spl/include/wirebond/gd32_spl/uart.hpp",
        "ports/bare_metal/include/wirebond/bare_metal/uart.hpp",
        "ports/usb_cdc/include/wirebond/usb_cdc/stm32.hpp",
        "ports/usb_cdc/include/wirebond/usb_cdc/tinyusb.hpp",
        "ports/freertos/include/wirebond/freertos/tasks.hpp",
        "ports/arduino/include/wirebond/arduino/stream.hpp",
        "ports/posix/include/wirebond/posix/port.hpp",
    ),
    "A host": ("core/include/wirebond/host/link.hpp",),
}
C = {
    "A link on a microcontroller": (
        "core/include/wirebond/mcu/c_api.h",
        "core/include/wirebond/mcu/why.h",
        "core/include/wirebond/mcu/dma_uart.h",
    ),
}
_SCOPES = (
    "namespace_definition", "linkage_specification", "declaration_list", "preproc_ifdef", "preproc_if", "preproc_else",
)  # fmt: skip
_TYPES = ("class_specifier", "struct_specifier", "union_specifier", "enum_specifier")
_LISTED = (
    *_TYPES, "field_declaration", "function_definition", "declaration", "template_declaration", "alias_declaration",
    "type_definition", "enumerator", "preproc_def", "preproc_function_def",
)  # fmt: skip


@dataclass
class Entry:
    """One documented declaration, and those within it."""

    declaration: str
    text: str
    name: str
    within: list[Entry]


def pages() -> dict[str, str]:
    """Return the text of each page by its file's name."""
    return {"api-cpp.md": _page("C++", CPP), "api-c.md": _page("C", C)}


def _page(language: str, parts: dict[str, tuple[str, ...]]) -> str:
    begin = (
        f"After this page you know each function and type that your {language} code can use. It is made from the "
        "headers; generated code adds the types of your messages."
    )
    lines = [f"# {language} headers", "", begin, ""]
    for part, headers in parts.items():
        lines += [f"## {part}", ""]
        for header in headers:
            lines += _header(ROOT / header)
    return "\n".join(lines) + "\n"


def _header(path: Path) -> list[str]:
    source = path.read_bytes()
    tree = Parser(Language(tree_sitter_cpp.language())).parse(source)
    about = []
    for line in source.decode().splitlines():
        if not line.startswith("// "):
            break
        about.append(line[3:])
    entries = [entry for entry in _entries(tree.root_node) if entry.text or entry.within]
    if not entries:
        return []
    name = str(path)[str(path).index("include/") + len("include/") :]
    return [f"### `{name}`", "", " ".join(about), "", *(line for entry in entries for line in _lines(entry, 4))]


def _lines(entry: Entry, level: int) -> Iterator[str]:
    if entry.within:
        yield from (f"{'#' * level} `{entry.name}`", "")
    yield from ("```cpp", entry.declaration, "```", "")
    if entry.text:
        yield from (entry.text, "")
    for one in entry.within:
        yield from _lines(one, min(level + 1, 6))


def _entries(scope: Node) -> Iterator[Entry]:
    """Yield the public, documented declarations of a file, a namespace or a type, in their order."""
    comments: list[str] = []
    is_public = scope.parent is None or scope.parent.type != "class_specifier"
    for node in scope.children:
        text = node.text.decode() if node.text else ""
        if node.type == "access_specifier":
            is_public = text.startswith("public")
        elif node.type == "comment":
            comments = (
                [*comments, text[3:].removeprefix(" ").rstrip()]
                if text.startswith("///") and not text.startswith("///<")
                else []
            )
        elif node.type in _SCOPES and "detail" not in text.partition("{")[0]:
            yield from _entries(node)
            comments = []
        elif node.type in _LISTED:
            body = _body(node)
            entry = Entry(
                _declaration(node, body),
                _markdown(comments) or _behind(node),
                _name(node),
                [one for one in _entries(body) if one.text] if body is not None and _type(node) else [],
            )
            if is_public and (entry.text or entry.within):
                yield entry
            comments = []
        elif node.is_named:
            comments = []


def _type(node: Node) -> Node | None:
    """Return the class, struct, union or enum that this declares, if it does."""
    return next((one for one in (node, *node.children) if one.type in _TYPES and _body(one)), None)


def _body(node: Node) -> Node | None:
    found = node.child_by_field_name("body")
    if found is None:
        inner = [child for child in node.children if child.type in (*_TYPES, "function_definition")]
        found = next((body for child in inner if (body := _body(child))), None)
    return found


def _declaration(node: Node, body: Node | None) -> str:
    """Return the source without the body, initialisers and private bases."""
    source = node.text.decode() if node.text else ""
    if body is not None:
        source = source[: body.start_byte - node.start_byte]
        tail = r"\)\s*:\s.*" if _type(node) is None else r"()\s+:\s+private\s.*"
        source = re.sub(tail, ")" if _type(node) is None else "", source, flags=re.DOTALL)
    indent = node.start_point.column
    lines = [line.removeprefix(" " * indent) for line in source.rstrip().splitlines()]
    kept = "\n".join(line for line in lines if not line.lstrip().startswith("//"))
    return re.sub(r"\bWIREBOND_INLINE\w*\s+", "", kept).rstrip(" {;")


def _name(node: Node) -> str:
    found = _type(node)
    name = found.child_by_field_name("name") if found is not None else None
    return name.text.decode() if name is not None and name.text else "type"


def _behind(node: Node) -> str:
    after = node.next_sibling
    while after is not None and after.type in (",", ";"):
        after = after.next_sibling
    if after is None or after.type != "comment" or after.start_point.row != node.end_point.row or not after.text:
        return ""
    return _markdown([after.text.decode().removeprefix("///<").removeprefix("///")])


def _is_code(line: str) -> bool:
    return line.startswith("    ")


def _markdown(comments: list[str]) -> str:
    """Return the comment as Markdown, which wants an empty line before a list, and before and after code."""
    lines: list[str] = []
    for line in comments:
        last = lines[-1] if lines else ""
        begins_list = line.startswith("- ") and not any(one.startswith("- ") for one in lines[-3:])
        if last and (begins_list or _is_code(line) != _is_code(last)):
            lines.append("")
        lines.append(line if _is_code(line) else line.strip())
    return "\n".join(lines).strip("\n")
