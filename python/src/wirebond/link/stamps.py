"""Time stamps of the MCU in the host's time: which field of a message it is, and what the MCU's clock says of it."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable

from wirebond.codec import Codec, Message
from wirebond.link.clock_line import ClockLine, HostTime
from wirebond.link.clock_sync import ClockSync
from wirebond.protocol.stamps import count_us, stamp_of

MOST_AGE = 10.0  # seconds: an older stamp is not believed, for the MCU may have restarted
_FRESH = 0.5  # seconds that a server's knowledge of the clock is used

# Microseconds of the MCU, near this time of the host, and after how many microseconds they wrap.
ToHost = Callable[[int, float, int], HostTime | None]


class Stamper:
    """Gives messages of a protocol their stamps: what the engine calls. Any thread. It keeps no link.

    :param to_host: the MCU's clock, as far as it is known.
    """

    def __init__(self, codec: Codec, to_host: ToHost) -> None:
        self._to_host = to_host
        self._stamps = {m.name: stamp for m in codec.model.messages if (stamp := stamp_of(m)) is not None}

    def __call__(self, message: Message) -> tuple[float, float] | None:
        """Return the host's time of the message's stamp and the bound of its error; None: it has none, or nothing is
        known of the MCU's clock at that time, or it cannot be a time of that clock."""
        stamp = self._stamps.get(message.name)
        if stamp is None:
            return None
        step = count_us(stamp)
        found = self._to_host(stamp.wire_bits(message[stamp.name]) * step, message.t, step << stamp.width)
        if found is None or not found.t - found.error <= message.t <= found.t + MOST_AGE:
            return None
        return found.t, found.error + step * 1e-6


def has_stamps(codec: Codec) -> bool:
    """Check whether a message of this protocol has a time stamp."""
    return any(stamp_of(message) is not None for message in codec.model.messages)


def on_line(line: ClockLine | None, mcu_us: int, near: float, wrap_us: int) -> HostTime | None:
    """Return the time by this state of the clock. Times before its first exchange may belong to another clock."""
    if line is None or near < line.began:
        return None
    return line.at(line.counted_on(mcu_us, near, wrap_us) * 1e-6)


class LiveClock:
    """The clock that a link's exchanges follow.

    :param lock: who feeds `sync` holds it.
    """

    def __init__(self, sync: ClockSync, lock: threading.Lock) -> None:
        self._sync = sync
        self._lock = lock

    def __call__(self, mcu_us: int, near: float, wrap_us: int) -> HostTime | None:
        """See `ToHost`."""
        with self._lock:
            line = self._sync.line
            is_known = line is not None and near >= line.began
            return self._sync.to_host(mcu_us, near, wrap_us) if is_known else None


class ServersClock:
    """The clock as the server of a link knows it, asked from time to time.

    :param ask: what the server knows, and the seconds from its clock to this one.
    """

    def __init__(self, ask: Callable[[], tuple[ClockLine | None, float]]) -> None:
        self._ask = ask
        self._line: ClockLine | None = None
        self._shift = 0.0
        self._asked = float("-inf")

    def __call__(self, mcu_us: int, near: float, wrap_us: int) -> HostTime | None:
        """See `ToHost`."""
        now = time.monotonic()
        if now - self._asked > _FRESH:
            self._asked = now
            self._line, self._shift = self._ask()
        shift = self._shift
        found = on_line(self._line, mcu_us, near - shift, wrap_us)
        return None if found is None else HostTime(found.t + shift, found.error)
