"""The result of a check of ``wirebond doctor``: plain values."""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum


class Verdict(StrEnum):
    """Worst first."""

    PROBLEM = "problem"  # the port does not work, or not for this user
    WARNING = "warning"  # it works, and something may disturb it
    CANNOT_TELL = "cannot tell"  # the files that would say so may not be read
    OK = "ok"


@dataclass(frozen=True)
class Finding:
    """An answer. ``port`` is the device's path, or None if it is about the machine.

    ``cure`` are commands to copy, one after the other. ``then`` is what is still to be done by hand.
    """

    check: str
    verdict: Verdict
    sentence: str
    port: str | None = None
    cure: tuple[str, ...] = ()
    then: str | None = None


def udev_rule(file: str, rule: str) -> tuple[str, ...]:
    """Return the commands that add a rule of udev, and apply it to what is plugged in."""
    return (
        f"echo '{rule}' | sudo tee -a /etc/udev/rules.d/{file}",
        "sudo udevadm control --reload && sudo udevadm trigger",
    )
