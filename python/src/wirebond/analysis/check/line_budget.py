"""Computes how much of the line the schedule uses in each direction, including start, parity and stop bits."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from wirebond.analysis.check.findings import Finding, Severity
from wirebond.analysis.check.fixed_end import is_fixed
from wirebond.analysis.check.frame_facts import ENDS, wire_bytes
from wirebond.analysis.check.places import Places
from wirebond.analysis.check.wording import count, direction, percent, rate
from wirebond.errors import UsageError
from wirebond.protocol.model import End, LinkSettings, Message, Parity, Protocol
from wirebond.protocol.problems import no_message

RULE = "line-budget"
_FULL = 1.0
_CROWDED = 0.7


@dataclass(frozen=True)
class Load:
    """Frames of one kind on the line: ``frames`` a second of ``bytes`` each, at most."""

    name: str
    sender: End
    bytes: int
    frames: float

    @property
    def byte_rate(self) -> float:
        return self.bytes * self.frames


@dataclass(frozen=True)
class Budget:
    """A direction. ``capacity`` in bytes a second."""

    sender: End
    capacity: float
    loads: tuple[Load, ...]
    longest_frame: int

    @property
    def share(self) -> float:
        """The share of the line. Above 1: more than the line can carry."""
        return sum(load.byte_rate for load in self.loads) / self.capacity

    @property
    def busiest(self) -> Load | None:
        return max(self.loads, key=lambda load: load.byte_rate, default=None)

    def greatest_rate(self, load: Load) -> float:
        """Return how many frames of this kind per second fit beside the other loads."""
        others = sum(other.byte_rate for other in self.loads if other is not load)
        return max(0.0, self.capacity - others) / load.bytes

    def as_dict(self) -> dict[str, Any]:
        return {
            "capacity_bytes_per_second": self.capacity,
            "share": self.share,
            "loads": [
                {
                    "name": load.name,
                    "frames_per_second": load.frames,
                    "frame_bytes": load.bytes,
                    "share": load.byte_rate / self.capacity,
                    "greatest_frames_per_second": self.greatest_rate(load),
                }
                for load in self.loads
            ],
        }


def byte_rate(link: LinkSettings) -> float:
    """Return the bytes per second on the line."""
    return link.baud / link.bits_per_byte


def _longest(protocol: Protocol, sender: End, message: Message) -> int:
    """Return the bytes of line of the message's longest frame."""
    return wire_bytes(protocol, sender, message.max_payload)


def scheduled_loads(protocol: Protocol) -> list[Load]:
    """Return the load of the file's `every` on the line. The reply to a scheduled request is as frequent as the
    request."""
    rates: dict[tuple[End, str], float] = {}
    for message in protocol.messages:
        if message.every is None:
            continue
        for end in ENDS:
            if message.sent_by(end):
                key = (end, message.name)
                rates[key] = rates.get(key, 0) + 1 / message.every
                if message.reply is not None:
                    answer = (End.MCU if end == End.HOST else End.HOST, message.reply)
                    rates[answer] = rates.get(answer, 0) + 1 / message.every
    return [
        Load(name, end, _longest(protocol, end, protocol.message(name)), frames)
        for (end, name), frames in rates.items()
    ]


def parse_traffic(protocol: Protocol, text: str) -> list[Load]:
    """Return a claimed load: `gimbal_cmd=2000,chassis_cmd=2000` in frames a second, or `mcu:47=3992` for 47-byte
    frames.

    :raises UsageError: with a sentence, for anything else.
    """
    loads = []
    for entry in text.split(","):
        what, equals, number = (piece.strip() for piece in entry.partition("="))
        try:
            frames = float(number)
        except ValueError:
            frames = 0.0
        if not equals or not 0 < frames < 1e9:
            raise UsageError(
                f"--traffic '{entry.strip()}' is not a load; write message=frames per second, such as "
                f"{protocol.messages[0].name}=100, or sender:bytes=frames per second, such as mcu:47=100"
            )
        loads += _claimed(protocol, what, frames)
    return loads


def _claimed(protocol: Protocol, what: str, frames: float) -> list[Load]:
    sender, colon, size = what.partition(":")
    if colon:
        if sender not in ENDS or not size.isdecimal() or len(size) > 5 or not 0 < int(size) <= 0xFFFF:
            raise UsageError(
                f"--traffic '{what}' names no frames; write host:47 or mcu:47 for frames of 47 bytes on the wire"
            )
        return [Load(f"{size}-byte frames", End(sender), int(size), frames)]
    try:
        message = protocol.message(what)
    except KeyError:
        names = [message.name for message in protocol.messages]
        raise UsageError(f"--traffic: {no_message(protocol.name, what, names)}") from None
    return [Load(what, end, _longest(protocol, end, message), frames) for end in ENDS if message.sent_by(end)]


def budgets(protocol: Protocol, loads: list[Load]) -> list[Budget]:
    """Return a budget for each direction in which something is sent at all."""
    found = []
    for end in ENDS:
        sizes = [_longest(protocol, end, message) for message in protocol.messages if message.sent_by(end)]
        own = tuple(load for load in loads if load.sender == end)
        if sizes or own:
            found.append(Budget(end, byte_rate(protocol.link), own, max(sizes, default=0)))
    return found


def assess(protocol: Protocol, directions: list[Budget], places: Places) -> list[Finding]:
    found = []
    link = protocol.link
    for budget in directions:
        busiest = budget.busiest
        if busiest is None or budget.share <= _CROWDED:
            continue
        over = budget.share > _FULL
        place = places.at("messages", busiest.name, "every")
        needs = sum(load.byte_rate for load in budget.loads)
        fits = budget.greatest_rate(busiest)
        beside = " beside the rest" if len(budget.loads) > 1 else ""
        # All loads less by the same factor, where no rate of the busiest alone would do.
        greatest = (
            f"at most {rate(fits)} of {busiest.name} fit{beside}"
            if fits > 0 and len(budget.loads) <= 2
            else f"all rates together fit at {percent(_FULL / budget.share)} of what they are"
            if over
            else f"{busiest.name} may rise to {rate(fits)}{beside}"
        )
        found.append(
            Finding(
                RULE,
                Severity.ERROR if over else Severity.WARNING,
                f"{direction(budget.sender)} takes {percent(budget.share)} of the line: {count(needs)} of "
                f"{count(budget.capacity)} bytes/s; {greatest}",
                f"at {count(link.baud)} baud a byte takes {link.bits_per_byte:g} bits with start"
                f"{', parity' if link.parity != Parity.NONE else ''} and stop, so "
                + (
                    "frames queue up without end, or are lost"
                    if over
                    else "a burst, a reply or a gap between two transfers leaves no room to catch up"
                ),
                _remedy(
                    is_fixed(protocol, budget.sender),
                    protocol.fixed is not None,
                    _next_baud(needs / _CROWDED * link.bits_per_byte),
                ),
                place.line,
                place.column,
            )
        )
    return found


def _remedy(sender_is_fixed: bool, frames_are: bool, baud: float) -> str:
    if sender_is_fixed:
        return f"set the device to {count(baud)} baud or more, or to send less often, if its manual has such settings"
    if frames_are:
        return f"send less often; or set the device to {count(baud)} baud or more, if its manual has such a setting"
    return f"raise the baud rate to {count(baud)} or more, send less often, or shorten the frames"


_USUAL_BAUD_RATES = (9600, 19200, 38400, 57600, 115200, 230400, 460800, 921600, 1_000_000, 2_000_000, 3_000_000)


def _next_baud(needed: float) -> float:
    """Return the least usual rate that is enough; beyond them, whole millions."""
    return next((usual for usual in _USUAL_BAUD_RATES if usual >= needed), -(-needed // 1_000_000) * 1_000_000)
