"""A protocol together with the compiled engine: encode, decode, statistics, columns.

One file: the encoder and the decoder, with the tables and counts that they return.
"""

from __future__ import annotations

import os
from collections.abc import Callable, ItemsView, Iterator, KeysView, Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

from wirebond import _engine
from wirebond.arguments import path as path_of
from wirebond.arguments import shown
from wirebond.engine_tables import EngineTables, as_mapping
from wirebond.errors import MessageError, UsageError
from wirebond.protocol import load as load_model
from wirebond.protocol import protocol_hash
from wirebond.protocol.counter_values import McuCounters, mcu_counters
from wirebond.protocol.log import LogLine, log_line
from wirebond.protocol.model import End, Protocol
from wirebond.protocol.model import Message as MessageModel
from wirebond.protocol.planning import plan_for
from wirebond.protocol.problems import no_message

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    Column = NDArray[np.generic] | list[str] | list[bytes]

Message = _engine.Message
Buffer = bytes | bytearray | memoryview
_MOST_THREADS = 64


@dataclass(frozen=True)
class SequenceCounts:
    """Results of the sequence numbers of received frames. Each number is compared with the previous one of the same
    peer (with ``per: message``: and of the same message). The first one only starts the count.

    :ivar numbered: frames whose number was compared.
    :ivar gaps: missing frames: numbers that were skipped.
    :ivar repeats: frames with the number of the frame before.
    :ivar restarts: jumps of more than half the range: the peer restarted. The loss there is unknown.
    """

    numbered: int
    gaps: int
    repeats: int
    restarts: int

    @property
    def loss(self) -> float:
        """The share of a peer's frames that did not arrive, 0 to 1, judged by their numbers."""
        sent = self.numbered - self.repeats + self.gaps
        return self.gaps / sent if sent else 0.0

    def as_dict(self) -> dict[str, Any]:
        """Return it as a dictionary for JSON.

        :returns: the counts and ``loss``.
        """
        counts = ("numbered", "gaps", "repeats", "restarts", "loss")
        return {name: getattr(self, name) for name in counts}


@dataclass(frozen=True)
class SequenceStats(SequenceCounts):
    """The counts of all peers together.

    :ivar peers: the counts of each peer, by its address; empty where frames do not say who sent them. At most 4096
        peers are counted.
    """

    peers: dict[Any, SequenceCounts]

    def as_dict(self) -> dict[str, Any]:
        """Return it as a dictionary for JSON.

        :returns: the counts, ``loss`` and ``peers``.
        """
        return {**super().as_dict(), "peers": {str(peer): counts.as_dict() for peer, counts in self.peers.items()}}


def stats_from(raw: dict[str, Any]) -> Stats:
    """Convert the engine's counts."""
    sequence = raw.pop("sequence")
    if sequence is not None:
        peers = {peer: SequenceCounts(**counts) for peer, counts in sequence["peers"]}
        sequence = SequenceStats(**{**sequence, "peers": peers})
    unlisted = {(id, size): frames for id, size, frames in raw.pop("unlisted")}
    return Stats(**raw, sequence=sequence, unlisted=unlisted)


@dataclass(frozen=True)
class Stats:
    """The account of every received byte. Exact after every ``feed``, ``idle`` and ``finish``:

    ``bytes == frame_bytes + fill_bytes + pending_bytes + sum(discarded_bytes.values())``

    :ivar bytes: all received bytes.
    :ivar frames: delivered frames.
    :ivar unknown_frames: of these, frames whose message the protocol does not have.
    :ivar foreign_frames: of these, frames for another address, and replies from an address that was not asked: they
        are not delivered.
    :ivar foreign_bytes: bytes in such frames; they are in ``frame_bytes``, too.
    :ivar frame_bytes: bytes in delivered frames.
    :ivar fill_bytes: delimiters between frames.
    :ivar pending_bytes: bytes of which it is not decided yet whether they are in a frame.
    :ivar discarded_bytes: discarded bytes, by cause; every cause has an entry.
    :ivar rejected_candidates: how often a frame's start turned out to be false, by cause.
    :ivar messages: delivered frames by message; messages that never came are left out.
    :ivar sequence: counts by the frames' sequence numbers; None if frames have none. None as well if a decoder
        takes the bytes of both ends and frames do not say who sent them.
    :ivar unlisted_frames: frames that were discarded as ``unknown_message`` and are a peer's messages nevertheless:
        another frame began at the end of each, or each was between delimiters or silences.
    :ivar unlisted: their number by id and size of the frame in bytes, 64 kinds at most: ``{(30, 28): 7}``.
    """

    bytes: int
    frames: int
    unknown_frames: int
    foreign_frames: int
    foreign_bytes: int
    frame_bytes: int
    fill_bytes: int
    pending_bytes: int
    discarded_bytes: dict[str, int]
    rejected_candidates: dict[str, int]
    messages: dict[str, int]
    sequence: SequenceStats | None = None
    unlisted_frames: int = 0
    unlisted: dict[tuple[int, int], int] = field(default_factory=dict)

    def as_dict(self) -> dict[str, Any]:
        """Return it as a dictionary for JSON.

        :returns: the attributes by name; causes that did not occur are left out, and ``sequence`` where it is None.
        """
        out = dict(vars(self))
        del out["sequence"]
        if self.sequence is not None:
            out["sequence"] = self.sequence.as_dict()
        for key in ("foreign_frames", "foreign_bytes"):
            if not out[key]:
                del out[key]
        for key in ("discarded_bytes", "rejected_candidates"):
            out[key] = {cause: n for cause, n in out[key].items() if n}
        out["unlisted"] = [{"id": id, "bytes": size, "frames": n} for (id, size), n in self.unlisted.items()]
        return out


class Decoder:
    """Decodes the bytes of one end into messages. Never waits and reads no clock: the caller gives times, in seconds.

    ``Codec.decoder`` makes one. Use it from one thread at a time.
    """

    def __init__(self, engine: _engine.Decoder, codec: Codec, sender: End | None) -> None:
        self.engine = engine
        self._codec = codec
        self._sender = sender

    def feed(self, data: Buffer, t: float = 0.0) -> list[Message]:
        """Decode bytes that were read. Any bytes are allowed; those outside frames are counted.

        :param data: any number of bytes; any buffer, also one whose bytes are not contiguous (it is copied).
        :param t: when they were read, in seconds on a clock of your choice. A time before the latest one counts as
            the latest.
        :returns: the messages that these bytes complete, in the order of the stream.
        :raises TypeError: ``data`` is not a buffer, or ``t`` is not a number.
        :raises UsageError: ``t`` is not finite.
        """
        return self.engine.feed(data, t)

    def expect(self, request: str | None, *, header: Mapping[str, Any] | None = None) -> None:
        """Name the request that was sent, so that its reply can be identified where several messages share an id (or
        have none). It holds for the bytes from here on, pending ones included, until the next call. Where silence ends
        a frame, call ``idle`` first. A ``Link`` does this for each request it sends.

        :param request: the request's message; None: no reply is expected.
        :param header: its header values. Where the MCU answers with its own address (``address: mcu``), a reply from
            another address than was asked is then foreign: it is counted, and not returned. None: every reply is.
        :raises MessageError: ``header`` has a wrong name or value.
        :raises UsageError: the protocol has no such message, or it has no ``reply``.
        """
        index, place, address = -1, -1, None
        if request is not None:
            index = self._codec.tables.indices[self._codec.tables.reply_to(request)]
            asked = None if header is None else self._codec.tables.address_of(header)
            peer = plan_for(self._codec.model, End.MCU).peer
            if asked is not None and peer is not None and asked not in self._codec.tables.broadcasts:
                place, address = peer, asked
        self.engine.expect(index, place, address)

    def idle(self, t: float) -> list[Message]:
        """Report that a read returned nothing. After the protocol's ``idle`` time an incomplete frame is given up, and
        its bytes are searched for other frames.

        :param t: when that read began, in seconds on the clock of ``feed``.
        :returns: messages that came after a false start.
        :raises TypeError: ``t`` is not a number.
        :raises UsageError: ``t`` is not finite.
        """
        return self.engine.idle(t)

    def finish(self) -> list[Message]:
        """Report that no more bytes will come, so that pending bytes are decided.

        :returns: messages that came after a false start.
        """
        return self.engine.finish()

    @property
    def stats(self) -> Stats:
        """The account of every byte so far."""
        return stats_from(self.engine.stats())

    def __repr__(self) -> str:
        stats = self.stats
        whose = "either end" if self._sender is None else f"the {self._sender}"
        return (
            f"<wirebond.Decoder {self._codec.name} from {whose}: {stats.frames} frames in {stats.bytes} bytes, "
            f"{stats.pending_bytes} pending>"
        )


@dataclass(frozen=True)
class Table:
    """Every occurrence of one message: a column for each field, all of the same length, which is ``len(table)``.

    ``table["left_ticks"]`` is a column, ``in`` and iteration go over their names, and ``dict(table)`` is possible. A
    field of a group has a column for each element, ``joints[3].position``. An array is one column of shape (rows,
    count), and ``gains[1]`` is one element of it.

    :ivar offset: of each row's first byte in the capture, in bytes; uint64 of shape (rows,).
    :ivar fields: the columns by name.
    :ivar t: of a recording: when each row came, in seconds since its start; None: a capture has no times.
    :ivar stamp: of a recording, of a message that has a field with ``clock``: when the MCU measured each row's values,
        on the clock of ``t``; NaN where that is not known. None: there is no such field.
    :ivar stamp_error: seconds by which ``stamp`` is wrong at most, likewise.
    """

    offset: NDArray[np.uint64]
    fields: dict[str, Column] = field(repr=False)
    t: NDArray[np.float64] | None = field(default=None, repr=False)
    stamp: NDArray[np.float64] | None = field(default=None, repr=False)
    stamp_error: NDArray[np.float64] | None = field(default=None, repr=False)

    def __getitem__(self, name: str) -> Column:
        try:
            return self.fields[name] if name in self.fields else self._element(name)
        except KeyError:
            raise KeyError(f"the table has no column {name!r}; it has {', '.join(self.fields) or 'none'}") from None

    def __contains__(self, name: object) -> bool:
        try:
            return name in self.fields or (isinstance(name, str) and self._element(name) is not None)
        except KeyError:
            return False

    def _element(self, name: str) -> Column:
        """Return the column of one element of an array, such as ``gains[1]``.

        :raises KeyError: there is no such element.
        """
        array, _, index = name.removesuffix("]").rpartition("[")
        column = self.fields[array]
        if not name.endswith("]") or not index.isdecimal() or isinstance(column, list) or column.ndim != 2:
            raise KeyError(name)
        if int(index) >= column.shape[1]:
            raise KeyError(name)
        return column[:, int(index)]

    def __iter__(self) -> Iterator[str]:
        return iter(self.fields)

    def __len__(self) -> int:
        """Return the number of messages; each is a row."""
        return len(self.offset)

    def __bool__(self) -> bool:
        return True

    def keys(self) -> KeysView[str]:
        """Return the columns' names.

        :returns: those of the table's fields, in wire order.
        """
        return self.fields.keys()

    def items(self) -> ItemsView[str, Column]:
        """Return the columns with their names.

        :returns: pairs of name and column.
        """
        return self.fields.items()

    @property
    def rows(self) -> int:
        """The number of messages: ``len(table)``."""
        return len(self.offset)

    def __repr__(self) -> str:
        return f"<wirebond.Table {len(self)} rows: {', '.join(self.fields)}>"


@dataclass(frozen=True)
class Columns(Mapping[str, Table]):
    """A decoded capture: a table for each message that occurred, by name. ``unknown`` holds frames with unknown ids.

    :ivar tables: the tables by message.
    :ivar stats: where every byte of the capture went.
    """

    tables: dict[str, Table]
    stats: Stats

    def __getitem__(self, name: str) -> Table:
        try:
            return self.tables[name]
        except KeyError:
            raise KeyError(f"no {name!r} in this capture; it has {', '.join(self.tables) or 'no message'}") from None

    def __iter__(self) -> Iterator[str]:
        return iter(self.tables)

    def __len__(self) -> int:
        return len(self.tables)

    def __repr__(self) -> str:
        rows = ", ".join(f"{name} {len(table)}" for name, table in self.tables.items())
        return f"<wirebond.Columns of {self.stats.bytes} bytes: {rows or 'no message'}>"


class Codec:
    """A protocol that encodes and decodes. ``load`` makes it from a file. It is immutable; any thread may use it.

    :param model: the protocol as plain values.
    :ivar model: the same: the whole file, with its defaults.
    :ivar tables: for this package's own modules.
    """

    def __init__(self, model: Protocol) -> None:
        self.model = model
        self.tables = EngineTables(model)
        self._index = self.tables.indices
        self._own: dict[str, _engine.FormatTable] = {}  # by message, for callers that name no sender

    @property
    def name(self) -> str:
        """The protocol's name."""
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
        header: Mapping[str, Any] | None = None,
        sender: str | None = None,
        **fields: Any,
    ) -> bytes:
        """Encode a message as one frame. Exceptions of a value's own ``__float__`` or ``__index__`` are not caught.

        If the format has several forms, the first one is used that allows these header values, has every header field
        given here, and can carry the message.

        A sequence number is a header field like others: 0 unless ``header`` gives it. The same call gives the same
        bytes each time; a link raises the number from frame to frame.

        :param message: the message's name.
        :param values: its fields as a mapping, in SI units.
        :param header: the frame's own named fields, where they differ from the defaults of the end that sends it;
            values as those of message fields: SI units, names of an enum, a list of flags.
        :param sender: of a message with ``sender: both``, the end whose frame is wanted, ``"host"`` or ``"mcu"``: their
            frames may begin with different bytes. None: the host's. Of any other message None, or its own sender.
        :param fields: its fields by keyword; they override those of ``values``.
        :returns: the frame as it is on the wire, delimiters included.
        :raises MessageError: unknown message or field, a value out of range, not finite or of the wrong type; or no
            form of the frame can carry the message.
        :raises UsageError: ``sender`` is not an end; or ``header`` or ``sender`` is given, and the message has a field
            of that name which is not among ``values``, where it belongs.
        """
        index = self._index.get(message) if isinstance(message, str) else None
        if index is None:
            raise MessageError(no_message(self.name, message, self._index))
        if header is not None or sender is not None:
            options = {"header": header, "sender": sender}
            refuse_option_for_field("encode", self.model.messages[index], options, values)
        form = self._own.get(message) if sender is None else None
        if form is None:
            form = self.tables.format_for(self._end_for(self.model.messages[index], sender))
            if sender is None:
                self._own[message] = form
        if values is None:
            everything = fields
        elif fields or type(values) is not dict:
            everything = {**as_mapping(message, values), **fields}
        else:
            everything = values
        return self.tables.frame_of(index, form, everything, header)

    def _end_for(self, message: MessageModel, sender: str | None) -> End:
        """Return the end whose frame is meant."""
        if sender is None:
            return End.HOST if message.sent_by(End.HOST) else End.MCU
        if sender not in (End.HOST, End.MCU):
            raise UsageError(f"sender is {shown(sender)}; expected 'mcu' or 'host'")
        if not message.sent_by(End(sender)):
            raise MessageError(f"{message.name} is sent by the {message.sender}, not by the {sender}")
        return End(sender)

    def decoder(self, sender: str | None = None) -> Decoder:
        """Return a decoder for the bytes of one end.

        :param sender: whose bytes these are, ``"mcu"`` or ``"host"``; None: of both, where their ids differ.
        :returns: a decoder that has seen no byte yet.
        :raises UsageError: another sender, or ids that mean different messages in each direction.
        """
        end = self.tables.sender_for(sender)
        return Decoder(
            _engine.Decoder(self.tables.protocol, self.tables.format_for(end), self.model.idle_seconds), self, end
        )

    def decode_columns(
        self,
        capture: Buffer,
        sender: str | None = None,
        *,
        threads: int | None = None,
        progress: Callable[[int, int], object] | None = None,
    ) -> Columns:
        """Decode a whole capture at once, without a Python object for each message. The capture's end settles an
        incomplete frame. Other threads of Python run in that time; Ctrl-C ends the call.

        :param capture: the bytes; any buffer, which must not change in that time.
        :param sender: as for ``decoder``.
        :param threads: how many share a large capture, at most 64; None: as many as the machine has cores. The result
            does not depend on it.
        :param progress: called as ``progress(done, size)``, both in bytes, some ten times a second and at the end, in
            the calling thread; not for a capture of less than 256 KiB. An exception from it ends the call.
        :returns: a table for each message that occurred. Scaled fields are float64 in SI units; other numbers keep
            their wire type; enums and flags stay integers; arrays have shape (rows, count); text and bytes are lists.
            A group has columns for each element, such as ``joints[3].position``. If its number varies, there are
            columns for the maximum: floats that are NaN, or lists with None, where a row has fewer elements.
            A column for each header field follows, such as ``header.servo``: 0 in frames without it.
        :raises TypeError: ``capture`` is not a buffer, or ``progress`` cannot be called.
        :raises UsageError: a sender as for ``decoder``, or ``threads`` is not a number of 1 or more.
        """
        if threads is not None and (not isinstance(threads, int) or threads < 1):
            raise UsageError(f"threads is {shown(threads)}; expected 1 or more, or None for as many as there are cores")
        if progress is not None and not callable(progress):
            raise TypeError(f"progress is {progress!r}; expected a function that takes two numbers, or None")
        threads = min(threads or os.cpu_count() or 1, _MOST_THREADS)
        form = self.tables.format_for(self.tables.sender_for(sender))
        result = _engine.decode_columns(self.tables.protocol, form, capture, threads, progress)
        tables = {name: Table(**table) for name, table in result["messages"].items()}
        return Columns(tables, stats_from(result["stats"]))

    def log_line(self, message: Message) -> LogLine | None:
        """Return the log line of a received message.

        :param message: one that a decoder or a link of this protocol gave.
        :returns: its level and text; None where it is not a log line.
        """
        index = self._index.get(message.name)
        return None if index is None else log_line(self.model, self.model.messages[index], message.fields)

    def counters(self, message: Message) -> McuCounters | None:
        """Return the counters of the MCU's link in a received message: bytes and messages received, refused and sent.

        :param message: one that a decoder or a link of this protocol gave.
        :returns: the counters, as ``str`` a sentence; None where it is not the message of the ``counters`` service.
        """
        index = self._index.get(message.name)
        return None if index is None else mcu_counters(self.model, self.model.messages[index], message.fields)

    def __repr__(self) -> str:
        return f"<wirebond.Codec {self.name}: {', '.join(self._index)}>"


def refuse_option_for_field(
    function: str, message: MessageModel, options: Mapping[str, object], values: Mapping[str, Any] | None
) -> None:
    """Refuse an argument that may have been meant for the field of the same name.

    :raises UsageError: the message has a field that is called like an option given here, and ``values`` does not have
        it.
    """
    for name, given in options.items():
        if given is None or name in (values or {}):
            continue
        if any(field.name == name and field.has_value for field in message.fields):
            raise UsageError(
                f"{name} is an option of {function}() and a field of {message.name}; give the field in a mapping: "
                f"{function}({message.name!r}, {{{name!r}: ...}})"
            )


def load(path: str | os.PathLike[str]) -> Codec:
    """Read a protocol file.

    :param path: of the file.
    :returns: the protocol, ready to encode and to decode.
    :raises ProtocolFileError: with every problem of the file.
    :raises UsageError: ``path`` is not a path.
    """
    return Codec(load_model(path_of("the protocol file", path, "a path, such as robot.yaml")))
