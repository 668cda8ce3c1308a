"""The text of a log line, which stays in the file: what it says, and the fields whose values it shows."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from wirebond.protocol import names
from wirebond.protocol.model import Field
from wirebond.protocol.problems import quoted, suggestion


@dataclass(frozen=True)
class Shown:
    """The place of a field's value."""

    field: str


class LogTextError(ValueError):
    """A fault in the text, as a sentence."""


def log_pieces(text: str) -> tuple[str | Shown, ...]:
    """Split ``"motor {motor} is hot"`` into the words and the values between them. ``{{`` and ``}}`` are braces.

    :raises LogTextError: a brace that has no other.
    """
    pieces: list[str | Shown] = []
    words, at = "", 0
    while at < len(text):
        if text.startswith(("{{", "}}"), at):
            words, at = words + text[at], at + 2
        elif text[at] == "{":
            end = text.find("}", at)
            name = text[at + 1 : end] if end > 0 else ""
            if names.fault(name):
                rest = text[at : end + 1] if end > 0 else text[at:]
                raise LogTextError(f"{quoted(rest)} names no field; write `{{field}}`, or `{{{{` for a brace")
            pieces += [words, Shown(name)]
            words, at = "", end + 1
        elif text[at] == "}":
            raise LogTextError("`}` ends nothing here; write `}}` for a brace")
        else:
            words, at = words + text[at], at + 1
    pieces.append(words)
    return tuple(piece for piece in pieces if piece)


def log_fault(text: str, fields: Sequence[Field] | None) -> str:
    """Return the fault of this text for a message with these fields; empty: none. None: the fields themselves are
    wrong."""
    if not text.strip():
        return "a log line says something; write for example `log: motor {motor} is too hot`"
    if not text.isprintable():
        return "a log line is one line of printable characters; take the others out"
    try:
        pieces = log_pieces(text)
    except LogTextError as error:
        return str(error)
    if fields is None:
        return ""
    values = [field.name for field in fields if field.has_value]
    for piece in pieces:
        if isinstance(piece, Shown) and piece.field not in values:
            return f"there is no field `{piece.field}` to show here; {suggestion(piece.field, values)}"
    return ""
