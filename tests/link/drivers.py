"""One face over three links: the core under virtual time with a simulated wire; and over a pty whose far end reads as
fast as a wire carries the engine's thread, and the threads in Python. The same tests run on all."""

from __future__ import annotations

import subprocess
import sys
import tempfile
from abc import ABC, abstractmethod
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest

import wirebond
from tests.waiting import PATIENCE, let_pass, wait_until
from wirebond import _engine
from wirebond.errors import LinkDownError, QueueFullError, StoppedError
from wirebond.link import DEFAULT_HOLD
from wirebond.link.settings import engine_settings
from wirebond.protocol.model import End
from wirebond.sim.pty_port import PtyPort

_FAR_END = Path(__file__).with_name("far_end.py")
_ERRORS: dict[int, Callable[[str], Exception]] = {
    1: LinkDownError,
    2: QueueFullError,
    3: lambda name: StoppedError(name, ()),
}


def balances(send: dict[str, int] | wirebond.SendStats) -> bool:
    s = send if isinstance(send, dict) else vars(send)
    accepted = ("sent", "queued", "replaced", "expired", "overruled", "aborted")
    refused = ("refused_down", "refused_full", "refused_stopped")
    return s["offered"] == s["accepted"] + sum(s[name] for name in refused) and s["accepted"] == sum(
        s[name] for name in accepted
    )


class Driver(ABC):
    """A link, a wire and its far end. Every step ends with a look at the account."""

    def __init__(self, codec: wirebond.Codec) -> None:
        self.codec = codec

    # ---- what programs call

    @abstractmethod
    def send(self, name: str, **fields: Any) -> None: ...
    @abstractmethod
    def repeat(self, name: str, hold: float = DEFAULT_HOLD, **fields: Any) -> None: ...
    @abstractmethod
    def stop_repeating(self, name: str) -> None: ...
    @abstractmethod
    def hand_over(self) -> None: ...
    @abstractmethod
    def release_control(self) -> None: ...
    @abstractmethod
    def emergency_stop(self) -> None: ...
    @abstractmethod
    def release_stop(self) -> None: ...
    @abstractmethod
    def receive(self) -> list[wirebond.Message]: ...
    @abstractmethod
    def recover(self, action: str) -> None: ...
    @abstractmethod
    def deadlines(self) -> dict[str, bool]: ...
    @abstractmethod
    def state(self) -> str: ...
    @abstractmethod
    def close(self) -> None: ...

    # ---- the world

    @abstractmethod
    def run(self, seconds: float) -> None:
        """Time goes by."""

    @abstractmethod
    def answer(self, data: bytes) -> None:
        """The MCU sends."""

    @abstractmethod
    def unplug(self) -> None: ...
    @abstractmethod
    def plug(self) -> None: ...

    @abstractmethod
    def arrived(self) -> bytes:
        """All that came out at the far end of the wire that is plugged in."""

    @abstractmethod
    def stats(self) -> dict[str, Any]:
        """Return the account of sending, with late, held_back and reconnects."""

    # ---- shared

    @abstractmethod
    def end(self) -> None:
        """Give back what the world holds."""

    def check(self) -> None:
        assert balances(self.stats()["send"])

    def run_until(self, condition: Callable[[], bool], what: str) -> None:
        """Time goes by until this is true."""
        for _ in range(round(PATIENCE / 0.005)):
            if condition():
                return
            self.run(0.005)
        raise AssertionError(f"in vain: {what}")

    def settle(self) -> None:
        """Time goes by until all that left has arrived. For a link that repeats nothing."""
        self.run_until(self._is_settled, "all that left arrives")

    def _is_settled(self) -> bool:
        sent = self.stats()["send"]
        return bool(sent["queued"] == 0 and len(self.arrived()) == sent["sent_bytes"])

    def messages(self) -> list[tuple[str, dict[str, Any]]]:
        decoder = self.codec.decoder("host")
        found = [(m.name, dict(m.fields)) for m in decoder.feed(self.arrived())]
        assert sum(decoder.stats.discarded_bytes.values()) == 0
        return found

    def names(self) -> list[str]:
        return [name for name, _ in self.messages()]

    def fill_queue(self, name: str, **fields: Any) -> int:
        """Until it is refused; how many were taken."""
        taken = 0
        while True:
            try:
                self.send(name, **fields)
            except QueueFullError:
                return taken
            taken += 1


class VirtualDriver(Driver):
    """Steps from one due time to the next. The wire takes a byte each byte time out of a driver's buffer of 4 KB."""

    kind = "virtual"
    buffer_bytes = 4096

    def __init__(
        self, codec: wirebond.Codec, baud: int = 115200, wire_baud: int | None = None, **settings: Any
    ) -> None:
        super().__init__(codec)
        self.now = 1_000_000
        self._index = {m.name: i for i, m in enumerate(codec.model.messages)}
        self._reply = {m.name: self._index.get(m.reply or "", -1) for m in codec.model.messages}
        self._actions = list(dict.fromkeys(d.then for d in codec.model.deadlines if d.at == End.HOST))
        self.core = _engine.LinkCore(
            codec.tables.protocol, codec.tables.format_for(End.MCU), engine_settings(codec, baud, **settings), self.now
        )
        self.byte_us = 1e6 * codec.model.link.bits_per_byte / (wire_baud or baud)
        self.tells_what_it_holds = False  # as a tty does and a pty does not
        self._buffer = bytearray()
        self._out = bytearray()
        self._out_at = float(self.now)  # when the wire took its last byte
        self._idle_us = 0.0  # the wire had nothing to carry
        self.is_plugged = True
        self.core.port_up(self.now)

    def _do(self) -> None:
        self.core.poll(self.now)
        self._write()
        self.check()

    def _write(self) -> None:
        self._carry()
        while self.is_plugged:
            if self.tells_what_it_holds:
                self.core.driver_holds(len(self._buffer), self.now)
            data = self.core.to_write(self.now, together=True)
            if not data:
                return
            room = min(len(data), self.buffer_bytes - len(self._buffer))
            self._buffer += data[:room]
            self.core.written(room, self.now)
            if room == 0:
                return

    def _carry(self) -> None:
        while self._out_at + self.byte_us <= self.now:
            if not self._buffer:
                self._idle_us += self.now - self._out_at
                self._out_at = self.now
                return
            self._out_at += self.byte_us
            self._out.append(self._buffer.pop(0))

    def run(self, seconds: float) -> None:
        end = self.now + round(seconds * 1e6)
        while self.now < end:
            due = self.core.next_due(self.now)
            if self.core.is_blocked():
                due = min(due, self.now + 100)
            if self._buffer:
                due = min(due, self.now + 2_000)
            self.now = max(self.now + 1, min(due, end, self.now + 10_000))
            self._carry()
            if self.is_plugged:
                self.core.idle(self.now)
            self._do()

    @property
    def buffered(self) -> int:
        """Bytes that the port's driver holds."""
        self._carry()
        return len(self._buffer)

    @property
    def wire_idle_us(self) -> float:
        self._carry()
        return self._idle_us

    def _raise_for(self, name: str, answer: int) -> None:
        self._write()
        self.check()
        if answer:
            raise _ERRORS[answer](name)

    def send(self, name: str, **fields: Any) -> None:
        frame = self.codec.encode(name, fields)
        self._raise_for(name, self.core.send(self._index[name], frame, self._reply[name], self.now))

    def repeat(self, name: str, hold: float = DEFAULT_HOLD, **fields: Any) -> None:
        frame = self.codec.encode(name, fields)
        self._raise_for(name, self.core.repeat(self._index[name], frame, hold, self._reply[name], self.now))

    def stop_repeating(self, name: str) -> None:
        self.core.stop_repeating(self._index[name])
        self._do()

    def hand_over(self) -> None:
        self.core.hand_over_motion()

    def release_control(self) -> None:
        self.core.end_motion()

    def emergency_stop(self) -> None:
        self.core.stop(self.now)
        self._do()

    def release_stop(self) -> None:
        self.core.release_stop()
        self._do()

    def receive(self) -> list[wirebond.Message]:
        return self.core.receive()

    def recover(self, action: str) -> None:
        self.core.recover_deadline(self._actions.index(action), self.now)

    def deadlines(self) -> dict[str, bool]:
        struck = self.core.struck_deadlines()
        return {name: i in struck for i, name in enumerate(self._actions)}

    def state(self) -> str:
        return self.core.state(self.now)

    def close(self) -> None:
        self.core.close()
        self._do()
        until = self.now + 1_000_000
        while self.is_plugged and not self.core.is_empty() and self.now < until:
            self.run(0.001)
        self.core.end(self.now)
        self.check()
        self.run(0.1)  # what the driver holds leaves

    def answer(self, data: bytes) -> None:
        self.core.received(data, self.now, self.now)
        self._do()

    def unplug(self) -> None:
        self.is_plugged = False
        self._buffer.clear()
        self.core.port_down(self.now)
        self._do()

    def plug(self) -> None:
        self.is_plugged = True
        self._out.clear()
        self._out_at = self.now
        self.core.port_up(self.now)
        self._do()

    def end(self) -> None:
        self.check()

    def arrived(self) -> bytes:
        self._carry()
        return bytes(self._out)

    def stats(self) -> dict[str, Any]:
        return self.core.stats()


class ThreadDriver(Driver):
    """``wirebond.open`` over a pty; a process of its own is the wire's far end."""

    kind = "thread"

    def __init__(self, codec: wirebond.Codec, **options: Any) -> None:
        super().__init__(codec)
        self._folder = tempfile.TemporaryDirectory()
        self._name = Path(self._folder.name) / "tty"
        self._pty: PtyPort | None = None
        self._reader: FarEnd | None = None
        self._plug_in()
        self.link = self._open(options)

    def _open(self, options: dict[str, Any]) -> wirebond.Link:
        return wirebond.open(self.codec, self._name, **options)

    def _plug_in(self) -> None:
        self._pty = PtyPort()
        self._reader = FarEnd(self._pty, 115200 / self.codec.model.link.bits_per_byte)
        self._is_plugged = True
        self._name.symlink_to(self._pty.path)

    def run(self, seconds: float) -> None:
        let_pass(seconds)
        self.check()

    def run_until(self, condition: Callable[[], bool], what: str) -> None:
        wait_until(condition, what)
        self.check()

    def send(self, name: str, **fields: Any) -> None:
        self.link.send(name, fields)

    def repeat(self, name: str, hold: float = DEFAULT_HOLD, **fields: Any) -> None:
        self.link.repeat(name, fields, hold=hold)

    def stop_repeating(self, name: str) -> None:
        self.link.stop_repeating(name)

    def hand_over(self) -> None:
        self.link.hand_over()

    def release_control(self) -> None:
        self.link.release_control()

    def emergency_stop(self) -> None:
        self.link.emergency_stop()

    def release_stop(self) -> None:
        self.link.release_stop()

    def receive(self) -> list[wirebond.Message]:
        return self.link.receive()

    def recover(self, action: str) -> None:
        self.link.recover(action)

    def deadlines(self) -> dict[str, bool]:
        return self.link.deadlines

    def state(self) -> str:
        return self.link.state

    def close(self) -> None:
        self.link.close()
        self.check()
        if self._is_plugged:
            self.reader.settle(self.stats()["send"]["sent_bytes"])

    @property
    def reader(self) -> FarEnd:
        assert self._reader is not None
        return self._reader

    def answer(self, data: bytes) -> None:
        assert self._pty is not None
        self._pty.write(data)

    def unplug(self) -> None:
        assert self._pty is not None
        self._name.unlink()  # before its number is free: another pty may get it
        self._is_plugged = False
        self.reader.close()
        self._pty.close()
        self.run_until(lambda: self.link.state == "down", "the link notices that the port is away")

    def plug(self) -> None:
        self._plug_in()
        self.run_until(lambda: self.link.state != "down", "the link finds the port again")

    def arrived(self) -> bytes:
        return self.reader.data()

    def stats(self) -> dict[str, Any]:
        stats = self.link.stats
        return {
            "send": vars(stats.send),
            "late": stats.late,
            "held_back": stats.held_back,
            "reconnects": stats.reconnects,
        }

    def end(self) -> None:
        self.link.close()
        if self._is_plugged:
            assert self._pty is not None
            self.reader.close()
            self._pty.close()
        self._folder.cleanup()


class PythonDriver(ThreadDriver):
    """Drives a link whose engine has no ports, as on Windows: pyserial opens the pty."""

    kind = "python"

    def _open(self, options: dict[str, Any]) -> wirebond.Link:
        with no_engine_ports():
            return super()._open(options)


@contextmanager
def no_engine_ports() -> Iterator[None]:
    """Links that are opened meanwhile are driven from Python."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("wirebond.link.settings.HAS_ENGINE_PORTS", False)
        yield


class FarEnd:
    """A process that takes bytes off a pty as fast as a wire carries them, and writes down which came when."""

    def __init__(self, pty: PtyPort, bytes_per_second: float) -> None:
        self._folder = tempfile.TemporaryDirectory()
        self._data = Path(self._folder.name) / "data"
        self._times = Path(self._folder.name) / "times"
        command = [sys.executable, "-S", str(_FAR_END), str(pty.fileno()), str(bytes_per_second)]
        files = [str(self._data), str(self._times)]
        self._process = subprocess.Popen([*command, *files], pass_fds=[pty.fileno()], stdout=subprocess.PIPE)
        assert self._process.stdout is not None
        assert self._process.stdout.readline() == b"ready\n"

    def data(self) -> bytes:
        return self._data.read_bytes()

    def count_at(self, when: float) -> int:
        """Return how many bytes had left the wire at this time of ``time.monotonic()``."""
        count = 0
        for line in self._times.read_text().splitlines():
            at, total = line.split()
            if float(at) > when:
                break
            count = int(total)
        return count

    def settle(self, size: int) -> None:
        wait_until(lambda: self._data.stat().st_size >= size, "all bytes leave the wire")

    def close(self) -> None:
        self._process.kill()  # the process that this object started
        self._process.wait()
        if self._process.stdout is not None:
            self._process.stdout.close()
        self._folder.cleanup()


Make = Callable[..., Driver]
