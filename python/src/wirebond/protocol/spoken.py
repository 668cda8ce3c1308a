"""The version in which an MCU sends, if a format has several: the one whose magics have the same parts as the received
magic."""

from __future__ import annotations

import contextlib
from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import Any, TypeVar

from wirebond.errors import MessageError
from wirebond.protocol.model import End, Part, PartKind, Subject
from wirebond.protocol.model.forms import magics, parts_of_forms

_Made = TypeVar("_Made")
_Header = Mapping[str, Any] | None


class SpokenVersion:
    """The version that the host spoke last, in which an MCU sends all that names no magic itself."""

    def __init__(self, parts: tuple[Part, ...]) -> None:
        self._answering = answering_magics(parts)
        self._field = _magic_field(parts) if self._answering else ""
        self._magics: tuple[int, ...] = ()  # none: the default version

    @property
    def is_one_of_several(self) -> bool:
        """Does the format have more than one?"""
        return bool(self._answering)

    def hear(self, header: Mapping[str, Any]) -> None:
        """Note that a frame of the host with this header came."""
        if self._answering:
            self._magics = self._answering.get(header[self._field], ())

    def make(self, frame: Callable[[_Header], _Made], header: _Header) -> _Made:
        """Call ``frame`` with this header in the version that was heard. Where the message has no such frame, which is
        a ``MessageError``, with ``header`` as it is."""
        if self._magics and self._field not in (header or {}):
            for magic in self._magics:
                with contextlib.suppress(MessageError):
                    return frame({**(header or {}), self._field: magic})
        return frame(header)


def answering_magics(parts: tuple[Part, ...]) -> dict[int, tuple[int, ...]]:
    """Return, by the number of a magic of the host, those of the MCU that answer it, the one to be tried first before
    others. Magics that the MCU's default answers are left out."""
    mine = {magic: _version(parts, End.MCU, magic) for magic in magics(parts, End.MCU)}
    if len(set(mine.values())) < 2:
        return {}
    default = next(iter(mine.values()))
    found: dict[int, tuple[int, ...]] = {}
    for magic in magics(parts, End.HOST):
        version = _version(parts, End.HOST, magic)
        answers = tuple(_number(own) for own, other in mine.items() if other == version)
        if version != default and answers:
            found[_number(magic)] = answers
    return found


def _magic_field(parts: tuple[Part, ...]) -> str:
    return next(part.header.name for part in parts if part.kind == PartKind.MAGIC and part.header is not None)


def _version(parts: tuple[Part, ...], sender: End, magic: bytes) -> frozenset[Part]:
    """Return the parts that this magic announces. A length is none: one of another width is for another size of
    payload."""
    return frozenset(
        replace(part, condition=None, ranges=((0, 0),))
        for form in parts_of_forms(parts, sender)
        if any(part.kind == PartKind.MAGIC and part.value == magic for part in form.parts)
        for part in form.parts
        if part.kind != PartKind.LENGTH and _depends_on_magic(part)
    )


def _depends_on_magic(part: Part) -> bool:
    return part.condition is not None and any(c.subject == Subject.MAGIC for c in part.condition.comparisons)


def _number(magic: bytes) -> int:
    return int.from_bytes(magic, "big")
