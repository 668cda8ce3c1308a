"""A protocol together with the compiled engine: encode, decode, statistics, columns."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

from wirebond import _engine
from wirebond.errors import MessageError, UsageError
from wirebond.log import LogLine, log_line
from wirebond.protocol import load as load_model
from wirebond.protocol import protocol_hash
from wirebond.protocol.model import End, Protocol
from wirebond.protocol.plan import Form, FormParts, ids_collide, parts_of_forms, plan_for
from wirebond.protocol.problems import no_message

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    Column = NDArray[np.generic] | list[str] | list[bytes]

Message = _engine.Message
Buffer = bytes | bytearray | memoryview
_MOST_THREADS = 64


@dataclass(frozen=True)
class Stats:
    """Where every received byte went. Exact after every ``feed``, ``idle`` and ``finish``:

    ``bytes == frame_bytes + fill_bytes + pending_bytes + sum(discarded_bytes.values())``
    """

    bytes: int
    frames: int
    unknown_frames: int
    frame_bytes: int
    fill_bytes: int
    pending_bytes: int
    discarded_bytes: dict[str, int]
    rejected_candidates: dict[str, int]
    messages: dict[str, int]

    def as_dict(self) -> dict[str, Any]:
        """For JSON: causes that did not occur are left out."""
        out = dict(vars(self))
        for key in ("discarded_bytes", "rejected_candidates"):
            out[key] = {cause: n for cause, n in out[key].items() if n}
        return out


class Decoder:
    """Bytes of one end in, messages out. Never waits and reads no clock: times come in, in seconds.

    Use it from one thread at a time.
    """

    def __init__(self, engine: _engine.Decoder, codec: Codec) -> None:
        self._engine = engine
        self._codec = codec

    def feed(self, data: Buffer, t: float = 0.0) -> list[Message]:
        """Messages that ``data``, read at time ``t``, completes. Any bytes are fine; what is no frame is counted."""
        return self._engine.feed(data, t)

    def expect(self, request: str | None) -> None:
        """``request`` goes out: where several messages share an id (or have none), its reply is meant from here on,
        until the next call. None: no reply is expected. Bytes that are pending are examined for it, too; where silence
        ends a frame, call ``idle`` first. A ``Link`` does this for what it sends.

        :raises UsageError: the protocol has no such message, or it has no ``reply``.
        """
        index = -1
        if request is not None:
            index = self._codec.index_of(self._codec.reply_to(request))
        self._engine.expect(index)

    def idle(self, t: float) -> list[Message]:
        """A read that began at ``t`` found nothing. After the protocol's ``idle`` time an incomplete frame is given
        up and its bytes are looked through again; messages behind a false start come out here."""
        return self._engine.idle(t)

    def finish(self) -> list[Message]:
        """No byte will ever follow: settle what is pending."""
        return self._engine.finish()

    @property
    def stats(self) -> Stats:
        return Stats(**self._engine.stats())


@dataclass(frozen=True)
class Table(Mapping[str, "Column"]):
    """Every occurrence of one message: a column per field, and each row's byte offset in the capture."""

    offset: NDArray[np.uint64]
    fields: dict[str, Column] = field(repr=False)

    def __getitem__(self, name: str) -> Column:
        return self.fields[name]

    def __iter__(self) -> Iterator[str]:
        return iter(self.fields)

    def __len__(self) -> int:
        """Number of fields; ``rows`` is the number of messages."""
        return len(self.fields)

    @property
    def rows(self) -> int:
        return len(self.offset)


@dataclass(frozen=True)
class Columns(Mapping[str, Table]):
    """A decoded capture: a table per message that occurred. ``unknown`` holds frames with unknown ids."""

    tables: dict[str, Table]
    stats: Stats

    def __getitem__(self, name: str) -> Table:
        return self.tables[name]

    def __iter__(self) -> Iterator[str]:
        return iter(self.tables)

    def __len__(self) -> int:
        return len(self.tables)


class Codec:
    """One protocol, ready to use. Immutable; any thread may use it."""

    def __init__(self, model: Protocol) -> None:
        self.model = model
        self._table = _engine.ProtocolTable(model)
        self._formats: dict[End | None, _engine.FormatTable] = {}
        self._forms: dict[End, list[tuple[FormParts, Form]]] = {}
        self._index = {message.name: i for i, message in enumerate(model.messages)}

    @property
    def name(self) -> str:
        return self.model.name

    @property
    def hash(self) -> int:
        """64 bits that change when anything on the wire does; the hello service compares it."""
        return protocol_hash(self.model)

    def encode(
        self,
        message: str,
        values: Mapping[str, Any] | None = None,
        /,
        *,
        header: Mapping[str, int] | None = None,
        **fields: Any,
    ) -> bytes:
        """One frame's bytes. Fields by keyword or as a mapping, in SI units; ``header`` gives the frame's own named
        fields where they differ from their defaults.

        :raises MessageError: unknown message or field, a value out of range, not finite or of the wrong type.
        """
        index = self._index.get(message)
        if index is None:
            raise MessageError(no_message(self.name, message, self._index))
        sender = self.model.messages[index].sender
        form, numbers = self._form_for(sender, header or {})
        everything = {**(values or {}), **fields}
        return _engine.encode(self._table, self.format_for(sender), index, everything, form, numbers)

    def _form_for(self, sender: End, header: Mapping[str, int]) -> tuple[int, list[int]]:
        """The form of the frame that these header values ask for, and a value for each of its header fields."""
        forms = self._forms_for(sender)
        known = {f.name: f for _, form in forms for f in form.header}
        for name, value in header.items():
            if name not in known:
                raise MessageError(f"the header has no field {name!r}; it has {', '.join(known) or 'none'}")
            mask = known[name].number.mask
            if not isinstance(value, int) or not 0 <= value <= mask:
                raise MessageError(f"header field {name} is {value!r}; expected an integer from 0 to {mask}")
        for index, (form_parts, form) in enumerate(forms):
            numbers = {f.name: header.get(f.name, f.default) for f in form.header}
            fits = all(bool(numbers[c.field] >> c.bit & 1) == truth for c, truth in form_parts.bits)
            if fits and set(header) <= set(numbers):
                return index, list(numbers.values())
        raise MessageError(f"no form of the frame has the header fields {', '.join(header)} together")

    def _forms_for(self, sender: End) -> list[tuple[FormParts, Form]]:
        if sender not in self._forms:
            plan = plan_for(self.model, sender)
            self._forms[sender] = list(zip(parts_of_forms(self.model.format.parts, sender), plan.forms, strict=True))
        return self._forms[sender]

    def decoder(self, sender: str | None = None) -> Decoder:
        """A decoder for what ``sender`` ("mcu" or "host") sends; without it, for both, where their ids differ.

        :raises UsageError: another sender, or ids that mean different messages in each direction.
        """
        format_table = self.format_for(self.sender_for(sender))
        return Decoder(_engine.Decoder(self._table, format_table, self.model.idle_seconds), self)

    def decode_columns(
        self,
        capture: Buffer,
        sender: str | None = None,
        *,
        threads: int | None = None,
        progress: Callable[[int, int], object] | None = None,
    ) -> Columns:
        """A whole capture at once, without a Python object per message.

        ``threads`` share a large capture (by default as many as the machine has cores); the result does not depend on
        them. ``progress(done, size)``, both in bytes, is called some ten times a second meanwhile, and at the end; for
        a capture of less than 256 KiB it is not called.

        Scaled fields are float64 in SI units; other numbers keep their wire type; enums and flags stay integers;
        arrays have shape (rows, count); text and bytes are lists. The capture's end settles an incomplete frame.
        """
        if threads is not None and threads < 1:
            raise UsageError(f"threads is {threads}; expected 1 or more, or None for as many as there are cores")
        threads = min(threads or os.cpu_count() or 1, _MOST_THREADS)
        form = self.format_for(self.sender_for(sender))
        result = _engine.decode_columns(self._table, form, capture, threads, progress)
        tables = {name: Table(**table) for name, table in result["messages"].items()}
        return Columns(tables, Stats(**result["stats"]))

    def format_for(self, sender: End | None) -> _engine.FormatTable:
        """The engine's tables for frames of this sender."""
        if sender not in self._formats:
            self._formats[sender] = _engine.FormatTable(plan_for(self.model, sender))
        return self._formats[sender]

    @property
    def table(self) -> _engine.ProtocolTable:
        """The engine's tables of the messages."""
        return self._table

    def index_of(self, message: str) -> int:
        return self._index[message]

    def reply_to(self, request: str) -> str:
        """The message that answers ``request``."""
        index = self._index.get(request)
        if index is None:
            raise UsageError(no_message(self.name, request, self._index))
        reply = self.model.messages[index].reply
        if reply is None:
            asking = ", ".join(m.name for m in self.model.messages if m.reply is not None) or "none"
            raise UsageError(f"{request} has no `reply` in {self.name}; messages that have one: {asking}")
        return reply

    def log_line(self, message: Message) -> LogLine | None:
        """What a received message says in the log, with its level; None where it is no log line."""
        index = self._index.get(message.name)
        return None if index is None else log_line(self.model, self.model.messages[index], message.fields)

    def request_for(self, reply: str) -> str | None:
        """The first message that ``reply`` answers."""
        return next((m.name for m in self.model.messages if m.reply == reply), None)

    def sender_for(self, sender: str | None) -> End | None:
        """Check a sender that a user named."""
        if sender is None:
            collisions = ids_collide(self.model)
            if collisions:
                first, second = collisions[0]
                raise UsageError(
                    f"in {self.name} the id 0x{first.id:02X} means {first.name} from {first.sender} and "
                    f"{second.name} from {second.sender}; say whose bytes these are: sender='mcu' or sender='host'"
                )
            return None
        if sender not in (End.HOST, End.MCU):
            raise UsageError(f"sender is {sender!r}; expected 'mcu' or 'host'")
        return End(sender)

    def __repr__(self) -> str:
        return f"<wirebond.Codec {self.name}: {', '.join(self._index)}>"


def load(path: str | os.PathLike[str]) -> Codec:
    """Read a protocol file.

    :raises ProtocolFileError: every problem of the file, each with line and column.
    """
    return Codec(load_model(path))


def names(messages: Iterable[Message]) -> list[str]:
    """The messages' names, in order: what tests and quick looks most often ask for."""
    return [message.name for message in messages]
