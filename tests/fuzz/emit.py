"""Headers that the C++ targets are compiled from, made from protocol files. Nothing generated is committed."""

from __future__ import annotations

import random
import zlib
from fractions import Fraction
from pathlib import Path

from tests.fuzz.files import SHAPES
from tests.random_formats import random_protocol
from tests.shared import PROTOCOLS, ROOT
from wirebond.generate.code.cpp import cpp_header
from wirebond.generate.code.cpp_ends import rules_views
from wirebond.generate.code.cpp_format import format_lines
from wirebond.generate.code.cpp_names import struct_names
from wirebond.generate.code.names import namespace
from wirebond.protocol import ProtocolFileError, load, loads
from wirebond.protocol.model import End, Field, Protocol
from wirebond.protocol.planning import plan_for

FILES = sorted(
    [*PROTOCOLS.glob("*.yaml"), *PROTOCOLS.glob("contrib/*.yaml"), *(ROOT / "tests" / "formats").glob("*.yaml")]
)
RANDOM_FILES = 80
# Together they have every shape of field, and numbers of every type.
FIELD_FILES = [SHAPES / "every_shape.yaml", SHAPES / "every_type.yaml"]


def write_sources(target: str, folder: Path) -> list[Path]:
    """All that this target needs beside what is committed; the source files of it that are compiled by themselves."""
    if target == "fields":
        _write_messages(folder)
        return []
    source = folder / "real_formats.cpp"
    source.write_text(_real_formats(), encoding="utf-8")
    return [source]


def _real_formats() -> str:
    """The source file that defines ``fuzz::real_formats``: for each of ``FILES`` and sender its format and messages."""
    functions = []
    for protocol in [*map(load, FILES), *_random_protocols()]:
        for end in (End.HOST, End.MCU):
            if any(message.sent_by(end) for message in protocol.messages):
                functions.append(_function(f"format_{len(functions)}", protocol, end))
    return "\n".join(
        [
            "// The frame formats of the protocol files.",
            '#include "described.hpp"',
            *functions,
            "std::vector<fuzz::Described> fuzz::real_formats() {",
            f"  return {{{', '.join(f'format_{number}()' for number in range(len(functions)))}}};",
            "}",
            "",
        ]
    )


def _random_protocols() -> list[Protocol]:
    """Files that combine what the others have one by one; the same ones each time."""
    found = []
    for seed in range(RANDOM_FILES):
        try:
            found.append(loads(random_protocol(random.Random(f"fuzz {seed}"), seed)))
        except ProtocolFileError:
            continue
    return found


def _function(name: str, protocol: Protocol, end: End) -> str:
    """The function that makes the format, and the messages' rules, which it points at."""
    plan = plan_for(protocol, end)
    rules = {view.index: view for view in rules_views(protocol, plan)}
    tables, rows = [], []
    for row in plan.messages:
        view = rules.get(row.index)
        pointers = {"constants": "nullptr", "counts": "nullptr"}
        sizes = {"constants": 0, "counts": 0}
        for kind, type_name in (("constants", "PayloadConstant"), ("counts", "PayloadCount")):
            entries = getattr(view, kind, ())
            if entries:
                pointers[kind] = f"{kind}_{row.index}"
                sizes[kind] = len(entries)
                tables.append(f"static const wirebond::{type_name} {pointers[kind]}[] = {{{', '.join(entries)}}};")
        shape = f"{{{row.index}, {row.min_payload}, {row.max_payload}, {row.seed}}}"
        listed = f"{pointers['constants']}, {pointers['counts']}, {sizes['constants']}, {sizes['counts']}"
        applied = f"{{{listed}, {row.rules.most_beside}}}"
        rows.append(f"{{{row.id}U, {shape}, {str(row.only_expected).lower()}, {applied}}}")
    lines = [
        f"static fuzz::Described {name}() {{  // {protocol.name} from {end.value}",
        *(f"  {line}" for line in tables),
        "  wirebond::FrameFormat format{};",
        *(f"  {line}" for line in format_lines(plan)),
        f"  return {{format, {{{', '.join(rows)}}}}};",
        "}",
    ]
    return "\n".join(lines)


def bound_rounds_past(field: Field) -> bool:
    """Does a bound of the field, or of one within it, become a wire number that stands for a value outside the range?

    Such a value is received, for its bound may be sent, and cannot be sent itself.
    """
    if any(map(bound_rounds_past, field.fields)):
        return True
    if not field.is_scaled or field.minimum is None or field.maximum is None:
        return False
    bounds = (Fraction(str(bound)) for bound in (field.minimum, field.maximum))
    return any(((bound - field.offset) / field.scale).denominator != 1 for bound in bounds)


def may_grow(field: Field) -> bool:
    """May the field, or one within it, be received in fewer characters than it is written in?

    A number in characters up to an end may leave out digits behind its point.
    """
    if any(map(may_grow, field.fields)):
        return True
    return field.digits is not None and field.digits.decimals > 0 and field.size == 0


def _write_messages(folder: Path) -> None:
    """``messages.hpp``, the list of all generated messages with a key each, and the generated headers beside it."""
    includes, entries = [], []
    for path in FIELD_FILES:
        protocol = load(path)
        (folder / f"{protocol.name}.hpp").write_text(cpp_header(protocol), encoding="utf-8")
        includes.append(f'#include "{protocol.name}.hpp"')
        structs = struct_names(protocol)
        space = namespace(protocol.name)
        for message in protocol.messages:
            source = "FromMcu" if message.sender == End.MCU else "FromHost"
            rounds, grows = (str(any(map(may, message.fields))).lower() for may in (bound_rounds_past, may_grow))
            check = f"check<{space}::{structs[message.name]}, {space}::{source}, {rounds}, {grows}>"
            name = f"{protocol.name}.{message.name}"
            entries.append((zlib.crc32(name.encode()) & 0xFFFF, f'"{name}", {check}'))
    lines = [f"    {{{key}, {entry}}}," for key, entry in sorted(entries)]
    text = [
        "// Every message of the protocol files, by rising key.",
        "#pragma once",
        "#include <array>",
        *includes,
        "namespace fuzz {",
        "template <class Message, class Source, bool BoundRoundsPast, bool MayGrow>",
        "void check(const std::uint8_t* payload, std::size_t size);",
        "struct Entry {",
        "  std::uint16_t key;",
        "  const char* name;",
        "  void (*check)(const std::uint8_t*, std::size_t);",
        "};",
        f"inline constexpr std::array<Entry, {len(lines)}> messages = {{{{",
        *lines,
        "}};",
        "}  // namespace fuzz",
        "",
    ]
    (folder / "messages.hpp").write_text("\n".join(text), encoding="utf-8")
