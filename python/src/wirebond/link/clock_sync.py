"""The MCU's clock in the host's time, from exchanges of the clock service. No thread, no port, no clock of its own.

An exchange has four times: the host sends the request, the MCU receives it, the MCU sends its reply, the host has it.
The time of the line and of both programs is the round trip. The MCU's times are between the host's two, so an
exchange gives the host's time of the MCU's clock to half its round trip, whatever happened on the way. How long the
bytes of request and reply take on the line is known, and is not part of that error: neither message is faster than its
bytes. So a reply that is longer than its request moves nothing. Exchanges with a short round trip are the best. A line
through the best ones of the last minute gives offset and drift.

The answer never jumps back: a better line is approached within a second or more. Only a restart of the MCU, which
begins its clock again, begins a new one.
"""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass
from enum import Enum

from wirebond.errors import UsageError
from wirebond.link.clock_line import LEAST_SLEW, ClockLine, HostTime, Sample, Segment

WINDOW = 64  # exchanges that the line goes through
LEAST_APART = 0.5  # seconds: of the exchanges in such a time only the best counts
LEAST_BITS = 24  # of the MCU's clock: a narrower one wraps within seconds
MOST_BITS = 32  # that are looked at: a firmware counts 32 bits, however wide the field is
MAX_DRIFT = 0.02  # of any MCU's clock, as long as it is not measured: a poor RC oscillator
LIKELY_DRIFT = 1e-3  # of most clocks: used while exchanges are too close together to show the drift
WANDER = 10e-6  # by how much a measured drift may change within the window
BAUD_ERROR = 0.05  # by which the other end may be faster than the line's rate: more, and it would not be understood
STAMP_ERROR = 50e-6  # seconds by which an MCU may stamp too early: it reads the time before it checks for bytes
_SEGMENTS = 64  # of the answer that are remembered, for stamps that come late


class Verdict(Enum):
    """The outcome of one exchange."""

    USED = "used"  #: it is one of the best
    OUTLIER = "outlier"  #: its round trip is too long, beside others; or it contradicts them
    RESTARTED = "restarted"  #: the MCU's clock began again, and everything with it
    NONSENSE = "nonsense"  #: the MCU had it for longer than the round trip took


@dataclass(frozen=True)
class ClockReading:
    """The state of the MCU's clock, as far as it is known.

    :ivar offset: seconds to add to the MCU's clock to get the host's time, at the last exchange. Wraps of the MCU's
        clock are counted.
    :ivar drift: parts per million by which the MCU's clock is fast; negative: slow.
    :ivar error: seconds by which the offset is wrong at most.
    :ivar round_trip: seconds: the shortest of the last minute.
    :ivar exchanges: answered exchanges.
    :ivar outliers: those of them that were not used.
    :ivar restarts: how often the MCU's clock began again.
    """

    offset: float
    drift: float
    error: float
    round_trip: float
    exchanges: int
    outliers: int
    restarts: int


class ClockSync:
    """An MCU's clock. One thread at a time.

    :param bits: after which the MCU's microseconds wrap.
    :raises UsageError: they wrap too soon.
    """

    def __init__(self, bits: int = 32) -> None:
        if bits < LEAST_BITS:
            raise UsageError(
                f"the MCU's clock has {bits} bits, so it wraps after {(1 << bits) / 1e6:.2g} s; clock sync needs at "
                f"least {LEAST_BITS}"
            )
        self._modulus = 1 << min(bits, MOST_BITS)
        self._samples: deque[Sample] = deque(maxlen=WINDOW)
        self._best: list[Sample] = []
        self._suspect: Sample | None = None
        self._segments: deque[Segment] = deque(maxlen=_SEGMENTS)
        self._newest = float("-inf")  # the latest time of the MCU that was asked for
        self._drift_error = MAX_DRIFT
        self._began = 0.0
        self._has_line = True  # nothing speaks against the times of bytes on the line
        self._line: ClockLine | None = None  # None: nothing is known, or it has changed
        self.exchanges = 0
        self.outliers = 0
        self.restarts = 0

    @property
    def line(self) -> ClockLine | None:
        """Return the current relation of the clocks, or None."""
        if self._line is None and self._segments:
            self._line = ClockLine(
                self._modulus,
                self._began,
                self._samples[-1],
                tuple(self._best),
                tuple(self._segments),
                self._drift_error,
            )
        return self._line

    def feed(
        self, sent: float, received_us: int, sent_us: int, back: float, to_mcu: float = 0.0, to_host: float = 0.0
    ) -> Verdict:
        """Judge one exchange.

        :param sent: when the host sent the request, in seconds.
        :param received_us: the MCU's clock when it had the request, as in the reply.
        :param sent_us: the MCU's clock when it sent the reply.
        :param back: when the host had the reply.
        :param to_mcu: what the bytes of the request take on the line, in seconds; 0: that is not known.
        :param to_host: the same of the reply.
        :returns: whether it was used, or why not.
        """
        self.exchanges += 1
        taken = (sent_us - received_us) % self._modulus * 1e-6
        fastest = (to_mcu + to_host) * (1 - BAUD_ERROR) - 2 * STAMP_ERROR
        if self._has_line and -2 * STAMP_ERROR <= back - sent - taken < fastest:
            self._has_line = False  # faster than bytes can be: the estimated line is wrong, and is discarded
            self._clear()
        if self._has_line:
            sent += to_mcu * (1 - BAUD_ERROR)
            back -= to_host * (1 - BAUD_ERROR)
        half = (back - sent - taken) / 2
        if half < -STAMP_ERROR:
            self.outliers += 1
            return Verdict.NONSENSE
        host = (sent + back) / 2
        line = self.line
        count = received_us % self._modulus if line is None else line.counted_on(received_us, host - taken / 2)
        sample = Sample(count * 1e-6 + taken / 2, host, max(half, 0.0) + STAMP_ERROR)
        if line is not None and self._contradicts(sample, line):
            return self._settle_suspect(sample)
        self._suspect = None
        return self._take(sample)

    def restart(self) -> None:
        """Note that the MCU restarted, so its clock began again."""
        if self._segments:
            self._forget()

    def to_host(self, mcu_us: int, near: float, wrap_us: int = 1 << MOST_BITS) -> HostTime:
        """Return the host's time of a time of the MCU. For later times of the MCU it gives later ones.

        :param mcu_us: microseconds of the MCU's clock, as in a message.
        :param near: a host's time that is at most half the wrap away, such as that of the message.
        :param wrap_us: after which they wrap, where that is sooner than the clock.
        :returns: the time, with its bound.
        :raises UsageError: no exchange was answered yet.
        """
        line = self.line
        if line is None:
            raise UsageError("the MCU's clock is not known yet; wait until `link.clock` has a reading")
        mcu = line.counted_on(mcu_us, near, wrap_us) * 1e-6
        self._newest = max(self._newest, mcu)
        return line.at(mcu)

    def reading(self) -> ClockReading | None:
        """Return the current state of the clock, or None."""
        line = self.line
        if line is None:
            return None
        segment, mcu = line.segments[-1], line.last.mcu
        return ClockReading(
            offset=segment.at(mcu) - mcu,
            drift=(1.0 / segment.slope - 1.0) * 1e6,
            error=line.error(mcu) + abs(segment.left(mcu)),
            round_trip=2 * (min(s.half for s in self._samples) - STAMP_ERROR),
            exchanges=self.exchanges,
            outliers=self.outliers,
            restarts=self.restarts,
        )

    # ---- the line

    @staticmethod
    def _contradicts(sample: Sample, line: ClockLine) -> bool:
        """Check whether this exchange cannot be true if the line is."""
        apart = abs(sample.host - line.segments[-1].line(sample.mcu))
        return apart > sample.half + line.error(sample.mcu)

    def _settle_suspect(self, sample: Sample) -> Verdict:
        """Decide on a contradiction: a single one is wrong; two that agree are right, and the clock began again."""
        before, self._suspect = self._suspect, sample
        self.outliers += 1
        if before is None:
            return Verdict.OUTLIER
        apart = abs((sample.host - before.host) - (sample.mcu - before.mcu))
        if apart > sample.half + before.half + MAX_DRIFT * abs(sample.host - before.host):
            return Verdict.OUTLIER
        self._forget()
        self._take(before)
        self._take(sample)
        return Verdict.RESTARTED

    def _forget(self) -> None:
        self.restarts += 1
        self._clear()

    def _clear(self) -> None:
        self._line = None
        self._samples.clear()
        self._segments.clear()
        self._best = []
        self._suspect = None
        self._newest = float("-inf")
        self._drift_error = MAX_DRIFT

    def _take(self, sample: Sample) -> Verdict:
        if self._samples and sample.mcu // LEAST_APART == self._samples[-1].mcu // LEAST_APART:
            if sample.half >= self._samples[-1].half:
                self.outliers += 1
                return Verdict.OUTLIER
            self._samples.pop()
        if not self._samples:
            self._began = sample.host - sample.half
        self._samples.append(sample)
        shortest = min(s.half for s in self._samples)
        self._best = [s for s in self._samples if s.half <= 1.5 * shortest]
        if len(self._best) < 3:
            self._best = sorted(sorted(self._samples, key=lambda s: s.half)[:3], key=lambda s: s.mcu)
        self._follow(*self._fit(), sample.mcu)
        if sample in self._best:
            return Verdict.USED
        self.outliers += 1
        return Verdict.OUTLIER

    def _fit(self) -> tuple[float, float, float]:
        """Return a point of the line through the best exchanges, and its slope."""
        weights = [1 / s.half**2 for s in self._best]
        total = sum(weights)
        mcu = sum(w * s.mcu for w, s in zip(weights, self._best, strict=True)) / total
        away = sum(w * (s.host - s.mcu) for w, s in zip(weights, self._best, strict=True)) / total
        spread = sum(w * (s.mcu - mcu) ** 2 for w, s in zip(weights, self._best, strict=True))
        slants = sum(w * (s.mcu - mcu) * (s.host - s.mcu - away) for w, s in zip(weights, self._best, strict=True))
        tilt = min(max(slants / (spread + LIKELY_DRIFT**-2), -MAX_DRIFT), MAX_DRIFT)
        self._drift_error = self._bound_drift(mcu, mcu + away, 1.0 + tilt)
        return mcu, mcu + away, 1.0 + tilt

    def _bound_drift(self, mcu: float, host: float, slope: float) -> float:
        """Return the maximum error of the slope, by the best exchange at each end of the window."""
        middle = (self._best[0].mcu + self._best[-1].mcu) / 2
        early = [s for s in self._best if s.mcu < middle]
        late = [s for s in self._best if s.mcu >= middle]
        if not early or not late:
            return MAX_DRIFT + abs(slope - 1.0)
        first, last = (min(part, key=lambda s: s.half) for part in (early, late))
        unsure = sum(s.half + abs(s.host - host - (s.mcu - mcu) * slope) for s in (first, last))
        return min(unsure / (last.mcu - first.mcu) + WANDER, MAX_DRIFT + abs(slope - 1.0))

    def _follow(self, mcu: float, host: float, slope: float, now: float) -> None:
        """Follow a better line: the answer continues from its present value, and approaches the line."""
        self._line = None
        if not self._segments:
            self._segments.append(Segment(now, mcu, host, slope))
            return
        start = max(now, self._newest)
        line = Segment(start, mcu, host, slope)
        behind = line.line(start) - self._segments[-1].at(start)
        slew = max(LEAST_SLEW, 2 * abs(behind))
        self._segments.append(Segment(start, mcu, host, slope, behind, slew))
