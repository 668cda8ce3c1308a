"""The MCU's clock in the host's time, as it is known at one moment: values only, so that it can be kept and sent."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

LEAST_SLEW = 1.0  # seconds in which a better line is approached


class HostTime(NamedTuple):
    """A time of the MCU on the host's clock.

    :ivar t: seconds, on ``time.monotonic()``.
    :ivar error: seconds by which it is wrong at most.
    """

    t: float
    error: float


@dataclass(frozen=True)
class Sample:
    """The result of one exchange."""

    mcu: float  # seconds, in the middle between its two times; counted on when it wraps
    host: float  # in the middle of the possible range
    half: float  # the truth is at most this far from `host`


@dataclass(frozen=True)
class Segment:
    """The answer from `start` on: the line, and what is left of the way to it."""

    start: float  # of the MCU's clock
    mcu: float  # a point of the line
    host: float
    slope: float
    behind: float = 0.0  # distance of the line from the answer, at `start`
    slew: float = LEAST_SLEW  # seconds until the answer is on the line

    def line(self, mcu: float) -> float:
        """Return the line itself."""
        return self.host + (mcu - self.mcu) * self.slope

    def left(self, mcu: float) -> float:
        """Return the remaining offset."""
        return self.behind * min(max(1.0 - (mcu - self.start) / self.slew, 0.0), 1.0)

    def at(self, mcu: float) -> float:
        """Return the answer."""
        return self.line(mcu) - self.left(mcu)


@dataclass(frozen=True)
class ClockLine:
    """An MCU's clock. Any thread.

    :ivar modulus: microseconds after which the MCU's clock wraps.
    :ivar began: the host's time of the first exchange with this clock.
    :ivar last: the newest exchange.
    :ivar best: the exchanges that the line goes through.
    :ivar segments: of the answer, the newest last: what came to be known later does not change times before it.
    :ivar drift_error: by how much the line's slope is wrong at most.
    """

    modulus: int
    began: float
    last: Sample
    best: tuple[Sample, ...]
    segments: tuple[Segment, ...]
    drift_error: float

    def counted_on(self, raw: int, host: float, wrap_us: int = 1 << 64) -> int:
        """Return the count of microseconds that these bits mean, at about this time of the host: the nearest to what is
        expected. ``wrap_us``: after which they wrap, where that is sooner than the clock."""
        expected = round((self.last.mcu + (host - self.last.host) / self.segments[-1].slope) * 1e6)
        wrap = min(self.modulus, wrap_us)
        return expected + (raw - expected + wrap // 2) % wrap - wrap // 2

    def at(self, mcu: float) -> HostTime:
        """Return the host's time of these seconds of the MCU."""
        segment = next((s for s in reversed(self.segments) if s.start <= mcu), self.segments[0])
        t = segment.at(mcu)
        return HostTime(t, self.error(mcu) + abs(t - self.segments[-1].line(mcu)))

    def error(self, mcu: float) -> float:
        """Return the maximum error of the newest line at this time of the MCU."""
        line = self.segments[-1]
        return min(abs(s.host - line.line(s.mcu)) + s.half + self.drift_error * abs(mcu - s.mcu) for s in self.best)
