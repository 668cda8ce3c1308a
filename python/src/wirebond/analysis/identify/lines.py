"""The settings of a line that are tried on a port, and which of them was right. What listens is given: no port here."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass

from wirebond.analysis.identify.formats import Format
from wirebond.analysis.identify.ranking import Candidate, rank
from wirebond.protocol.model import LinkSettings, Parity

#: The usual rates, the commonest first.
USUAL = (
    115200, 9600, 57600, 1000000, 921600, 460800, 230400, 38400, 19200, 500000, 2000000, 100000, 250000, 420000, 4800,
    3000000, 1500000, 2400,
)  # fmt: skip
_PARITIES = {Parity.NONE: "N", Parity.EVEN: "E", Parity.ODD: "O"}
_SURE, _SURE_SHARE = 100.0, 0.5  # bits of evidence, and part of the bytes in frames, that end the search
_FIRST_LOOK = 256  # bytes


@dataclass(frozen=True)
class Line:
    """The settings of a UART."""

    baud: int
    parity: Parity = Parity.NONE
    stop_bits: int = 1

    def __str__(self) -> str:
        return f"{self.baud} baud 8{_PARITIES[self.parity]}{self.stop_bits}"

    def settings(self) -> LinkSettings:
        return LinkSettings(baud=self.baud, parity=self.parity, stop_bits=self.stop_bits)


@dataclass(frozen=True)
class Heard:
    """The result of one setting; ``candidates``: best first."""

    line: Line
    data: bytes
    candidates: list[Candidate]

    @property
    def size(self) -> int:
        """Bytes that came."""
        return len(self.data)

    @property
    def evidence(self) -> float:
        return self.candidates[0].evidence if self.candidates else float("-inf")

    @property
    def is_sure(self) -> bool:
        best = self.candidates[0] if self.candidates else None
        return best is not None and best.evidence >= _SURE and best.frame_share >= _SURE_SHARE


def lines_for(formats: Sequence[Format]) -> list[Line]:
    """Return the usual rates without parity, and after the first of them the settings of the formats themselves."""
    usual = [Line(baud) for baud in USUAL]
    told = [
        Line(each.model.link.baud, each.model.link.parity, round(each.model.link.stop_bits))
        for each in formats
        if each.model.link.data_bits == 8
    ]
    return list(dict.fromkeys([*usual[:4], *told, *usual[4:]]))


#: Listens with these settings; yields all the bytes that came so far, again and again, until its time is over.
Listen = Callable[[Line], Iterator[bytes]]


def search(lines: Sequence[Line], listen: Listen, formats: Sequence[Format]) -> Iterator[Heard]:
    """Yield the result of each setting, until one leaves no doubt."""
    for line in lines:
        looked = 0
        data = b""
        heard = Heard(line, b"", [])
        for data in listen(line):
            if len(data) >= max(_FIRST_LOOK, 2 * looked):
                looked = len(data)
                heard = Heard(line, data, rank(data, formats, len(lines)))
                if heard.is_sure:
                    break
        if len(data) > looked:
            heard = Heard(line, data, rank(data, formats, len(lines)))
        yield heard
        if heard.is_sure:
            return


def best_of(heard: Sequence[Heard]) -> Heard:
    """Return the setting with the most evidence; where nothing fits, the one that gave the most bytes."""
    fitting = [one for one in heard if one.candidates and one.candidates[0].fits]
    if fitting:
        return max(fitting, key=lambda one: one.evidence)
    return max(heard, key=lambda one: one.size)
