"""The stream of a link for recorders: every read and every write with its time, and events."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from types import TracebackType
from typing import TYPE_CHECKING, Any, Protocol, Self

from wirebond.arguments import whole
from wirebond.errors import UsageError

if TYPE_CHECKING:
    from wirebond.codec import Codec

TAP_BYTES = 1 << 22  # that wait for their reader: more than 10 s of both directions at 2 Mbaud
NOTE_BYTES = 4096  # of one noted event, as JSON


@dataclass(frozen=True, slots=True)
class Chunk:
    """A read or a write of the port.

    :ivar t: seconds on ``time.monotonic()`` when it was done.
    :ivar before: of a read: when it began, which is the ``t`` of the messages that it completed; of a write ``t``.
    :ivar direction: ``"received"`` or ``"sent"``.
    :ivar bytes: as they were on the wire.
    """

    t: float
    before: float
    direction: str
    bytes: bytes


@dataclass(frozen=True, slots=True)
class LinkEvent:
    """Something that happened to the link.

    :ivar t: seconds on ``time.monotonic()``.
    :ivar kind: ``port_up``; ``port_down``, with ``why``; ``port_settings``, which another program had changed;
        ``stopped`` and ``released``, of the emergency stop; ``deadline_struck`` and ``deadline_ended``, with
        ``action``; ``lease_begun`` and ``lease_ended``, with ``message``, ``address`` where frames have one, and
        ``why`` it ended; or what a program noted.
    :ivar facts: the values that belong to it.
    """

    t: float
    kind: str
    facts: Mapping[str, Any] = field(default_factory=dict)


RawPiece = tuple[str, int, int, bytes]  # kind, when a read began and when it was done in microseconds, bytes


@dataclass(frozen=True, slots=True)
class RawTaken:
    """Like `Taken`, without an object for each piece."""

    pieces: Sequence[RawPiece]
    lost_pieces: int
    lost_received_bytes: int
    lost_sent_bytes: int


@dataclass(frozen=True, slots=True)
class Taken:
    """Everything since the last ``take``, in order, and what was dropped because that was too long ago."""

    pieces: Sequence[Chunk | LinkEvent]
    lost_pieces: int
    lost_received_bytes: int
    lost_sent_bytes: int


class RunningRecorder(Protocol):
    """A recorder at work, as ``link.record`` returns it: see ``wirebond.Recorder``."""

    @property
    def seconds(self) -> float: ...
    @property
    def size(self) -> int: ...
    @property
    def safe_size(self) -> int: ...
    @property
    def messages(self) -> int: ...
    def close(self, *, compact: bool = True) -> None: ...
    def __enter__(self) -> Self: ...
    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None: ...


class TapSource(Protocol):
    """Whatever can be recorded: a link, or an object that stands for one."""

    codec: Codec

    @property
    def role(self) -> str:
        """The end that the link plays: ``"host"`` or ``"mcu"``."""
        ...

    def tap(self, capacity: int = TAP_BYTES) -> Tap:
        """Begin to keep what is read, written and happens."""
        ...


class Tap:
    """Open from its making to ``close``. The link never waits for it: what does not fit is dropped and counted. One
    thread at a time. After the link has ended, ``take`` still gives what had come."""

    def __init__(self, engine: Any, capacity: int, actions: Sequence[str], messages: Sequence[str]) -> None:
        capacity = whole("the tap's capacity", capacity, 1024, 1 << 30, "bytes")
        self._engine = engine
        self._actions = actions
        self._messages = messages
        self._number: int = engine.open_tap(capacity)

    def take(self) -> Taken:
        """Return everything since the last call, at once."""
        pieces, *lost = self._engine.take_tap(self._number)
        return Taken([self._piece(*piece) for piece in pieces], *lost)

    def take_raw(self) -> RawTaken:
        """Return the same for a caller that takes thousands per second; ``event`` converts the pieces that are not
        bytes to events."""
        return RawTaken(*self._engine.take_tap(self._number))

    def event(self, piece: RawPiece) -> LinkEvent:
        """Convert a piece to an event."""
        made = self._piece(*piece)
        assert isinstance(made, LinkEvent)
        return made

    def close(self) -> None:
        """Remove the tap from the link. A second call does nothing."""
        self._engine.close_tap(self._number)

    def _piece(self, kind: str, before: int, t: int, data: bytes) -> Chunk | LinkEvent:
        if kind in ("received", "sent"):
            return Chunk(t * 1e-6, before * 1e-6, kind, data)  # as the engine makes the time of a message
        if kind == "noted":
            noted = json.loads(data)
            return LinkEvent(t * 1e-6, noted.pop("kind"), noted)
        return LinkEvent(t * 1e-6, kind, self._facts(kind, data))

    def _facts(self, kind: str, data: bytes) -> dict[str, Any]:
        if kind == "port_down":
            return {"why": data.decode(errors="replace") or "the link was closed"}
        if kind.startswith("deadline"):
            return {"action": self._actions[data[0]]}
        if kind.startswith("lease"):
            message, address, *why = data.decode().split(" ")
            return {"message": self._messages[int(message)], "address": int(address)} | ({"why": why[0]} if why else {})
        return {}


def noted(kind: str, facts: Mapping[str, Any]) -> str:
    """Return the text by which a link keeps an event of a program.

    :raises UsageError: it is not JSON, or too long.
    """
    if not kind or "kind" in facts:
        raise UsageError(f"an event needs a kind, and no fact called 'kind'; it has {kind!r} and {', '.join(facts)}")
    try:
        text = json.dumps({"kind": kind, **facts}, ensure_ascii=True, allow_nan=False)
    except (TypeError, ValueError) as error:
        raise UsageError(f"the event {kind} cannot be written as JSON ({error}); give texts and numbers") from None
    if len(text) > NOTE_BYTES:
        raise UsageError(f"the event {kind} has {len(text)} characters as JSON; expected at most {NOTE_BYTES}")
    return text
