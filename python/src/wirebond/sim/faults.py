"""The rates of faults on a simulated wire, as the C++ programs take them."""

from __future__ import annotations

from dataclasses import dataclass

from wirebond.errors import UsageError

_CERTAIN = 10**12  # the programs' chances are whole numbers: this many is always
_MOST = 0.1


@dataclass(frozen=True, kw_only=True)
class LineFaults:
    """Chances: ``ber`` of each bit, the others of each byte. The same seed gives the same faults on every machine."""

    ber: float = 0.0
    bursts: float = 0.0  # 16 bytes become any bytes
    drops: float = 0.0
    inserts: float = 0.0
    splits: float = 0.0  # the line pauses for 2 ms
    seed: int = 1

    def verify(self) -> None:
        """Validate the chances.

        :raises UsageError: a chance is out of range.
        """
        for name in ("ber", "bursts", "drops", "inserts", "splits"):
            chance = getattr(self, name)
            if not 0 <= chance <= _MOST:
                raise UsageError(f"--{name} {chance:g}: expected a probability from 0 to {_MOST:g}, such as 1e-5")

    def fault_arguments(self) -> list[str]:
        chances = {
            "bit_errors": self.ber,
            "bursts": self.bursts,
            "drops": self.drops,
            "inserts": self.inserts,
            "splits": self.splits,
        }
        return [f"seed={self.seed}", *(f"{name}={round(chance * _CERTAIN)}" for name, chance in chances.items())]


def verify_baud(baud: int) -> None:
    """Validate the rate of a simulated line.

    :raises UsageError: a simulated line has no such rate.
    """
    if not 300 <= baud <= 100_000_000:
        raise UsageError(f"--baud {baud}: expected 300 to 100000000")
