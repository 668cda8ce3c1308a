"""Collecting problems of one protocol file, and the turns of phrase that their sentences share."""

from __future__ import annotations

import difflib
from collections.abc import Iterable
from dataclasses import dataclass
from typing import NoReturn

from wirebond.arguments import shown
from wirebond.errors import Problem, ProtocolFileError

_QUOTED_LENGTH = 40
_MOST_PROBLEMS = 100


@dataclass(frozen=True, order=True)
class Place:
    """A place in a text; both count from 1. ``WHOLE_FILE`` means no particular place."""

    line: int
    column: int


WHOLE_FILE = Place(0, 0)


class Problems:
    """The problems found so far, so that a file's author sees all of them at once."""

    def __init__(self, path: str) -> None:
        self.path = path
        self._found: list[Problem] = []

    def __len__(self) -> int:
        return len(self._found)

    def add(self, place: Place, sentence: str) -> None:
        self._found.append(Problem(self.path, place.line, place.column, sentence))

    def stop(self, place: Place, sentence: str) -> NoReturn:
        """Report a problem that ends the reading, with those found before it."""
        self.add(place, sentence)
        raise self._error()

    def raise_if_any(self) -> None:
        if self._found:
            raise self._error()

    def _error(self) -> ProtocolFileError:
        found = sorted(set(self._found))
        shown, more = found[:_MOST_PROBLEMS], found[_MOST_PROBLEMS:]
        if more:
            note = f"{len(more)} more problems from here on; correct the earlier ones first"
            shown.append(Problem(self.path, more[0].line, more[0].column, note))
        return ProtocolFileError(shown)


def quoted(text: str) -> str:
    """Return the file's own words, shortened, without line breaks or control characters."""
    shown = "".join(c if c.isprintable() else " " for c in text)
    return f"`{shown}`" if len(shown) <= _QUOTED_LENGTH else f"`{shown[: _QUOTED_LENGTH - 1]}…`"


def either(words: Iterable[str]) -> str:
    """Return ``a``, ``a or b``, ``a, b or c``."""
    names = list(words)
    return names[0] if len(names) == 1 else f"{', '.join(names[:-1])} or {names[-1]}"


def nearest(name: str, allowed: Iterable[str]) -> str:
    """Return the allowed word most like ``name``, or an empty text if none is like it."""
    found = difflib.get_close_matches(name[:_QUOTED_LENGTH].lower(), list(allowed), n=1, cutoff=0.6)
    return found[0] if found else ""


def no_message(protocol: str, wanted: object, messages: Iterable[str]) -> str:
    """Return the sentence that the protocol has no message of this name; it names the nearest, and all that there
    are."""
    names = list(messages)
    if not isinstance(wanted, str):
        return f"{shown(wanted)} is not a message's name; {protocol} has {', '.join(names)}"
    near = nearest(wanted, names)
    hint = f"did you mean {near}? " if near else ""
    return f"{protocol} has no message {shown(wanted)}; {hint}it has {', '.join(names)}"


def suggestion(name: str, allowed: Iterable[str]) -> str:
    """Return the advice for ``name``: the nearest word, and all possible ones if they are few."""
    words = list(allowed)
    near = nearest(name, words)
    hint = f"did you mean `{near}`?" if near else ""
    if not words:
        return "there is none"
    if len(words) <= 18:
        listing = f"{'possible' if len(words) > 1 else 'the only one'}: {', '.join(words)}"
        return f"{hint} ({listing})" if hint else listing
    return hint or f"there are {len(words)}, such as {', '.join(words[:6])}"
