"""A recording into a firmware under virtual time: the host's bytes come at their times, and what the firmware sends is
recorded. The same recording gives the same bytes, on every machine."""

from __future__ import annotations

import os
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from types import TracebackType
from typing import Self

from wirebond.codec import Codec
from wirebond.errors import UsageError
from wirebond.link.tap import Chunk, LinkEvent
from wirebond.protocol.model import End
from wirebond.recording.recording import Recording
from wirebond.recording.replay import Section
from wirebond.recording.writer import RecordingWriter
from wirebond.sim.lockstep import LockstepFirmware

_STEP = 0.001  # seconds between two reads of the firmware's bytes
_LONGEST = 86_400.0  # seconds of a recording; a damaged time may be years away
Progress = Callable[[int, int], object]


@dataclass(frozen=True)
class Rerun:
    """The result of a recording in a firmware.

    :ivar sent: its bytes.
    :ivar events: what it reported, with times in seconds.
    :ivar recorded: the bytes that the recording has of the MCU.
    """

    sent: bytes
    events: tuple[LinkEvent, ...]
    recorded: bytes

    @property
    def differs_at(self) -> int | None:
        """The first byte in which they differ; None: they are the same."""
        if self.sent == self.recorded:
            return None
        pairs = zip(self.sent, self.recorded, strict=False)
        return next((i for i, (a, b) in enumerate(pairs) if a != b), min(len(self.sent), len(self.recorded)))


class RecordedFirmware:
    """A firmware under virtual time whose line is recorded, as the host sees it. What is sent comes at the moment that
    was reached: a firmware that wakes at that very moment has looked before, and sees it when it looks next.

    ``with RecordedFirmware(program, "run.mcap", codec) as firmware:``

    :param program: it is run with ``--lockstep``.
    :param out: the new recording; None: nothing is recorded.
    :param codec: the protocol; without ``out`` it is not needed.
    :param wall_ns: when it begins, in nanoseconds since 1970.
    :ivar sent: all bytes that the firmware has sent.
    :ivar events: all that it has reported.
    """

    def __init__(
        self, program: Path, out: str | os.PathLike[str] | None = None, codec: Codec | None = None, wall_ns: int = 0
    ) -> None:
        self.sent = bytearray()
        self.events: list[LinkEvent] = []
        self._writer: RecordingWriter | None = None
        if out is not None and codec is not None:
            self._writer = RecordingWriter(Path(out), codec, "host", 0.0, wall_ns, {"port": program.name})
        try:
            self._firmware = LockstepFirmware(program)
        except BaseException:
            if self._writer is not None:
                self._writer.close()
            raise

    @property
    def now(self) -> float:
        """Seconds since the start."""
        return self._firmware.now

    def send(self, data: bytes) -> None:
        """Write as the host, now."""
        self._firmware.send(data)
        self._note(Chunk(self.now, self.now, "sent", data))

    def tell(self, line: str) -> None:
        """Give the firmware a line of its operator; it is recorded as an event."""
        self._firmware.tell(line)
        self._note(LinkEvent(self.now, "operator", {"text": line}))

    def advance(self, seconds: float) -> bytes:
        """Let time pass; return the bytes that the firmware sent in it."""
        return self.advance_to(self.now + seconds)

    def advance_to(self, until: float) -> bytes:
        """Do the same up to this time. The firmware counts whole microseconds."""
        came = bytearray()
        while (left_us := round((until - self.now) * 1e6)) > 0:
            part = self._firmware.advance(min(_STEP, left_us / 1e6))
            for event in self._firmware.events:
                self.events.append(LinkEvent(event.t, "firmware", {"text": event.text}))
                self._note(self.events[-1])
            self._firmware.events.clear()
            if part:
                self._note(Chunk(self.now, self.now, "received", part))
            came += part
        self.sent += came
        return bytes(came)

    def close(self) -> None:
        """End the firmware, and finish the recording."""
        self._firmware.close()
        if self._writer is not None:
            self._writer.add(LinkEvent(self.now, "end"))
            self._writer.finish()
            self._writer.close()
            self._writer = None

    def _note(self, piece: Chunk | LinkEvent) -> None:
        if self._writer is not None:
            self._writer.add(piece)

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()


def replay_into_firmware(
    recording: Recording,
    program: Path,
    out: Path | None = None,
    section: Section | None = None,
    *,
    progress: Progress | None = None,
) -> Rerun:
    """Run ``program --lockstep`` through a recording. Each chunk of the host comes when it was written, and each line
    of an operator when it was given.

    :param out: record this run, as the host saw it.
    :param section: a part; its speed does not matter.
    :raises UsageError: it lasts more than a day.
    :raises WirebondError: the program ended.
    :raises OSError: it cannot be run, or ``out`` cannot be written.
    """
    section = section or Section()
    host, mcu = recording.direction_of(End.HOST), recording.direction_of(End.MCU)
    length = section.length(recording)
    if length > _LONGEST:
        raise UsageError(
            f"{recording.path.name} lasts {length:.0f} s, and at most {_LONGEST:.0f} s go into a firmware at once; "
            "choose a part with --from and --to"
        )
    steps: list[Chunk | LinkEvent] = list(section.chunks(recording, host))
    for event in recording.events:
        t = event.t - section.start
        if event.kind == "operator" and isinstance(event.facts.get("text"), str) and 0 <= t <= length:
            steps.append(LinkEvent(t, event.kind, event.facts))
    steps.sort(key=lambda step: step.t)
    with RecordedFirmware(program, out, recording.codec, recording._start_ns) as firmware:
        for number, step in enumerate(steps):
            firmware.advance_to(step.t)
            if isinstance(step, Chunk):
                firmware.send(step.bytes)
            else:
                firmware.tell(step.facts["text"])
            if progress is not None:
                progress(number, len(steps))
        firmware.advance_to(length)
    recorded = b"".join(chunk.bytes for chunk in section.chunks(recording, mcu))
    return Rerun(bytes(firmware.sent), tuple(firmware.events), recorded)
