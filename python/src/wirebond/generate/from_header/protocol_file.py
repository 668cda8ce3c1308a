"""The text of a first protocol file from a header's declarations, with a comment on all that it lacks."""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path

from wirebond.errors import ProtocolFileError
from wirebond.generate.from_header import names
from wirebond.generate.from_header.declarations import Declarations, Enum, Struct, read_declarations
from wirebond.generate.from_header.layout import MAX_FIELDS, Leaf, fields_of, number_of_fields, struct_size
from wirebond.generate.from_header.preprocess import Source, preprocess, read_header, stop
from wirebond.protocol.loader import loads
from wirebond.protocol.model import ByteOrder, End, Protocol
from wirebond.protocol.spelling import number_type

_MOST_PAYLOAD = 0xFFFF
_REST_BYTES = 64  # for an array without a size: the header does not say
_MAX_ENUM_NAMES = 1000  # of one enum: a protocol file has at most 20 000 values
_SMALL_TEXT = 50_000  # characters: no file of this size has too many values

_HEAD = """\
# Imported from {header}. A header does not say the following, so check it:
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

"""


@dataclass(frozen=True)
class Imported:
    """``text`` loads as a protocol file. ``notes``: sentences on what was left out."""

    text: str
    messages: int
    notes: tuple[str, ...]


def import_header(path: Path, protocol_name: str) -> Imported:
    """Read a C header; ``protocol_name`` is the new protocol's.

    :raises HeaderFileError: it is not C that can be read, or holds no struct that can be a message.
    :raises OSError: the file cannot be read.
    """
    source = preprocess(read_header(path), path)
    declared = read_declarations(source, path)
    text, messages, notes = _Writer(path, protocol_name, source, declared).write()
    _checked(text, path)
    return Imported(text, messages, notes)


def _checked(text: str, path: Path) -> Protocol:
    """Load the written file: anything imported must load, unless it is too large. Other faults are the writer's."""
    try:
        return loads(text, f"{path} (imported)")
    except ProtocolFileError as error:
        if len(text) < _SMALL_TEXT:
            raise
        reason = error.problems[0].sentence
        stop(path, 0, f"the protocol file of this header would be too large; import fewer structs at once ({reason})")


class _Writer:
    def __init__(self, path: Path, protocol_name: str, source: Source, declared: Declarations) -> None:
        self._path = path
        self._name = protocol_name
        self._source = source
        self._declared = declared
        self._used_enums: set[int] = set()
        self._taken = names.Names(are_types=True)  # of messages and types
        self._types: list[str] = []  # lines
        self._type_names: dict[int, str] = {}
        self._notes: list[str] = list(declared.left_out)
        self._notes += [
            f"enum {enum.name or 'without a name'} is left out, and its fields are plain integers: it has "
            f"{len(enum.values)} names, and at most {_MAX_ENUM_NAMES} are possible"
            for enum in declared.enums
            if _is_long(enum)
        ]

    def write(self) -> tuple[str, int, tuple[str, ...]]:
        structs = self._messages()
        if not structs:
            reasons = "; ".join(self._notes) or "it declares no struct with members"
            stop(self._path, 0, f"nothing here can become a message: {reasons}")
        constants = [pair for enum in self._declared.enums for pair in enum.values]
        constants += self._source.constants.items()
        ids = names.ids_by_name([struct.name for struct in structs], constants)
        words = [self._taken.take(struct.name) for struct in structs]
        lines: list[str] = []
        numbers = iter(number for number in range(1, 256) if number not in {value for _, value in ids.values()})
        for struct, word in zip(structs, words, strict=True):
            matched = ids.get(struct.name)
            number = matched[1] if matched else next(numbers, None)
            if number is None:
                stop(self._path, struct.line, "more than 255 structs; import fewer at once")
            lines += self._message(struct, word, number, matched[0] if matched else "")
        lines += self._other_enums({name for name, _ in ids.values()})
        header = _HEAD.format(
            header=_comment(self._path.name),
            name=self._name,
            ids=self._ids_text(len(ids), len(structs)),
            senders="guessed from names where they suggest one, else `host`",
            notes="".join(f"# Left out: {_comment(note)}.\n" for note in self._notes),
        )
        types = ["types:", *self._types] if self._types else []
        return header + "\n".join([*types, "messages:", *lines]) + "\n", len(structs), tuple(self._notes)

    @staticmethod
    def _ids_text(matched: int, count: int) -> str:
        if matched == count:
            return "taken from constants of the same name"
        return "counted from 0x01" if not matched else "taken from constants of the same name, else counted"

    def _messages(self) -> list[Struct]:
        found = []
        for struct in self._declared.structs:
            if struct.nested and not struct.fault:
                continue  # it appears in the messages that hold it
            if (not struct.name and not struct.fault) or struct.name.startswith("__"):
                continue  # a member's own type, or the C library's
            fault = struct.fault
            if not fault and (number_of_fields(struct) > MAX_FIELDS or struct_size(struct) > _MOST_PAYLOAD):
                fault = "it is too large for a message"
            if fault:
                shown = struct.name or "a struct without a name"
                self._notes.append(f"{shown} (line {struct.line}): {fault}")
            else:
                found.append(struct)
        return found

    def _message(self, struct: Struct, word: str, number: int, constant: str) -> list[str]:
        sender = names.sender_of(struct.name)
        guess = "a guess from its name" if sender else "not known: host or mcu"
        return [
            f"  {word}:  # {_struct_comment(struct)}",
            f"    id: 0x{number:02X}  # {_comment(constant) or 'counted, not known'}",
            f"    sender: {(sender or End.HOST).value}  # {guess}",
            "    fields:",
            *self._fields(struct, "      "),
            "",
        ]

    def _fields(self, struct: Struct, indent: str) -> list[str]:
        lines = []
        leaves = fields_of(struct)
        if any(leaf.kind == "padding" for leaf in leaves):
            lines.append(
                f"{indent}# The struct is not packed: `padding` marks the bytes that a 32-bit ARM compiler inserts."
            )
        taken = names.Names()
        for leaf in leaves:
            name = taken.take(leaf.name or "padding")
            lines += [f"{indent}# {_comment(note)}" for note in leaf.notes]
            lines.append(f"{indent}{name}: {{{', '.join(self._options(leaf))}}}")
        return lines

    def _options(self, leaf: Leaf) -> list[str]:
        options = [self._kind(leaf)]
        if leaf.rest:
            options.append(f"max: {_REST_BYTES}")
        elif leaf.kind in ("text", "bytes", "padding"):
            options.append(f"size: {leaf.size * (1 if leaf.count is None else leaf.count)}")
        elif leaf.count is not None and leaf.struct is None:
            options.append(f"count: {leaf.count}")
        if leaf.enum is not None and not _is_long(leaf.enum):
            self._used_enums.add(id(leaf.enum))
            options.append(f"enum: {{{_enum_text(leaf.enum)}}}")
        comment = self._source.comments.get(leaf.line, "")
        if comment and leaf.name:
            options.append(f"description: {json.dumps(_comment(comment), ensure_ascii=False)}")
        return options

    def _kind(self, leaf: Leaf) -> str:
        if leaf.struct is None:
            return f"type: {_type(leaf)}"
        of = self._type_of(leaf.struct, leaf.name)
        return f"struct: {of}" if leaf.count is None else f"group: {{count: {leaf.count}, fields: {of}}}"

    def _type_of(self, struct: Struct, member: str) -> str:
        """Return the name of a struct within others among the file's `types`; one without a name takes its member's."""
        known = self._type_names.get(id(struct))
        if known is not None:
            return known
        word = self._taken.take(struct.name or member)
        self._type_names[id(struct)] = word
        body = self._fields(struct, "    ")  # types within it come first
        self._types += [f"  {word}:  # {_struct_comment(struct)}", *body, ""]
        return word

    def _other_enums(self, id_names: set[str]) -> list[str]:
        lines: list[str] = []
        for enum in self._declared.enums:
            is_ids = any(name in id_names for name, _ in enum.values)
            if id(enum) not in self._used_enums and not is_ids and not _is_long(enum):
                lines.append(f"  #   {_comment(enum.name) or 'enum'}: {{{_enum_text(enum)}}}")
        if lines:
            lines.insert(
                0,
                "  # Enums that are not the type of any field. Add them to the fields that contain their values, as "
                "`enum:`:",
            )
        return lines


def _type(leaf: Leaf) -> str:
    return number_type(leaf.kind, leaf.size, ByteOrder.LITTLE) if leaf.kind in ("u", "i", "f") else leaf.kind


def _is_long(enum: Enum) -> bool:
    return len(enum.values) > _MAX_ENUM_NAMES


def _enum_text(enum: Enum) -> str:
    """Keep the first of several names with one value: a number has one name in a message."""
    seen: set[int] = set()
    pairs = []
    for name, value in names.enumerator_words(enum.values):
        if value not in seen:
            seen.add(value)
            pairs.append(f"{name}: {value}")
    return ", ".join(pairs)


def _struct_comment(struct: Struct) -> str:
    size = struct_size(struct)
    return f"struct {_comment(struct.name) or 'without a name'}, {size} byte{'s' * (size != 1)}"


def _comment(text: str) -> str:
    """Make a comment printable and of one line, so that it ends where the comment ends."""
    return " ".join("".join(c if c.isprintable() else " " for c in text).split())[:160]
