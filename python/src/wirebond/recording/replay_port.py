"""The port ``replay:run.mcap``: a link reads what was recorded, by the recording's own clock. So the same recording
gives the same messages at the same times, however fast it goes and however busy the computer is."""

from __future__ import annotations

import math
import threading
import time
from collections.abc import Iterator
from pathlib import Path

from wirebond.codec import Codec
from wirebond.errors import PortError, WirebondError
from wirebond.link.clock_line import HostTime
from wirebond.link.devices.port_name import PortName
from wirebond.link.stamps import Stamper, has_stamps
from wirebond.link.tap import Chunk
from wirebond.recording.capture import is_capture
from wirebond.recording.recording import Recording
from wirebond.recording.replay import Pace, Section
from wirebond.recording.stamps import RecordedClock

_TICK = 0.01  # seconds of the recording between two checks of deadlines and silences
_LONG = 600.0  # seconds of silence after which checks become rarer: a damaged time may be years away
_LONGEST_READ = 0.01  # seconds


class ReplayClock:
    """The position of the replay, by ``time.monotonic()`` from its start. Any thread."""

    def __init__(self) -> None:
        self._origin_us = time.monotonic_ns() // 1000
        self._at = 0.0

    def now_us(self) -> int:
        return self._origin_us + round(self._at * 1e6)

    def seconds(self, t: float) -> float:
        """Convert a time of the section to seconds on this clock."""
        return (self._origin_us + round(t * 1e6)) / 1e6

    def section_time(self, t: float) -> float:
        """Return the other way round. A link's times are whole microseconds: with half of one more, it is behind what
        came."""
        return t - self._origin_us / 1e6 + 0.5e-6

    def go_to(self, t: float) -> None:
        self._at = max(self._at, t)


class ReplayedClock:
    """The MCU's clock as the recorded link knew it at each time of the replay: a ``ToHost``. Any thread. The first
    question reads the whole recording.

    :param section: which part is replayed.
    """

    def __init__(self, recording: Recording, section: Section, clock: ReplayClock) -> None:
        self._known = RecordedClock(recording.codec, lambda end: recording._decoded(end).tables)
        self._length = section.length(recording) if section.loop else math.inf
        self._start = section.start
        self._clock = clock

    def __call__(self, mcu_us: int, near: float, wrap_us: int) -> HostTime | None:
        """See ``stamps.ToHost``."""
        t = self._clock.section_time(near)
        begin = math.floor(t / self._length) * self._length if 0 < self._length < math.inf else 0.0
        recorded = t - begin + self._start
        found = self._known(mcu_us, recorded, wrap_us)
        return None if found is None else HostTime(near + (found.t - recorded), found.error)


class ReplayPort:
    """A ``PythonPort``. What is written goes nowhere."""

    def __init__(self, recording: Recording, direction: str, section: Section, clock: ReplayClock) -> None:
        self._chunks: Iterator[Chunk] = section.rounds(recording, direction)
        self._next: Chunk | None = next(self._chunks, None)
        self._end = section.length(recording)
        self._clock = clock
        self._pace = Pace(section)
        self._fastest = section.is_fastest
        self._tick = _TICK
        self._heard = 0.0  # when the last bytes came
        self._ends = threading.Event()

    def read(self) -> tuple[bytes, float]:
        """See ``PythonPort``. Without bytes: a look at the clock, at times that depend on the recording alone."""
        chunk = self._next
        if chunk is None and self._tick > self._end + 10 * _TICK:
            raise ReplayEndedError
        due = min(self._tick, chunk.t if chunk is not None else self._tick)
        if not self._pace.wait(due, self._ends):
            raise ReplayEndedError
        self._clock.go_to(due)
        if chunk is None or self._tick <= chunk.before:
            self._tick += _TICK if self._tick - self._heard < _LONG else max(_TICK, (self._tick - self._heard) / 100)
            return b"", self._clock.seconds(due)
        if self._tick <= chunk.t:
            self._tick += _TICK * (math.floor((chunk.t - self._tick) / _TICK) + 1)
        self._heard = chunk.t
        self._clock.go_to(chunk.t)
        self._next = next(self._chunks, None)
        return chunk.bytes, self._clock.seconds(chunk.before)

    def write(self, data: bytes) -> int:
        """See ``PythonPort``."""
        return len(data)

    def held(self) -> int:
        """See ``PythonPort``."""
        return 0

    def cancel(self) -> None:
        """See ``PythonPort``."""
        self._ends.set()

    def close(self) -> None:
        """See ``PythonPort``."""

    def leave_to_parent(self) -> None:
        """See ``PythonPort``."""


class ReplayEndedError(OSError):
    """The recording is over."""


class ReplayOpener:
    """Opens it once. One thread at a time.

    :param role: the end that the link plays.
    :param codec: the link's. A raw capture is decoded with it.
    :raises PortError: the file is not a recording.
    """

    def __init__(self, text: str, path: Path, section: Section, role: str, codec: Codec) -> None:
        self._text = text
        self._section = section
        try:
            self._recording = Recording(path, codec if is_capture(path) else None)
        except (WirebondError, OSError) as error:
            why = f"{path}: {error.strerror}" if isinstance(error, OSError) and error.strerror else str(error)
            raise PortError(f"{text} cannot be replayed: {why}", None, text) from None
        self._direction = "sent" if role != self._recording.role else "received"
        self.clock = ReplayClock()
        self.waits_for_reader = section.is_fastest
        self.line = None  # it has no settings
        self._is_open = False

    @property
    def latency(self) -> float:
        """Seconds that the recorded port could hold bytes back."""
        return self._recording.idle - self._recording.codec.model.idle_seconds

    def stamper(self, codec: Codec) -> Stamper | None:
        """Return the function that gives the messages of a link their stamps, if messages of ``codec`` have some."""
        if not has_stamps(codec):
            return None
        return Stamper(codec, ReplayedClock(self._recording, self._section, self.clock))

    def open(self) -> ReplayPort:
        if self._is_open:
            raise PortError(f"the replay of {self._text} has ended", None, self._text)
        self._is_open = True
        return ReplayPort(self._recording, self._direction, self._section, self.clock)

    def why_gone(self, _error: OSError | None) -> str:
        return f"the replay of {self._text} has ended"

    def appearance(self) -> object:
        return None


def open_replay(port: PortName, role: str, codec: Codec) -> ReplayOpener:
    """Make the opener of a ``replay:`` port, for a link.

    :param role: the end that the link plays.
    :param codec: the link's.
    :raises PortError: the file is not a recording.
    """
    section = Section(port.speed, port.start, port.stop, port.loop)
    return ReplayOpener(port.text, Path(port.recording), section, role, codec)
