"""The text of a first protocol file from what a header declares, with a comment on all that it could not tell."""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path

from wirebond.c_header import names
from wirebond.c_header.declarations import Declarations, Enum, Struct, read_declarations
from wirebond.c_header.layout import Leaf, TooMany, fields_of, struct_size
from wirebond.c_header.preprocess import Source, preprocess, read_header, stop
from wirebond.protocol.loader import loads
from wirebond.protocol.model import ByteOrder, End, FieldKind, Protocol
from wirebond.protocol.spelling import number_type

_LETTERS = {FieldKind.UNSIGNED: "u", FieldKind.SIGNED: "i", FieldKind.FLOAT: "f"}
_MOST_PAYLOAD = 0xFFFF
_REST_BYTES = 64  # for an array without a size: the header does not say

_HEAD = """\
# Imported from {header}. What a header cannot tell, and what you should look at:
#   frame     how frames look on the wire; below is the recommended format for new links
#   id        {ids}
#   sender    {senders}
#   scale     a field that is an integer on the wire and a number in a unit: add `unit`, `scale` and `range`
#   every     how often a message is due; and `deadlines`, `emergency_stop`
{notes}wirebond: 1
protocol: {name}
link: {{baud: 115200}}

frame:
  - delimiter: 0x00
  - cobs:
    - id: u8
    - payload: rest
    - check: crc-16/ibm-sdlc
  - delimiter: 0x00

messages:
"""


@dataclass(frozen=True)
class Imported:
    """``text`` loads as a protocol file. ``notes``: sentences on what was left out."""

    text: str
    messages: int
    notes: tuple[str, ...]


def import_header(path: Path, protocol_name: str) -> Imported:
    """Read a C header; ``protocol_name`` is the new protocol's.

    :raises HeaderFileError: it is no C that can be read, or holds no struct that can be a message.
    :raises OSError: the file cannot be read.
    """
    source = preprocess(read_header(path), path)
    declared = read_declarations(source, path)
    text, messages, notes = _Writer(path, protocol_name, source, declared).write()
    _checked(text, path)
    return Imported(text, messages, notes)


def _checked(text: str, path: Path) -> Protocol:
    """Whatever was imported must load: what this raises would be an error of the writer."""
    return loads(text, f"{path} (imported)")


class _Writer:
    def __init__(self, path: Path, protocol_name: str, source: Source, declared: Declarations) -> None:
        self._path = path
        self._name = protocol_name
        self._source = source
        self._declared = declared
        self._used_enums: set[int] = set()
        self._notes: list[str] = list(declared.left_out)

    def write(self) -> tuple[str, int, tuple[str, ...]]:
        messages = self._messages()
        if not messages:
            reasons = "; ".join(self._notes) or "it declares no struct with members"
            stop(self._path, 0, f"nothing here can become a message: {reasons}")
        constants = [pair for enum in self._declared.enums for pair in enum.values]
        constants += self._source.constants.items()
        ids = names.ids_by_name([struct.name for struct, _ in messages], constants)
        lines: list[str] = []
        taken: list[str] = []
        numbers = iter(number for number in range(1, 256) if number not in {value for _, value in ids.values()})
        for struct, leaves in messages:
            word = names.message_word(struct.name, taken)
            taken.append(word)
            matched = ids.get(struct.name)
            number = matched[1] if matched else next(numbers, None)
            if number is None:
                stop(self._path, struct.line, "more than 255 structs; import fewer at once")
            lines += self._message(struct, leaves, word, number, matched[0] if matched else "")
        used_names = {name for name, _ in ids.values()}
        lines += self._other_enums(used_names)
        header = _HEAD.format(
            header=_comment(self._path.name),
            name=self._name,
            ids=self._ids_text(len(ids), len(messages)),
            senders="guessed from names where they suggest one, else `host`",
            notes="".join(f"# Left out: {_comment(note)}.\n" for note in self._notes),
        )
        return header + "\n".join(lines) + "\n", len(messages), tuple(self._notes)

    @staticmethod
    def _ids_text(matched: int, count: int) -> str:
        if matched == count:
            return "taken from constants of the same name"
        return "counted from 0x01" if not matched else "taken from constants of the same name, else counted"

    def _messages(self) -> list[tuple[Struct, list[Leaf]]]:
        found = []
        for struct in self._declared.structs:
            shown = struct.name or f"the struct in line {struct.line}"
            if struct.nested and not struct.fault:
                continue  # its members appear in the messages that hold it
            if (not struct.name and not struct.fault) or struct.name.startswith("__"):
                continue  # a member's own type, or the C library's
            try:
                leaves = [] if struct.fault else fields_of(struct)
                too_large = not struct.fault and struct_size(struct) > _MOST_PAYLOAD
            except TooMany:
                leaves, too_large = [], True
            if struct.fault:
                self._notes.append(f"{shown} (line {struct.line}): {struct.fault}")
            elif too_large:
                self._notes.append(f"{shown} (line {struct.line}): it is too large for a message")
            else:
                found.append((struct, leaves))
        return found

    def _message(self, struct: Struct, leaves: list[Leaf], word: str, number: int, constant: str) -> list[str]:
        sender = names.sender_of(struct.name)
        guess = "a guess from its name" if sender else "not known: host or mcu"
        size = struct_size(struct)
        lines = [
            f"  {word}:  # struct {_comment(struct.name)}, {size} byte{'s' * (size != 1)}",
            f"    id: 0x{number:02X}  # {_comment(constant) or 'counted, not known'}",
            f"    sender: {(sender or End.HOST).value}  # {guess}",
            "    fields:",
        ]
        if any(not leaf.path for leaf in leaves):
            lines.append("      # The struct is not packed: `padding` stands where a 32-bit ARM's compiler puts it.")
        taken: list[str] = []
        for leaf in leaves:
            name = names.protocol_word("_".join(leaf.path) or "padding", taken)
            taken.append(name)
            lines += [f"      # {_comment(note)}" for note in leaf.notes]
            lines.append(f"      {name}: {{{', '.join(self._options(leaf))}}}")
        return [*lines, ""]

    def _options(self, leaf: Leaf) -> list[str]:
        options = [f"type: {_type(leaf)}"]
        if leaf.rest:
            options.append(f"max: {_REST_BYTES}")
        elif leaf.kind in (FieldKind.TEXT, FieldKind.BYTES):
            options.append(f"size: {leaf.size * (1 if leaf.count is None else leaf.count)}")
        elif leaf.count is not None:
            options.append(f"count: {leaf.count}")
        if leaf.enum is not None:
            self._used_enums.add(id(leaf.enum))
            options.append(f"enum: {{{_enum_text(leaf.enum)}}}")
        comment = self._source.comments.get(leaf.line, "")
        if comment and leaf.path:
            options.append(f"description: {json.dumps(_comment(comment), ensure_ascii=False)}")
        return options

    def _other_enums(self, id_names: set[str]) -> list[str]:
        lines: list[str] = []
        for enum in self._declared.enums:
            is_ids = any(name in id_names for name, _ in enum.values)
            if id(enum) not in self._used_enums and not is_ids:
                lines.append(f"  #   {_comment(enum.name) or 'enum'}: {{{_enum_text(enum)}}}")
        if lines:
            lines.insert(
                0, "  # Enums that no field's type names. Write them behind the fields that hold them, as `enum:`:"
            )
        return lines


def _type(leaf: Leaf) -> str:
    if leaf.kind in _LETTERS:
        return number_type(_LETTERS[leaf.kind], leaf.size, ByteOrder.LITTLE)
    return leaf.kind.value


def _enum_text(enum: Enum) -> str:
    """Of names with one value the first stays: a number has one name in a message."""
    seen: set[int] = set()
    pairs = []
    for name, value in names.enumerator_words(enum.values):
        if value not in seen:
            seen.add(value)
            pairs.append(f"{name}: {value}")
    return ", ".join(pairs)


def _comment(text: str) -> str:
    """Printable and on one line, so that it ends where the comment ends."""
    return " ".join("".join(c if c.isprintable() else " " for c in text).split())[:160]
