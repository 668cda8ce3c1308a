"""Types of the compiled engine."""

from collections.abc import Callable, Iterator, KeysView
from typing import Any

from wirebond.link.engine_settings import EngineSettings, SafeValue

interface: tuple[str, str]  # the digests of ``wirebond.engine_interface`` when it was built

class ProtocolTable:
    """The messages of a protocol, as the engine reads and writes them. Any thread may use it."""

    def __init__(self, table: bytes) -> None:
        """:param table: of ``wirebond.protocol.tables.protocol_table``."""

class FormatTable:
    """The frame format of one end, or of both. Any thread may use it."""

    def __init__(self, table: bytes) -> None:
        """:param table: of ``wirebond.protocol.tables.format_table``."""

class Message:
    """One frame that passed every check. It does not change; use it from one thread at a time.

    Its fields are read by name, too: ``message["linear"]``, ``"linear" in message``; iteration gives their names, and
    ``dict(message)`` the fields.
    """

    @property
    def name(self) -> str:
        """The message's name; ``unknown`` for an unknown id or a payload too short for it."""
    @property
    def sender(self) -> str | None:
        """``host``, ``mcu`` or ``both``; None for an unknown message."""
    @property
    def fields(self) -> dict[str, Any]:
        """Values in SI units by field name, decoded when first asked for. Empty for an unknown message."""
    @property
    def violations(self) -> list[str]:
        """A sentence for each field rule that it breaks; the values are as they came, not clamped."""
    @property
    def header(self) -> dict[str, Any]:
        """Values of the frame's named header fields, as those of message fields: SI units, names, lists of flags."""
    @property
    def raw(self) -> bytes:
        """The frame's bytes as received, delimiters included."""
    @property
    def payload(self) -> bytes:
        """The payload's bytes, after unstuffing."""
    @property
    def id(self) -> int:
        """The id on the wire; 0 where the format has none."""
    @property
    def t(self) -> float:
        """When it was completed, in seconds: the time of that ``feed``; for a ``Link`` on ``time.monotonic()``."""
    @property
    def stamp(self) -> float | None:
        """When the MCU measured the message's values, in the host's time: seconds on the clock of ``t``. None: the
        message has no field with ``clock``, or the MCU's clock is not known (yet)."""
    @property
    def stamp_error(self) -> float | None:
        """Seconds by which ``stamp`` is wrong at most; or None."""
    @property
    def offset(self) -> int:
        """Of its first byte in the stream, in bytes."""
    def keys(self) -> KeysView[str]:
        """The names of its fields, so that ``dict(message)`` is possible."""
    def __getitem__(self, name: str) -> Any:
        """The value of this field.

        :param name: the field's name; fields within a struct are in its dict.
        :raises KeyError: the message has no such field.
        """
    def __contains__(self, name: object) -> bool:
        """Has it a field of this name?"""
    def __iter__(self) -> Iterator[str]:
        """The names of its fields, in their order."""

class Decoder:
    """Bytes in, messages out. One thread at a time."""

    def __init__(self, protocol: ProtocolTable, format: FormatTable, idle_seconds: float) -> None:
        """:param idle_seconds: how long a line is silent before an incomplete frame is given up."""
    def set_stamper(self, stamper: Callable[[Message], tuple[float, float] | None] | None) -> None:
        """:param stamper: gives stamp and error of the messages from here on."""
    def feed(self, bytes: bytes | bytearray | memoryview, t: float) -> list[Message]:
        """:param t: when the bytes were read, in seconds.
        :raises TypeError: no buffer, or no number.
        :raises UsageError: ``t`` is not finite.
        """
    def feed_reads(
        self, buffer: object, places: object, sizes: object, times: object, keep: bool
    ) -> tuple[list[Message], bytes]:
        """``idle`` and ``feed`` for each of many reads. ``places`` (u64) and ``sizes`` (u32): where their bytes lie in
        ``buffer``; ``times`` (f64): when they began. Without ``keep`` messages are only counted.

        :returns: the messages, and the index of the read of each (u32).
        """
    def expect(self, message: int, place: int = -1, address: int | None = None) -> None:
        """:param message: the index of the reply that is meant from here on; -1: of none.
        :param place: of the header field that says who sent it.
        :param address: what that must be; None: anything.
        """
    def idle(self, t: float) -> list[Message]:
        """A read that began at ``t`` found nothing.

        :raises UsageError: ``t`` is not finite.
        """
    def finish(self) -> list[Message]:
        """No byte will ever follow."""
    def stats(self) -> dict[str, Any]:
        """The account, as the fields of ``wirebond.Stats``."""

class CdrPacker:
    """A message as the bytes (CDR) of a ROS 2 topic. Any thread may use it."""

    @staticmethod
    def make(protocol: ProtocolTable, plan: object) -> CdrPacker | None:
        """:param plan: a ``wirebond.ros2.mapping.packing.PackPlan``.
        :returns: None: a value has no place that is the same in every payload.
        """
    def pack(self, messages: list[Message], stamps_ns: list[int]) -> list[bytes | None]:
        """:returns: for each the topic's bytes with its stamp; None: a value is not of its type, or it is another
        message.
        """

def stamps_ns(messages: list[Message], ahead_ns: int) -> list[int]:
    """When each came, or its own stamp where it has one: in nanoseconds, ``ahead_ns`` later."""

class CdrCommand:
    """The bytes (CDR) of a ROS 2 topic as the frame of a command. Any thread may use it."""

    @staticmethod
    def make(
        protocol: ProtocolTable, format: FormatTable, plan: object, bounds: dict[str, tuple[float, float]]
    ) -> CdrCommand | None:
        """:param plan: a ``wirebond.ros2.mapping.unpacking.UnpackPlan``.
        :param bounds: least and greatest value of each number of the message.
        :returns: None: the protocol has no such message.
        """
    def frames(self, messages: list[bytes], first: int = 0) -> list[bytes]:
        """:returns: the frame of each, from ``first`` on, up to one whose bytes are not a message, or that has a value
        which is not within its bounds.
        """

class Follower:
    """Bytes of one end that go on coming, to columns. One thread at a time."""

    def __init__(self, protocol: ProtocolTable, format: FormatTable, idle_seconds: float) -> None:
        """:param idle_seconds: how long a line is silent before an incomplete frame is given up."""
    def feed(self, bytes: object, reads: dict[str, Any]) -> dict[str, Any]:
        """What these bytes completed, by message a dict of ``fields``, ``t``, ``offset`` from the first byte of all,
        and ``size`` on the wire.

        :param reads: as for ``decode_timed_columns``, without ``idle``; a break behind the last read has the index of
            the next one.
        """
    def idle(self, t: float) -> dict[str, Any]:
        """A read that began at ``t`` found nothing."""
    def tables(self) -> dict[str, Any]:
        """The tables of all messages without a row: which columns there are, and of which type."""
    def settled(self) -> int:
        """How many bytes are settled: what lies behind them may become a frame."""
    def stats(self) -> dict[str, Any]:
        """The account, as the fields of ``wirebond.Stats``, without sequence numbers."""

class LinkCore:
    """A link under virtual time: every time is an argument, in microseconds."""

    def __init__(self, protocol: ProtocolTable, receive: FormatTable, settings: EngineSettings, now: int) -> None:
        """:param now: microseconds, as in every call."""
    def set_stamper(self, stamper: Callable[[Message], tuple[float, float] | None] | None) -> None:
        """:param stamper: gives stamp and error of the messages that are taken from here on. It keeps no link."""
    def send(
        self, message: int, frame: bytes, reply: int, now: int, takes_number: bool = True, address: int = 0
    ) -> int:
        """Queue one frame; 0 where it was taken, else a number that ``wirebond.link`` turns into its exception.
        ``takes_number``: it gets its sequence number as it leaves, where frames have one. ``address``: for whom it is.
        """
    def repeat(
        self,
        message: int,
        frame: bytes,
        hold: float,
        reply: int,
        now: int,
        takes_number: bool = True,
        address: int = 0,
    ) -> int:
        """Begin or renew a lease of ``hold`` seconds; the result is that of ``send``."""
    def end_safely(self, message: int, address: int) -> bool:
        """End the lease of this message and address with its safe value, which leaves before all else."""

    def end_if_moved(self, message: int, address: int) -> bool:
        """As ``end_safely``, unless the safe value was the last of this message and address."""

    def end_motion(self) -> None:
        """End every lease, and send the safe value of everything that moved."""

    def hand_over_motion(self) -> None:
        """Send no safe value at the end for what was sent so far."""

    def note_safe(self, safe: SafeValue) -> bool:
        """One more safe value, as an entry of the settings' ``stop``. False: there is no room."""
    def set_address(self, address: int) -> None:
        """The own address, as bits on the wire."""
    def listen_to_all(self, all: bool) -> None:
        """No frame is foreign any more; or some are again."""
    def stop_repeating(self, message: int, address: int | None = None) -> None:
        """End the lease of this address, or of every address, without a last value."""
    def stop(self, now: int) -> None:
        """The emergency stop: latched until ``release_stop``."""
    def release_stop(self) -> None:
        """Let the stopped messages pass again; sends nothing."""
    def is_stopped(self) -> bool:
        """Is the emergency stop latched?"""
    def close(self) -> None:
        """Take nothing more; every lease ends, with its safe value where it has one."""
    def end(self, now: int) -> None:
        """What still waits will never leave: it expires."""
    def is_empty(self) -> bool:
        """Does nothing wait to be written?"""
    def port_up(self, now: int) -> None:
        """The port is there."""
    def port_down(self, now: int, why: str = "") -> None:
        """The port has gone; ``why`` in words, for taps."""
    def received(self, bytes: bytes, before: int, after: int) -> None:
        """Bytes of a read that began and ended at these times."""
    def idle(self, now: int) -> None:
        """A read found nothing."""
    def poll(self, now: int) -> None:
        """Do what is due."""
    def to_write(self, now: int, together: bool = False) -> bytes:
        """The bytes that may be written now: of one frame, or ``together`` of several that nothing else concerns."""
    def hand_over(self, now: int) -> bytes:
        """As ``to_write``, for a driver that writes while others send: all but the last byte count as written, so that
        the frame is under way; ``written(1)`` follows when the port took them. One lone byte counts at once."""
    def recent(self) -> tuple[list[tuple[str, int, bytes]], int]:
        """The last pieces of both directions: kind (``received``, ``sent``, ``port_up``, ``port_down``), time in
        microseconds, bytes; and how many older bytes were dropped."""
    def open_tap(self, capacity: int, now: int) -> int:
        """Keep all that is read, written and happens from now on, up to this many bytes. Its number."""
    def take_tap(self, tap: int) -> tuple[list[tuple[str, int, int, bytes]], int, int, int]:
        """What was kept since the last call: kind, when a read began, time, bytes; and what had no room: pieces,
        received bytes, sent bytes. Nothing for a number that is not open."""
    def close_tap(self, tap: int) -> None:
        """Forget it."""
    def note(self, text: str, now: int) -> None:
        """Taps get this text as an event."""
    def written(self, size: int, now: int) -> None:
        """How many of them the port took."""
    def is_blocked(self) -> bool:
        """Did the port take nothing the last time? It says when it takes bytes again."""
    def driver_holds(self, size: int, now: int) -> None:
        """The driver says how many bytes it holds."""
    def next_due(self, now: int) -> int:
        """When to call again; 2**64 - 1 where only bytes matter."""
    def has_arrivals(self) -> bool:
        """Are there messages that ``receive`` has not given?"""
    def has_news(self) -> bool:
        """Has ``receive`` or ``changes`` something to give?"""
    def changes(self) -> list[tuple[str, int, int]]:
        """What happened beside messages since the last call: kind (``struck``, ``ended``, ``port_up``, ``port_down``),
        time in microseconds, and the index of the deadline's action. Of more than 1024 the oldest are dropped."""
    def receive(self) -> list[Message]:
        """Messages since the last call."""
    def stats(self) -> dict[str, Any]:
        """The account, as the fields of ``wirebond.LinkStats``."""
    def state(self, now: int) -> str:
        """``up``, ``stale`` or ``down``."""
    def struck_deadlines(self) -> list[int]:
        """Indices of the actions that have struck and not ended."""
    def recover_deadline(self, action: int, now: int) -> None:
        """End a deadline with ``recover: explicit``."""

class Link:
    """One port and its thread, as ``wirebond.Link`` drives it. Any thread may call any method."""

    def __init__(
        self, protocol: ProtocolTable, receive: FormatTable, port: dict[str, Any], settings: EngineSettings
    ) -> None:
        """``port``: ``name``; ``waits``: a port that cannot be opened is not an error; ``host`` and ``service`` for
        TCP; ``root``, where the system's ``sys`` is, for a tty; ``resolve``, called without arguments, for one whose
        path may change."""
    def set_stamper(self, stamper: Callable[[Message], tuple[float, float] | None] | None) -> None:
        """:param stamper: gives stamp and error of the messages that are taken from here on. It keeps no link."""
    def send(self, message: int, frame: bytes, reply: int, takes_number: bool, address: int) -> int:
        """Queue one frame; 0 where it was taken, else a number that ``wirebond.link`` turns into its exception."""
    def send_all(self, frames: list[tuple[int, bytes]]) -> list[int]:
        """Queue these frames, each with its message; none asks for a reply, and they have no address. One answer for
        each, as that of ``send``."""
    def repeat(self, message: int, frame: bytes, hold: float, reply: int, takes_number: bool, address: int) -> int:
        """Begin or renew a lease of ``hold`` seconds; the result is that of ``send``."""
    def end_safely(self, message: int, address: int) -> bool:
        """End the lease of this message and address with its safe value, which leaves before all else."""

    def end_if_moved(self, message: int, address: int) -> bool:
        """As ``end_safely``, unless the safe value was the last of this message and address."""

    def end_motion(self) -> None:
        """End every lease, and send the safe value of everything that moved."""

    def hand_over(self) -> None:
        """Send no safe value at the end for what was sent so far."""

    def note_safe(self, safe: SafeValue) -> bool:
        """One more safe value, as an entry of the settings' ``stop``. False: there is no room."""
    def set_address(self, address: int) -> None:
        """The own address, as bits on the wire."""
    def listen_to_all(self, all: bool) -> None:
        """No frame is foreign any more; or some are again."""
    def stop_repeating(self, message: int, address: int | None = None) -> None:
        """End the lease of this address, or of every address, without a last value."""
    def stop(self) -> bool:
        """The emergency stop: latched until ``release_stop``. False: the link has ended, and nothing was sent."""
    def release_stop(self) -> None:
        """Let the stopped messages pass again; sends nothing."""
    def is_stopped(self) -> bool:
        """Is the emergency stop latched?"""
    def receive(self, timeout: float) -> list[Message]:
        """Messages since the last call; waits up to ``timeout`` seconds for the first one, or for a change."""
    def attend(self, timeout: float) -> list[Message]:
        """The same for the one thread that takes what comes whenever it has nothing else to do. Only ``recall`` ends
        its wait early."""
    def recall(self) -> None:
        """End the wait of ``attend``: of this call, or of the next one."""
    def wait_unattended(self, timeout: float) -> None:
        """Wait until something is there to be taken and nobody is in ``attend``, or the link has ended."""
    def changes(self) -> list[tuple[str, int, int]]:
        """As ``LinkCore.changes``."""
    def line(self) -> dict[str, Any] | None:
        """What the driver made of the line's settings, for ``wirebond.link.line.line_from``; None: it has none, or the
        port was never open."""
    def stats(self) -> dict[str, Any]:
        """The account, as the fields of ``wirebond.LinkStats``."""
    def recent(self) -> tuple[list[tuple[str, int, bytes]], int]:
        """As ``LinkCore.recent``."""
    def open_tap(self, capacity: int) -> int:
        """As ``LinkCore.open_tap``."""
    def take_tap(self, tap: int) -> tuple[list[tuple[str, int, int, bytes]], int, int, int]:
        """As ``LinkCore.take_tap``."""
    def close_tap(self, tap: int) -> None:
        """As ``LinkCore.close_tap``."""
    def note(self, text: str) -> None:
        """As ``LinkCore.note``."""
    def state(self) -> str:
        """``up``, ``stale`` or ``down``."""
    def why(self) -> str:
        """Why the port is away; empty while it is there."""
    def is_closed(self) -> bool:
        """Was it closed?"""
    def struck_deadlines(self) -> list[int]:
        """Indices of the actions that have struck and not ended."""
    def recover_deadline(self, action: int) -> None:
        """End a deadline with ``recover: explicit``."""
    def begin_close(self) -> None:
        """End every lease and take nothing more; waits for nothing."""
    def close(self) -> None:
        """End every lease, let what is queued leave (a second at most), give the port back."""
    def after_fork(self) -> None:
        """In the child: forget the link, which is the parent's."""

def port_latency_us(path: str, bytes_per_second: float, ttys: str = "/sys/class/tty") -> int:
    """How long the port may hold received bytes back, in microseconds, by what the system says of its device.

    Exists where the engine has ports of its own, as ``Link`` does.

    :param ttys: the folder in which the system lists its ttys.
    """

def hold_ended_threads() -> None:
    """Let daemon threads that the interpreter ends in the engine sleep until the process is gone. Called at exit."""

def hold_waiting_threads() -> None:
    """From here on no other thread comes back from its wait in a link: it sleeps until the process is gone."""

def settle_threads() -> None:
    """Wait until every thread that waited in a link is back in Python or asleep."""

def after_fork() -> None:
    """In the child: only the thread that forked goes on."""

def encode(
    protocol: ProtocolTable,
    format: FormatTable,
    index: int,
    values: dict[str, Any],
    header: dict[str, Any],
    form: int = -1,
) -> bytes:
    """One frame.

    :param index: of the message in the protocol.
    :param header: values of header fields, where they differ from the defaults.
    :param form: of the frame, in the plan's order; -1: the first that the header allows and that can carry the message.
    :raises MessageError: a value is refused, or no form can carry the message.
    """

def header_bits(format: FormatTable, header: dict[str, Any]) -> list[int]:
    """Bits on the wire of each header field of the format, with the sender's defaults where no value is given.

    :raises MessageError: a wrong name or value.
    """

def pack_messages(messages: list[Message]) -> bytes:
    """Received messages as bytes for another process; docs/server.md has the layout of a record."""

def unpack_messages(
    protocol: ProtocolTable,
    format: FormatTable,
    records: bytes | memoryview,
    shift: float = 0.0,
    stamper: Callable[[Message], tuple[float, float] | None] | None = None,
) -> list[Message]:
    """The messages of such bytes, with ``shift`` seconds added to their times, and with this stamper.

    :raises ValueError: no engine with this protocol can have written them.
    """

def decode_columns(
    protocol: ProtocolTable,
    format: FormatTable,
    capture: object,
    threads: int,
    progress: Callable[[int, int], object] | None,
) -> dict[str, Any]:
    """A whole capture. Releases the interpreter's lock.

    :param capture: a buffer.
    :param threads: 1 or more.
    :returns: ``messages``: by name a dict of ``fields`` and ``offset``; ``stats`` as ``Decoder.stats``.
    :raises TypeError: ``capture`` is not a buffer.
    """

def decode_timed_columns(
    protocol: ProtocolTable,
    format: FormatTable,
    capture: object,
    reads: dict[str, Any],
    progress: Callable[[int, int], object] | None,
) -> dict[str, Any]:
    """A capture that came read by read. Releases the interpreter's lock.

    :param reads: ``ends`` of the reads in the capture (u64 each) and their ``times`` (f64 each, seconds, not falling)
        as buffers; ``idle`` in seconds; ``breaks``: the port was away before the read of this index; ``expected``:
        before the read of this index the message of this index was asked for.
    :returns: as ``decode_columns``; each table also has ``t``.
    """

def message_records(buffer: object, at: int, end: int) -> tuple[int, bytes, bytes, bytes, bytes, bytes]:
    """The messages of an MCAP file from ``at`` on, up to another record, or one that is not whole; at most a million.

    :returns: where that is; channels (u16 each), log and publish times (u64 each), places of the data (u64 each) and
        their sizes (u32 each).
    """

def gathered(buffer: object, places: object, sizes: object) -> bytes:
    """The bytes at these places (u64 each) of these sizes (u32 each), one behind the other."""

def packed_records(
    buffer: object,
    pieces: tuple[object, object, object, object, object],
    decoded: tuple[object, object, object, object],
    payloads: list[bytes],
) -> tuple[bytes, bytes, bytes, bytes]:
    """Message records of an MCAP file, one behind the other.

    :param pieces: channels (u16), log and publish times (u64), places and sizes (u64, u32) of messages whose data lie
        in ``buffer``.
    :param decoded: of further messages behind which of these each comes (u32), channels, log and publish times.
    :param payloads: the data of the further messages.
    :returns: the records; of each its place in them (u64), channel (u16) and log time (u64).
    """
