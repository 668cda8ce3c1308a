"""A link: one port, opened and supervised by threads of its own, that receives messages and sends frames.

One file: all that a program can do with a link. Each method is a few lines and its documentation.
"""

from __future__ import annotations

import math
import os
import threading
import time
import weakref
from collections.abc import Callable, Mapping
from functools import partial
from types import TracebackType
from typing import Any, Self

from wirebond.arguments import path, real, shown, whole
from wirebond.codec import Codec, load, refuse_option_for_field, stats_from
from wirebond.errors import LinkDownError, UsageError
from wirebond.link import ending
from wirebond.link.accounts import LinkStats, SendStats
from wirebond.link.attached.address import SCHEME, server_address
from wirebond.link.attached.attached_recordings import ServerRecordings
from wirebond.link.attached.attaching import codec_of_server
from wirebond.link.attached.servers_port import ServersPort
from wirebond.link.attached.words import Control
from wirebond.link.clock_line import HostTime
from wirebond.link.clock_sync import ClockReading
from wirebond.link.common_port import CommonPort
from wirebond.link.devices.port_name import MAX_BAUD
from wirebond.link.dump import Dump, Piece
from wirebond.link.ends import actions_at, other
from wirebond.link.frame_maker import FrameMaker, OwnMessage
from wirebond.link.frame_sender import FrameSender
from wirebond.link.inbox import Inbox
from wirebond.link.internals import LinkInternals
from wirebond.link.line import Line, line_from
from wirebond.link.own_port import OwnPort
from wirebond.link.owner import Owner
from wirebond.link.parameters import Parameters
from wirebond.link.peer import Peer
from wirebond.link.plugins import plugin
from wirebond.link.rates import DEFAULT_WINDOW, RateMeter, Rates
from wirebond.link.receiving import Receiving
from wirebond.link.requests import Outcome, Question
from wirebond.link.services import may_ask
from wirebond.link.tap import TAP_BYTES, RunningRecorder, Tap, noted
from wirebond.protocol.model import End
from wirebond.typed import TypedMessage, name_and_values

DEFAULT_HOLD = 0.2  # seconds that a repeated value lives after `repeat` was last called
MAX_HOLD = 60.0  # seconds: a longer lease would be none

_PROTOCOL = "a protocol file's path, a Codec, or a server's address"


class Link(Receiving):
    """The host's end of one port. It reconnects by itself; frames that were queued when the port went away expire, and
    are counted.

    Threads: any thread may call any method. Iteration and ``receive`` give each message once, to one caller; let one
    thread take them. A forked child has no link: there ``close`` does nothing and the rest raises ``LinkDownError``.

    The end of the program: ``close``, the end of a ``with`` block, an exception that ends it, ``sys.exit``, garbage
    collection and the normal end of the interpreter all end every lease. Each message of the file's ``emergency_stop``
    that was sent or repeated gets its safe value, once, to each address that it went to; ``hand_over`` prevents that
    for what was sent before. A signal without a handler and a kill end the process at once; then the MCU's own
    deadlines guard.
    """

    def __init__(
        self,
        codec: Codec,
        port: str | os.PathLike[str] | CommonPort,
        baud: int | None = None,
        *,
        paced: bool = True,
        hold_back: bool = True,
        adapter_latency: float | None = None,
        listen: str = "own",
        wait_for_port: bool = False,
        hello: bool = True,
        clock_sync: bool = True,
        role: str = "host",
    ) -> None:
        if not isinstance(port, CommonPort):
            port = os.fsdecode(path("port", port, "a port, such as /dev/ttyUSB0"))
        if role not in (End.HOST, End.MCU):
            raise UsageError(f"role is {shown(role)}; expected 'host' or 'mcu'")
        if listen not in ("own", "all"):
            raise UsageError(f"listen is {shown(listen)}; expected 'own' or 'all'")
        self._end = End(role)
        settings = codec.model.link
        self.codec = codec
        if baud is None and isinstance(port, CommonPort):
            baud = port.baud
        baud = settings.baud if baud is None else whole("baud", baud, 1, MAX_BAUD, "bits per second")
        self.paced = paced
        if settings.stop_bits not in (1, 2):
            raise UsageError(f"a Linux tty has 1 or 2 stop bits, and {codec.name} asks for {settings.stop_bits:g}")
        ending.refuse_at_the_end()
        self._owner: Owner
        if isinstance(port, str) and port.startswith(SCHEME):
            self._owner = ServersPort(codec, self._end, server_address(port), wait_for_port)
        else:
            self._owner = OwnPort(
                codec,
                self._end,
                port,
                baud,
                paced=paced,
                hold_back=hold_back,
                adapter_latency=adapter_latency,
                waits=wait_for_port,
            )
        self._engine = self._owner.engine
        self.port = self._owner.port
        self.baud = self._owner.baud
        self.adapter_latency = self._owner.adapter_latency
        self._actions = actions_at(codec, self._end)
        self._frames = FrameMaker(codec, self._end, self._engine)
        self._sender = FrameSender(codec, self.port, self._engine, self._frames)
        if listen == "all":
            self._engine.listen_to_all(True)
        self._inbox = Inbox(codec, self._end, self._engine, self.port, self._actions)
        weakref.finalize(self, self._engine.close).atexit = False  # a thread of the inbox may keep the engine
        asks = may_ask(codec, listen == "all")
        self._services = self._owner.begin_services(self, self._inbox, hello and asks, clock_sync and asks)
        #: The parts, for this package's own modules.
        self.internals = LinkInternals(
            self._engine, self._frames, self._sender, self._inbox, self._services, self._actions
        )
        self._meter = RateMeter(codec.model, self.baud, self.stats, time.monotonic(), other(self._end))
        self._meter_lock = threading.Lock()
        ending.note_open(self)

    # ---- sending

    def send(
        self,
        message: str | TypedMessage,
        values: Mapping[str, Any] | None = None,
        /,
        *,
        header: Mapping[str, Any] | None = None,
        **fields: Any,
    ) -> None:
        """Send one frame. Returns when it is queued or written; never waits for the line. Any thread.

        :param message: a message of the host by its name, or an object of a generated module.
        :param values: its fields by name, in SI units.
        :param header: the frame's own named fields, where they differ from the host's defaults, as for `Codec.encode`.
            The link increments a sequence number, unless it is given here.
        :param fields: its fields as keywords; they override those of ``values``.
        :raises MessageError: a value is wrong, or the message is the MCU's to send.
        :raises StoppedError: an emergency stop holds the message.
        :raises LinkDownError: the port is gone at the moment, and the link is looking for it; or the link is closed.
        :raises QueueFullError: 64 KiB are queued already: the line is too slow for what is sent.
        """
        name, given = name_and_values(message, values, fields)
        own = self._frames.message(name)
        if header is not None:
            refuse_option_for_field("send", own.model, {"header": header}, given)
        if own.reply < 0:
            self._sender.leave(name, self._frames.make(own, given, header))
            return
        self._engine.is_closed()  # in a forked child it raises
        self._inbox.requests.submit(self._question(own, given, header, None))

    def repeat(
        self,
        message: str | TypedMessage,
        values: Mapping[str, Any] | None = None,
        /,
        *,
        hold: float = DEFAULT_HOLD,
        header: Mapping[str, Any] | None = None,
        **fields: Any,
    ) -> None:
        """Repeat this value at the rhythm of the message's ``every``, for ``hold`` seconds after this call. Any thread.

        The program calls it again in time to continue. If it does not, because it hangs or ends, the lease ends: queued
        frames of the message are dropped, and its safe value (that of ``emergency_stop``) is sent once, before
        everything else. A message without a safe value is not sent any more. So a program that hangs cannot keep a
        robot driving.

        Where frames have addresses, each address has a lease of its own: a value for one servo does not replace that of
        another, and the safe value goes to the address whose lease ends, with the other header values of the file's
        stop. There are leases for 255 addresses beside the first one of each message.

        :param message: a message of the host by its name, or an object of a generated module.
        :param values: its fields by name, in SI units.
        :param fields: its fields as keywords; they override those of ``values``.
        :param hold: seconds, more than 0 and at most 60.
        :param header: the frame's own named fields, as for ``send``.
        :raises MessageError: a value is wrong, or the message is the MCU's to send.
        :raises UsageError: the message has no ``every``, or ``hold`` is out of its range; or the message has a field
            ``hold``, which belongs in ``values``.
        :raises StoppedError: an emergency stop holds the message.
        :raises LinkDownError: the link is closed. A port that is away for a while raises nothing: the value is
            sent again when it is back, within its lease.
        """
        expected = f"more than 0 and at most {MAX_HOLD:g} s: call repeat() again in time"
        hold = real("hold", hold, expected)
        if not 0 < hold <= MAX_HOLD:
            raise UsageError(f"hold is {hold:g} s; expected {expected}")
        name, given = name_and_values(message, values, fields)
        own = self._frames.message(name)
        options = {"hold": None if hold == DEFAULT_HOLD else hold, "header": header}
        refuse_option_for_field("repeat", own.model, options, given)
        if own.model.every is None:
            raise UsageError(f"{name} has no `every` in the protocol file; use send()")
        index, data, reply, takes_number, address = self._frames.make(own, given, header)
        self._sender.raise_for(name, self._engine.repeat(index, data, hold, reply, takes_number, address))

    def stop_repeating(self, message: str, *, header: Mapping[str, Any] | None = None) -> None:
        """End the message's lease at once, without a last value. Any thread.

        :param message: a message of the host, by its name.
        :param header: where frames have addresses: end the lease of this address alone. None: of every address.
        :raises MessageError: the protocol has no such message, or it is the MCU's; or ``header`` has a wrong value.
        """
        own = self._frames.message(message)
        address = None if header is None else self._frames.bits_of(header)
        self._engine.stop_repeating(own.index, address)

    def hand_over(self) -> None:
        """Leave the robot as it is now when this link ends, for a program that takes over while the robot moves. Any
        thread.

        Without this call the end of the link sends the safe value of everything that ``send`` and ``repeat`` moved.
        Whatever is sent after this call is stopped at the end as usual. A lease that is still alive ends with its safe
        value nevertheless.

        :raises LinkDownError: the server that owns the link is away.
        """
        self._engine.hand_over()

    def emergency_stop(self) -> None:
        """Send the file's ``emergency_stop`` before everything that is queued, and repeat it until ``release_stop()``.
        Any thread.

        Never refused, even with a full queue. Queued frames of the stop's messages are dropped, and their leases end.
        The stop is repeated at each message's ``every``, or every 50 ms where it has none. ``send`` and ``repeat`` of
        those messages raise ``StoppedError``. While the port is away the stop waits, and is sent first when it is
        back.

        Where frames have addresses, each message also goes to every address that this link has sent it to, unless the
        file's stop goes to all of them (``broadcast``).

        The latch is kept in this object: another program, and the MCU, do not see it. The latch of an attached link is
        kept in the server and survives its restart. While ``close`` waits in another thread, a stop still goes before
        everything that is queued.

        :raises UsageError: the protocol has none.
        :raises LinkDownError: the link is closed: nothing can be sent any more.
        """
        if self._end == End.MCU or not self.codec.model.emergency_stop:
            reason = f"{self.codec.name} has no emergency_stop" if self._end == End.HOST else "the host sends it"
            raise UsageError(f"no emergency stop was sent: {reason}")
        if not self._engine.stop():
            raise LinkDownError(f"the link to {self.port} is closed; the emergency stop was not sent")

    def release_stop(self, *, over: bool | str = False) -> None:
        """Let the stopped messages be sent again. Sends nothing itself: the robot stays as it is until the program
        sends. Does nothing if there is no stop. Any thread.

        :param over: on an attached link. True: also if another program stopped the robot, or if the server was
            restarted since. A name: only if the program of this name did. The server logs who did it.
        :raises StoppedByOtherError: another program stopped the robot.
        :raises LateCommandError: on an attached link: the network, or the server, delayed the call for too long.
        """
        self._owner.release_stop(over)

    @property
    def stopped(self) -> bool:
        """Does an emergency stop hold its messages? From ``emergency_stop()`` to ``release_stop()``."""
        return self._engine.is_stopped()

    # ---- control

    @property
    def control(self) -> Control:
        """Who may command motion: messages with ``every``, with a deadline at the MCU, or of the emergency stop. A link
        with its own port is always in control. Any thread."""
        return self._owner.control()

    def take_control(self, *, over: bool | str = False) -> None:
        """Become the program in control, until ``release_control``, ``close``, an emergency stop, or 0.3 s in which the
        server does not hear from it. A link with its own port is always in control.

        Without this call, a program's first command takes control if no program has it; a program that has lost control
        must call it.

        :param over: True: also where another program is in control; its leases end with their safe values first. A
            name: only from the program of this name, so that a person takes over from the one that was shown. After
            another program released an emergency stop, and before any is in control, ``over`` is needed, too.
        :raises NotInControlError: another program is in control, or goes first.
        :raises LateCommandError: the network, or the server, delayed the call for too long.
        :raises LinkDownError: the server is away, or the link closed.
        """
        self._owner.take_control(over)

    def release_control(self) -> None:
        """Let another program take control. All leases end first, and whatever this program moved gets its safe value,
        except for what it sent before ``hand_over``. A link with its own port stays in control, and stops the robot,
        too. Any thread."""
        self._owner.release_control()

    # ---- addresses

    @property
    def address(self) -> int | str | None:
        """The address of this end: frames for others are foreign, and it is sent where frames name their sender. None
        if the protocol has no address of this end. A new value holds from then on. Any thread.

        :raises UsageError: set where the protocol has none, to a value that its field cannot hold, or to a broadcast.
        """
        return self._frames.own_address

    @address.setter
    def address(self, value: int | str) -> None:
        self._engine.set_address(self._frames.set_own_address(value))

    # ---- supervision

    @property
    def role(self) -> str:
        """The end that this link is: ``"host"`` or ``"mcu"``."""
        return self._end

    @property
    def state(self) -> str:
        """``down``: the port is gone; ``stale``: no frame for a second; ``up``."""
        return self._engine.state()

    @property
    def why(self) -> str:
        """Why the port is away, as a sentence with what to do; empty while it is there. Any thread."""
        return self._engine.why()

    @property
    def is_attached(self) -> bool:
        """Does a server own the port? Any thread."""
        return self._owner.is_attached

    @property
    def device(self) -> str:
        """The device that is used: of an attached link the server's port, of a stable name its tty, else ``port``. Any
        thread."""
        return self._owner.device()

    @property
    def line(self) -> Line | None:
        """The settings that the driver of the serial port used when it was opened last: the real baud rate, the shape
        of a byte, exclusive use, low latency, the latency timer of an FTDI adapter. None: the port was never open, or
        is not a serial port. Any thread."""
        raw = self._engine.line()
        return None if raw is None else line_from(raw)

    @property
    def peer(self) -> Peer:
        """Whether the MCU was built from the same file: ``unknown``, ``same`` or ``different``. The link sends hello
        each time the port is opened, and when the MCU restarts; the MCU answers. Any thread."""
        return self._services.peer

    @property
    def parameters(self) -> Parameters:
        """The parameters of the MCU: ``list``, ``get``, ``set``, ``save``, ``load``. Any thread.

        :raises UsageError: the file maps no ``parameter``.
        """
        return Parameters(self)

    @property
    def clock(self) -> ClockReading | None:
        """The MCU's clock compared with the host's: offset, drift and their bound. None: the file maps no ``clock``, or
        the MCU has not answered yet. Any thread."""
        return self._services.clock

    def host_time(self, mcu_us: int, near: float | None = None) -> HostTime:
        """Convert a time of the MCU, such as a stamp in a message, to the host's time. Keeps the order of times. Any
        thread.

        :param mcu_us: microseconds of the MCU's clock, which may have wrapped.
        :param near: a host's time within half an hour, on ``time.monotonic()``, such as the message's ``t``. None: now.
        :returns: the time on ``time.monotonic()``, with its bound.
        :raises UsageError: the MCU's clock is not known: the file maps no ``clock``, or the MCU has not answered yet.
        """
        real("mcu_us", mcu_us, "microseconds of the MCU's clock")
        now = time.monotonic() if near is None else real("near", near, "seconds of time.monotonic()")
        return self._services.host_time(mcu_us, now)

    @property
    def deadlines(self) -> dict[str, bool]:
        """The deadlines of this end: for each action, True if it has struck and not ended yet."""
        struck = set(self._engine.struck_deadlines())
        return {name: index in struck for index, name in enumerate(self._actions)}

    def recover(self, action: str) -> None:
        """End a deadline with ``recover: explicit``.

        :param action: the deadline's ``then``.
        :raises UsageError: the file has no such deadline at this end.
        """
        self._check_action(action, "to recover")
        self._engine.recover_deadline(self._actions.index(action))

    @property
    def stats(self) -> LinkStats:
        """The accounts of both directions, exact at this moment. Any thread."""
        raw = self._engine.stats()
        send = SendStats(**raw.pop("send"))
        rest = {name: raw.pop(name) for name in ("late", "held_back", "reconnects", "echoed_bytes", "collisions")}
        dropped = raw.pop("dropped_messages") + self._inbox.dropped
        return LinkStats(stats_from(raw), send, dropped, **rest, handler_errors=self._inbox.handlers.errors)

    def rates(self, window: float = DEFAULT_WINDOW) -> Rates:
        """Return the recent rates by message compared with their schedule, losses, and line use. Any thread.

        It compares the account with an earlier one; each call keeps one, and so does the opening of the link. The
        newest that is at least ``window`` seconds old is used, or the oldest. ``Rates.seconds`` says how long
        that is. A program that calls it once a second gets the last 2 to 3 seconds.

        :param window: seconds, more than 0; accounts older than a minute may be gone.
        :returns: the rates, with the time that they are of.
        :raises UsageError: ``window`` is no such number.
        """
        expected = "seconds, more than 0, such as 2"
        window = real("window", window, expected)
        if not 0 < window < math.inf:
            raise UsageError(f"window is {window}; expected {expected}")
        with self._meter_lock:
            return self._meter.rates(self.stats, time.monotonic(), window)

    def dump(self) -> Dump:
        """Return the last bytes of both directions, to examine a fault: 10 s of a full line, at least 64 KiB and
        at most 2 MiB. Any thread, also in a handler; copying takes about a millisecond.

        :returns: a copy with times, frames, and causes of discarded bytes.
        """
        now = time.monotonic()
        pieces, dropped_bytes = self._engine.recent()
        found = [Piece(t / 1e6, kind, data) for kind, t, data in pieces]
        return Dump(self.codec, now, found, dropped_bytes, self._end, self.other_protocols)

    @property
    def other_protocols(self) -> list[Codec]:
        """The protocols of the other links on a `CommonPort`: their frames count as discarded bytes here. Any
        thread."""
        return self._owner.other_protocols()

    def tap(self, capacity: int = TAP_BYTES) -> Tap:
        """Begin to keep every read, every write and every event, for a recorder. The first events are the state of the
        link. Any thread.

        :param capacity: bytes that may wait for ``Tap.take``. What does not fit is dropped and counted; the link never
            waits.
        :returns: an open tap; close it.
        :raises UsageError: no such capacity.
        """
        return Tap(self._engine, capacity, self._actions, [m.name for m in self.codec.model.messages])

    def record(self, path: str | os.PathLike[str]) -> RunningRecorder:
        """Record every read, write and event, from now to the end of a ``with`` block or ``close``.
        Any thread; several recordings may run at once.

        :param path: the new file, an MCAP file.
        :returns: the recorder; ``with link.record("run.mcap"):`` closes it.
        :raises UsageError: the file exists, or the link's protocol was not read from a file.
        :raises OSError: the file cannot be written.
        """
        recorder: RunningRecorder = plugin("recorder")(self, path)
        return recorder

    @property
    def recordings(self) -> ServerRecordings:
        """The recordings of the server that this link is attached to, on its disk. Any thread.

        :raises UsageError: the link has a port of its own.
        """
        return self._owner.recordings()

    def note(self, kind: str, **facts: Any) -> None:
        """Add an event of the program to the recordings of this link, at this moment. Any thread.

        :param kind: a word for it.
        :param facts: texts, numbers, lists and mappings of these.
        :raises UsageError: it cannot be written as JSON, or its JSON has more than 4096 characters.
        """
        self._engine.note(noted(kind, facts))

    def close(self) -> None:
        """End every lease, send the safe value of everything that moved (see ``hand_over``) and what is queued (for a
        second at most), and close the port. Messages received before can still be taken. A second call waits for the
        end of the first one. Any thread.

        Handlers get all received messages before ``close`` returns, and are not called after that. ``close`` waits a
        second at most for a handler: messages that still wait for it then are counted as dropped. If ``close`` is
        called in a handler, it waits for none: they get the rest after it."""
        self._engine.close()
        self._services.end()
        if ending.is_ending():  # the inbox's thread sleeps until the process is gone
            self._inbox.give_up()
        else:
            self._inbox.leave(ending.HANDLERS_PATIENCE)
        ending.forget(self)
        self._owner.end()

    def __repr__(self) -> str:
        return (
            f"<wirebond.Link {self.codec.name} on {self.port}: {'closed' if self._engine.is_closed() else self.state}>"
        )

    def _begin_close(self) -> None:
        self._engine.begin_close()

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def _question(
        self,
        own: OwnMessage,
        values: dict[str, Any],
        header: Mapping[str, Any] | None,
        finish: Callable[[Outcome], None] | None,
    ) -> Question:
        name, frame = own.model.name, self._frames.make(own, values, header)
        whole = self._frames.with_own_address(header) or {}
        question = self._inbox.requests.question(name, frame[1], whole, finish)
        question.leave = partial(self._sender.leave, name, frame)
        return question


def open_link(
    protocol: str | os.PathLike[str] | Codec,
    port: str | os.PathLike[str] | CommonPort | None = None,
    baud: int | None = None,
    *,
    paced: bool = True,
    hold_back: bool = True,
    adapter_latency: float | None = None,
    listen: str = "own",
    wait_for_port: bool = False,
    hello: bool = True,
    clock_sync: bool = True,
    role: str = "host",
) -> Link:
    """Open a port with the protocol file's settings, or attach to a server that has one.

    :param protocol: a protocol file's path, or a ``Codec``; or the address of a server, which knows its protocol.
    :param port: a tty's path; ``sim:``, a virtual MCU of this protocol in a thread of this process; a USB device by a
        name that stays, such as ``usb:1a86:55d3`` (see `wirebond.link.devices`); or
        ``tcp://host:port``, a server that forwards a serial line as raw bytes, such as ser2net; or
        ``rfc2217://host:port``, one whose baud rate, parity and stop bits the link sets; or ``replay:run.mcap``, a
        recording, also with options such as ``replay:run.mcap?speed=max&from=12.5&to=20&loop=1``; or
        ``wirebond://NAME`` or ``wirebond://host:port?token=TOKEN``, the link of a running ``wirebond serve``, whose
        settings then hold, not these; or a `CommonPort`, which other links open as well.
    :param baud: bits per second; default: the file's.
    :param paced: frames are handed to the port at the pace of its baud rate, so that at most 5 ms of line, or one
        frame, leave before an emergency stop. False: as fast as the port takes them, for ports whose baud rate means
        nothing, such as an MCU's own USB; all that the driver holds then leaves before a stop.
    :param hold_back: messages that are late, or that a deadline with ``recover: explicit`` holds back, are counted and
        not given to the program. False: the program gets them, too, as a program that only shows or records wants.
    :param adapter_latency: seconds that the port may hold received bytes back, 0 to 1; they are added to ``idle``.
        Default: the file's ``adapter_latency``; without one 16 ms for a USB device and for TCP, the time of 16
        bytes for other ttys, and 0 for what is not a device, such as a pty.
    :param listen: ``"own"``: frames for other addresses, and replies from an address that was not asked, are counted as
        foreign and not given to the program. ``"all"``: they are given, for programs that only show or record.
    :param wait_for_port: a port that cannot be opened at first is not an error: the link is ``down``, says ``why``, and
        looks for it, as it does for one that goes away later.
    :param role: ``"mcu"``: play the MCU against a host: send its messages, hear the host's, keep its deadlines.
    :param hello: where the file maps ``hello``, say it each time that the port is opened, so that ``link.peer`` tells
        whether the MCU has the same protocol. False: the link only listens to the MCU's.
    :param clock_sync: where the file maps ``clock``, ask the MCU's clock once a second, for ``link.clock`` and
        ``link.host_time``. False: it is not asked.
    :returns: a link that is reading already; close it, or use it in a ``with`` block.
    :raises ProtocolFileError: the file cannot be used.
    :raises PortError: the port cannot be opened; the sentence says why and what to do.
    :raises UsageError: an option or the port has an impossible value; or a server owns a link of another protocol.
    """
    if port is None:
        if isinstance(protocol, Codec) or not os.fsdecode(path("protocol", protocol, _PROTOCOL)).startswith(SCHEME):
            raise UsageError("open() needs a port after the protocol file, such as /dev/ttyUSB0, or a server's address")
        port = os.fsdecode(protocol)
        codec = codec_of_server(server_address(port))
    else:
        codec = protocol if isinstance(protocol, Codec) else load(protocol)
    return Link(
        codec,
        port,
        baud,
        paced=paced,
        hold_back=hold_back,
        adapter_latency=adapter_latency,
        listen=listen,
        wait_for_port=wait_for_port,
        hello=hello,
        clock_sync=clock_sync,
        role=role,
    )
