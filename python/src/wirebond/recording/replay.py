"""A recording as it happened: its pieces at their times, at any speed, into whatever takes bytes or messages."""

from __future__ import annotations

import math
import threading
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import TYPE_CHECKING

from wirebond.errors import UsageError
from wirebond.link.tap import Chunk
from wirebond.protocol.model import End
from wirebond.recording.recording import Recording

if TYPE_CHECKING:
    from wirebond.link import Link

MAX_SPEED = 1e6  # times; faster is as fast as possible
_LONGEST_SLEEP = 0.1  # seconds between two checks whether it shall end


@dataclass(frozen=True)
class Section:
    """The part of a recording to play, and its speed.

    :ivar speed: 1: as it happened; 0: as fast as possible.
    :ivar start: seconds since the start of the recording.
    :ivar stop: the same; None: its end.
    :ivar loop: again and again.
    """

    speed: float = 1.0
    start: float = 0.0
    stop: float | None = None
    loop: bool = False

    def __post_init__(self) -> None:
        if not (0 <= self.speed <= MAX_SPEED):
            raise UsageError(f"the speed is {self.speed:g}; expected 0 (as fast as possible) to {MAX_SPEED:g} times")
        if not (0 <= self.start < math.inf):
            raise UsageError(f"the start is {self.start:g} s; expected seconds since the start of the recording")
        if self.stop is not None and not self.stop > self.start:
            raise UsageError(f"the end is {self.stop:g} s; expected more than the start, {self.start:g} s")

    @property
    def is_fastest(self) -> bool:
        return self.speed == 0

    def length(self, recording: Recording) -> float:
        """Return the seconds of one round."""
        stop = recording.duration if self.stop is None else min(self.stop, recording.duration)
        return max(stop - self.start, 0.0)

    def chunks(self, recording: Recording, direction: str | None) -> Iterator[Chunk]:
        """Yield the chunks of one round; times count from the section's start."""
        for chunk in recording.chunks(direction):
            if chunk.t < self.start:
                continue
            if self.stop is not None and chunk.t > self.stop:
                return
            yield Chunk(chunk.t - self.start, max(chunk.before - self.start, 0.0), chunk.direction, chunk.bytes)

    def rounds(self, recording: Recording, direction: str | None) -> Iterator[Chunk]:
        """Yield the chunks of all rounds; times continue to increase."""
        begin, length = 0.0, self.length(recording)
        while True:
            empty = True
            for chunk in self.chunks(recording, direction):
                empty = False
                yield Chunk(begin + chunk.t, begin + chunk.before, chunk.direction, chunk.bytes)
            if not self.loop or empty:
                return
            begin += length


class Pace:
    """Converts times of a section that begins now to the clock of this computer."""

    def __init__(self, section: Section) -> None:
        self._speed = section.speed
        self._began = time.monotonic()

    def wait(self, t: float, ends: threading.Event | None = None) -> bool:
        """Wait until ``t`` seconds of the section. False: ``ends`` was set."""
        due = self._began if not self._speed else self._began + t / self._speed
        while (left := due - time.monotonic()) > 0:
            if ends is None:
                time.sleep(min(left, _LONGEST_SLEEP))
            elif ends.wait(min(left, _LONGEST_SLEEP)):
                return False
        return ends is None or not ends.is_set()


def replay(
    recording: Recording,
    into: Callable[[Chunk], object] | Link,
    section: Section,
    direction: str | None,
    ends: threading.Event | None,
) -> int:
    """See ``Recording.replay``."""
    take = into if callable(into) else _sending(recording, into)
    pace, count = Pace(section), 0
    for chunk in section.rounds(recording, direction):
        if not pace.wait(chunk.t, ends):
            break
        take(chunk)
        count += 1
    return count


def _sending(recording: Recording, link: Link) -> Callable[[Chunk], object]:
    """Return a function that sends an end's messages again, one by one: their sequence numbers are the link's own."""
    end = End(link.role)
    decoder = recording._decoder(end)
    own = recording.direction_of(end)

    def take(chunk: Chunk) -> None:
        if chunk.direction != own:
            return
        for message in decoder.idle(chunk.before) + decoder.feed(chunk.bytes, chunk.before):
            header = link.internals.frames.without_number(message.header)
            if message.name != "unknown":
                link.send(message.name, message.fields, header=header or None)

    return take
