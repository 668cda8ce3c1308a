"""Computes the rates of a link from two states of its account: by message, losses, use of the line. No clock, no
port."""

from __future__ import annotations

from collections import deque
from dataclasses import asdict, dataclass
from typing import Any

from wirebond.link.accounts import LinkStats
from wirebond.link.ends import other
from wirebond.protocol.model import End, Protocol

DEFAULT_WINDOW = 2.0  # seconds
LONGEST_WINDOW = 60.0
_LOOKS = 200  # that are kept for the longest window


@dataclass(frozen=True)
class MessageRate:
    """The rate of one message.

    :ivar per_second: how many came, or left.
    :ivar due: how many should, by the message's ``every``; None: it has none.
    :ivar missing: the part of the due ones that did not, 0 to 1; None: it has no ``every``. In a window of few
        messages it is coarse: one of ten is a tenth.
    """

    per_second: float
    due: float | None
    missing: float | None


@dataclass(frozen=True)
class ReceiveRate:
    """The direction to the host.

    :ivar bytes_per_second: all bytes, those of noise, too.
    :ivar frames_per_second: delivered frames.
    :ivar discarded: the part of the bytes that was discarded, 0 to 1.
    :ivar missing: the part of the MCU's frames that did not arrive, by the gaps in their sequence numbers; None: frames
        have no numbers.
    :ivar line_use: of the line's time, with start, parity and stop bits; 1 is a full line.
    """

    bytes_per_second: float
    frames_per_second: float
    discarded: float
    missing: float | None
    line_use: float


@dataclass(frozen=True)
class SendRate:
    """The direction to the MCU.

    :ivar offered_per_second: frames that somebody wanted to send.
    :ivar frames_per_second: those that left.
    :ivar lost: of the offered load the part that will never leave: refused, expired, overruled or aborted. What a newer
        value replaced is not lost.
    :ivar bytes_per_second: handed to the port.
    :ivar line_use: as for ``ReceiveRate``.
    """

    offered_per_second: float
    frames_per_second: float
    lost: float
    bytes_per_second: float
    line_use: float


@dataclass(frozen=True)
class Rates:
    """The rates of a link over the last ``seconds``.

    :ivar messages: by message of the other end: those that came, and those that are due.
    :ivar sent: by message of the own end: those that left, and those that are due. One that the program does not repeat
        is missing as a whole.
    :ivar baud: and ``bits_per_byte``, start, data, parity and stop bits: what ``line_use`` counts by.
    """

    seconds: float
    receive: ReceiveRate
    send: SendRate
    messages: dict[str, MessageRate]
    sent: dict[str, MessageRate]
    baud: int
    bits_per_byte: float

    def as_dict(self) -> dict[str, Any]:
        """Return it as a dictionary for JSON.

        :returns: the attributes by name, those of parts as dicts.
        """
        return asdict(self)


def rates_between(
    protocol: Protocol, baud: int, earlier: LinkStats, later: LinkStats, seconds: float, peer: End = End.MCU
) -> Rates:
    """Return the rates between two states of a link's account, ``seconds`` apart. ``peer``: the end that it receives
    from."""
    seconds = max(seconds, 1e-6)
    bits = protocol.link.bits_per_byte
    before, now = earlier.receive, later.receive
    size = now.bytes - before.bytes
    discarded = sum(now.discarded_bytes.values()) - sum(before.discarded_bytes.values())
    receive = ReceiveRate(
        size / seconds,
        (now.frames - before.frames) / seconds,
        _part(discarded, size),
        _missing_by_number(earlier, later),
        size * bits / baud / seconds,
    )
    sent_bytes = later.send.sent_bytes - earlier.send.sent_bytes
    offered = later.send.offered - earlier.send.offered
    send = SendRate(
        offered / seconds,
        (later.send.sent - earlier.send.sent) / seconds,
        _part(_lost(later) - _lost(earlier), offered),
        sent_bytes / seconds,
        sent_bytes * bits / baud / seconds,
    )
    messages = _by_message(protocol, peer, before.messages, now.messages, seconds)
    sent = _by_message(protocol, other(peer), earlier.send.messages, later.send.messages, seconds)
    return Rates(seconds, receive, send, messages, sent, baud, bits)


def _by_message(
    protocol: Protocol, sender: End, before: dict[str, int], now: dict[str, int], seconds: float
) -> dict[str, MessageRate]:
    rates = {}
    for message in protocol.messages:
        count = now.get(message.name, 0) - before.get(message.name, 0)
        if message.sent_by(sender) and (count or message.every is not None):
            due = None if message.every is None else 1 / message.every
            # One more or less is at the window's edges.
            expected = None if due is None else max(0.0, seconds * due - 1)
            missing = None if expected is None else _part(max(0.0, expected - count), expected)
            rates[message.name] = MessageRate(count / seconds, due, missing)
    return rates


def _part(some: float, whole: float) -> float:
    return min(1.0, some / whole) if whole > 0 else 0.0


def _lost(stats: LinkStats) -> int:
    send = stats.send
    refused = send.refused_down + send.refused_full + send.refused_stopped
    return refused + send.expired + send.overruled + send.aborted


def _missing_by_number(earlier: LinkStats, later: LinkStats) -> float | None:
    before, now = earlier.receive.sequence, later.receive.sequence
    if now is None:
        return None
    gaps = now.gaps - (before.gaps if before else 0)
    came = now.numbered - now.repeats - (before.numbered - before.repeats if before else 0)
    return _part(gaps, came + gaps)


class RateMeter:
    """Looks at a link's account, kept for as long as a window may be. One thread at a time."""

    def __init__(self, protocol: Protocol, baud: int, first: LinkStats, t: float, peer: End = End.MCU) -> None:
        """``first``: the account when the link began, at ``t`` seconds. ``peer``: the end that it hears."""
        self._peer = peer
        self._protocol = protocol
        self._baud = baud
        self._looks: deque[tuple[float, LinkStats]] = deque([(t, first)])

    def rates(self, stats: LinkStats, t: float, window: float) -> Rates:
        """Return rates since the newest sample that is at least ``window`` seconds old; otherwise since the oldest one.

        :param stats: the account at ``t``.
        """
        earlier = next((look for look in reversed(self._looks) if t - look[0] >= window), self._looks[0])
        if t - self._looks[-1][0] >= LONGEST_WINDOW / _LOOKS:
            self._looks.append((t, stats))
        while len(self._looks) > 2 and t - self._looks[1][0] > LONGEST_WINDOW:
            self._looks.popleft()
        return rates_between(self._protocol, self._baud, earlier[1], stats, t - earlier[0], self._peer)
