"""The messages between a server and its clients: docs/server.md. Bytes to values and back; no socket, no thread.

On a stream each message is its length (u32, little-endian, of what follows), its kind (one byte), and its body: JSON,
or records of received frames.
"""

from __future__ import annotations

import struct
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any, Literal

import msgspec

VERSION = 1
JSON, FRAMES = 0, 1  # kinds of messages
MOST_TO_SERVER = 1 << 20  # bytes of one message
MOST_FIRST = 1 << 14  # bytes of the first one, with the token
MOST_TO_CLIENT = 1 << 27
TICK_EVERY = 0.05  # seconds between two ticks of the server
BEAT_EVERY = 0.1  # seconds between two beats of a client
SILENCE = 0.3  # seconds without a beat, after which a client is not in control any more
OLDEST_COMMAND = 0.25  # seconds: a command from longer ago is refused

_HEAD = struct.Struct("<IB")


def framed(kind: int, body: bytes) -> bytes:
    """Frame one message for a stream."""
    return _HEAD.pack(len(body) + 1, kind) + body


def json_message(value: Any) -> bytes:
    """Return the same for a JSON value."""
    return framed(JSON, msgspec.json.encode(value))


class WrongStreamError(ValueError):
    """Bytes that no program that knows this protocol sends."""


class Splitter:
    """Bytes of a stream in, messages out.

    :param most: bytes that one message may have; it may be changed between two messages.
    """

    def __init__(self, most: int) -> None:
        self.most = most
        self._bytes = bytearray()

    def feed(self, data: bytes) -> Iterator[tuple[int, bytes]]:
        """Yield kind and body of each complete message.

        :raises WrongStreamError: this is no such stream.
        """
        self._bytes += data
        at = 0
        try:
            while len(self._bytes) - at >= _HEAD.size:
                size, kind = _HEAD.unpack_from(self._bytes, at)
                if not 1 <= size <= self.most or kind not in (JSON, FRAMES):
                    raise WrongStreamError(
                        f"a message of {size} bytes and kind {kind}; at most {self.most} are accepted"
                    )
                if len(self._bytes) - at < size + 4:
                    break
                body = bytes(memoryview(self._bytes)[at + _HEAD.size : at + 4 + size])
                at += 4 + size
                yield kind, body
        finally:
            del self._bytes[:at]


class _Request(msgspec.Struct, tag_field="do"):
    id: int = 0  # the answer carries it back


class Attach(_Request, tag="attach"):
    """The first message of a client. ``messages``: received messages come as records, as JSON, or not at all.
    ``asks``: it takes control only by ``take``, and not by its first command."""

    version: int = VERSION
    token: str = ""
    name: str = ""
    messages: Literal["frames", "json", "none"] = "json"
    asks: bool = False


class Beat(_Request, tag="beat"):
    """The client runs, and has seen this tick."""

    tick: int = 0


class Send(_Request, tag="send"):
    """A message, by its fields or as a frame. ``reply``: wait for its reply, this many seconds at most."""

    message: str = ""
    fields: dict[str, Any] | None = None
    header: dict[str, Any] | None = None
    frame: bytes | None = None
    takes_number: bool = True
    tick: int = 0
    reply: float | None = None


class Repeat(_Request, tag="repeat"):
    """Like `Send`, but repeated by the server for ``hold`` seconds."""

    message: str = ""
    fields: dict[str, Any] | None = None
    header: dict[str, Any] | None = None
    frame: bytes | None = None
    takes_number: bool = True
    tick: int = 0
    hold: float = 0.2


class StopRepeating(_Request, tag="stop_repeating"):
    """End leases of the message without a last value; ``address`` None: of every address."""

    message: str = ""
    address: int | None = None


class EndSafely(_Request, tag="end_safely"):
    """End the lease of the message with its safe value."""

    message: str = ""
    address: int = 0


class HandOver(_Request, tag="hand_over"):
    """Send no safe values for this client's messages so far when it leaves."""


class Withdraw(_Request, tag="withdraw"):
    """Nobody waits for the reply to this request any more."""

    request: int = 0


class About(_Request, tag="about"):
    """Ask for the facts about a request that has no reply yet."""

    request: int = 0


class Take(_Request, tag="take"):
    """Take control; ``over``: also from the program that has it, or only from the one of this name. ``tick`` None: the
    client does not mind when the request arrives."""

    over: bool | str = False
    tick: int | None = None


class Release(_Request, tag="release"):
    """Give control up."""


class Stop(_Request, tag="emergency_stop"):
    """The emergency stop, by anyone."""


class ReleaseStop(_Request, tag="release_stop"):
    """End the emergency stop; ``over``: also one of another program, or only of the one of this name. ``tick``: as for
    `Take`."""

    over: bool | str = False
    tick: int | None = None


class Recover(_Request, tag="recover"):
    """End a deadline that waits for that."""

    action: int = 0


class SetAddress(_Request, tag="set_address"):
    """The link's own address, as bits on the wire."""

    address: int = 0


class Ask(_Request, tag="ask"):
    """Ask for the state of the link."""

    what: Literal[
        "state", "why", "stats", "stopped", "struck", "recent", "peer", "clock", "clock_line", "line", "recording"
    ] = "state"


class HostTimeOf(_Request, tag="host_time"):
    """The host's time of a time of the MCU, near a time of the host."""

    mcu_us: int = 0
    near: float = 0.0


class OpenTap(_Request, tag="open_tap"):
    """Begin to keep what the link reads, writes and does."""

    capacity: int = 0


class TakeTap(_Request, tag="take_tap"):
    """Take the kept bytes and events."""

    tap: int = 0


class CloseTap(_Request, tag="close_tap"):
    """Stop keeping."""

    tap: int = 0


class Note(_Request, tag="note"):
    """An event for the recordings of the link."""

    text: str = ""


class Mark(_Request, tag="mark"):
    """A person's remark about this moment, for the recordings of the link."""

    text: str = ""


class RecordStart(_Request, tag="record_start"):
    """Record the link on the server's disk."""


class RecordStop(_Request, tag="record_stop"):
    """End that recording."""


class ListRecordings(_Request, tag="recordings"):
    """The recordings in the server's folder."""


class Annotate(_Request, tag="annotate"):
    """Add a person's text to a recording in the server's folder."""

    recording: str = ""
    text: str = ""


class Leave(_Request, tag="leave"):
    """The client goes: what it moved gets its safe values."""


Request = (
    Attach | Beat | Send | Repeat | StopRepeating | EndSafely | HandOver | Withdraw | About | Take | Release | Stop
    | ReleaseStop | Recover | SetAddress | Ask | HostTimeOf | OpenTap | TakeTap | CloseTap | Note | Mark | RecordStart
    | RecordStop | ListRecordings | Annotate | Leave
)  # fmt: skip
OfRecordings = RecordStart | RecordStop | ListRecordings | Annotate  # their answers wait for the disk
read_request = msgspec.json.Decoder(Request).decode


class Welcome(msgspec.Struct):
    """The server's facts for a client that attaches."""

    version: int
    server: str
    client: int  # the number of who attached
    protocol: str
    hash: str  # hexadecimal
    text: str  # the protocol file
    port: str
    baud: int
    role: str
    control: Control
    other_protocols: list[str] = []  # files of other links on the same port


class RecordingNote(msgspec.Struct, frozen=True):
    """A person's text about a recording.

    :ivar written: when, in seconds since 1970.
    :ivar text: as it was given.
    """

    written: float
    text: str


class StoredRecording(msgspec.Struct, frozen=True):
    """A recording in the folder of a server.

    :ivar name: of the file in the folder.
    :ivar path: of the file on the server's computer.
    :ivar state: ``recording``; ``closing``: it is whole, and is being compressed; ``closed``; ``unclosed``: it is not
        compressed, since its program was killed or the disk was full; ``capture``: it is a raw capture, which has
        neither times nor a protocol; ``unreadable``.
    :ivar started: in seconds since 1970.
    :ivar seconds: how long it is.
    :ivar size: bytes of the file.
    :ivar protocol: its name.
    :ivar hash: of the protocol, 16 hexadecimal digits.
    :ivar notes: what persons wrote about it.
    :ivar messages: received so far, while it is being recorded.
    :ivar lost_bytes: that were not recorded because the server's computer had no time, likewise.
    :ivar error: why it ended early or cannot be read, as a sentence; empty otherwise.
    """

    name: str
    path: str
    state: Literal["recording", "closing", "closed", "unclosed", "capture", "unreadable"]
    started: float = 0.0
    seconds: float = 0.0
    size: int = 0
    protocol: str = ""
    hash: str = ""
    notes: tuple[RecordingNote, ...] = ()
    messages: int = 0
    lost_bytes: int = 0
    error: str = ""


@dataclass(frozen=True)
class Control:
    """Report which client may command motion.

    :ivar holder: the program in control, by the name that it gave itself; None: no program is.
    :ivar is_own: it is this one.
    :ivar released_by: the program that released the last emergency stop, as long as no program has been in control
        since. It takes control first; others that were attached then say ``take_control(over=...)``.
    """

    holder: str | None = None
    is_own: bool = False
    released_by: str | None = None
