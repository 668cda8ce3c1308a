"""The formats that are tried: each protocol file as a receiver reads it, and as one that knows no message reads it."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field, replace
from functools import cache, cached_property
from pathlib import Path

from wirebond import paths
from wirebond.analysis.check.frame_facts import ENDS, open_protocol, senders
from wirebond.codec import Codec
from wirebond.errors import ProtocolFileError
from wirebond.protocol import load
from wirebond.protocol.model import End, PartKind, PayloadRule, Protocol
from wirebond.protocol.planning import expecting, plan_for, told_by_request


@dataclass(frozen=True)
class View:
    """A way to read a format: as bytes of ``sender``; ``knows``: its frames are of messages that the file lists."""

    codec: Codec
    sender: End
    knows: bool


@dataclass(frozen=True)
class Format:
    """A protocol that may be on the wire. ``read_as``: the same, in a way that needs no silence to find frames."""

    model: Protocol
    read_as: Protocol | None

    @property
    def name(self) -> str:
        return self.model.name

    @cached_property
    def views(self) -> tuple[View, ...]:
        return tuple(_views(self.read_as)) if self.read_as is not None else ()

    @cached_property
    def wire(self) -> tuple[object, ...]:
        """Equal for two formats exactly if their frames look the same, whatever messages they carry."""
        return tuple(_look(self.model, end) for end in ENDS)


def _views(model: Protocol) -> Iterator[View]:
    for sender in senders(model):
        names = sorted(told_by_request(model.messages, sender))
        meant = [expecting(model, name) for name in names] or [model]
        for one in meant:
            yield View(Codec(one), sender, knows=True)
        anything = open_protocol(model, sender, model.format.max_payload)
        if anything is not None:
            yield View(Codec(anything), sender, knows=False)


def _look(model: Protocol, end: End) -> object:
    """Return the appearance of this end's frames; the names of parts do not matter."""
    plan = plan_for(model, end)
    forms = tuple(
        replace(form, header=tuple(replace(number, name="", default=0) for number in form.header))
        for form in plan.forms
    )
    return (
        plan.framing,
        plan.opening,
        plan.closing,
        plan.stuffing,
        plan.escapes,
        plan.insertion,
        plan.length_on_wire,
        forms,
        plan.algorithms,
    )


def without_silence(model: Protocol) -> Protocol | None:
    """Return the same format with frame sizes given by the messages instead of by silence, because a capture has no
    times and a USB adapter hides silences. None: a message's own bytes do not give its size."""
    if not model.format.ends_by_silence:
        return model
    messages = tuple(m for m in model.messages if not any(field.reaches_end for field in m.fields))
    if not messages:
        return None
    kept = {message.name for message in messages}
    parts = tuple(
        replace(part, payload=PayloadRule.BY_ID) if part.kind == PartKind.PAYLOAD else part
        for part in model.format.parts
    )
    return replace(
        model,
        format=replace(model.format, parts=parts, ends_by_silence=False, deliver_unknown=False),
        messages=tuple(replace(m, reply=m.reply if m.reply in kept else None) for m in messages),
        deadlines=(),
        emergency_stop=(),
        services=(),
        examples=(),
    )


def format_of(model: Protocol) -> Format:
    return Format(model, without_silence(model))


@dataclass
class Known:
    """``unreadable``: files that are no protocol files, or wrong ones, with the reason."""

    formats: list[Format] = field(default_factory=list)
    unreadable: dict[Path, str] = field(default_factory=dict)


def known_formats(also: Iterable[Path] = ()) -> Known:
    """Return the project's files, the public formats, and those of ``also``: files, or folders of them.

    :raises ProtocolFileError: a file that was named itself is wrong.
    """
    shipped = _shipped()
    known = Known(list(shipped.formats), dict(shipped.unreadable))
    own = [folder.resolve() for folder in paths.protocol_folders()]
    seen = {Path(each.model.path).resolve() for each in known.formats}
    for place in also:
        if place.resolve() not in own:
            _add(known, place, seen, is_named=True)
    return known


@cache
def _shipped() -> Known:
    """Return the formats of the package, read once."""
    known = Known()
    for folder in paths.protocol_folders():
        _add(known, folder, set(), is_named=False)
    return known


def _add(known: Known, place: Path, seen: set[Path], *, is_named: bool) -> None:
    is_folder = place.is_dir()
    for file in sorted(place.glob("*.y*ml")) if is_folder else [place]:
        if file.resolve() in seen:
            continue
        seen.add(file.resolve())
        try:
            known.formats.append(format_of(load(file)))
        except ProtocolFileError as error:
            if is_named and not is_folder:
                raise
            known.unreadable[file] = str(error)
