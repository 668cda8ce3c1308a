"""The marks on a line of time apart from events: discarded bytes, deadlines of the MCU that struck."""

from __future__ import annotations

from collections import deque
from typing import Any

MOST_KEPT = 20_000
_TOGETHER = 0.25  # seconds: discards that are so close are one mark


class Marks:
    """One thread adds; others read.

    :param most: that are kept, the newest; None: all.
    """

    def __init__(self, most: int | None = MOST_KEPT) -> None:
        self._marks: deque[tuple[int, dict[str, Any]]] = deque(maxlen=most)
        self._last: dict[str, tuple[float, int]] = {}  # of each direction: time and bytes of its last discard
        self.newest = 0  # the number of the newest one

    def struck(self, t: float, action: str, message: str) -> None:
        """Note that a deadline at the MCU has struck, as far as the sent messages show."""
        self._add({"t": t, "kind": "mcu_deadline_struck", "action": action, "message": message})

    def discarded(self, t: float, direction: str, size: int) -> None:
        """Mark discarded bytes. Those close to the last ones of their direction are reported with them: the new mark
        has the same time and replaces theirs."""
        begun, before = self._last.get(direction, (t, 0))
        if t - begun >= _TOGETHER:
            begun, before = t, 0
        self._last[direction] = begun, before + size
        mark = {"t": begun, "kind": "discarded", "direction": direction, "bytes": before + size}
        if before and self._marks and _is_same(self._marks[-1][1], mark):
            self._marks.pop()
        self._add(mark)

    def _add(self, mark: dict[str, Any]) -> None:
        self.newest += 1
        self._marks.append((self.newest, mark))

    def since(self, number: int) -> list[dict[str, Any]]:
        """Return those with a higher number. Of two discards of one time and direction the later one holds."""
        return [mark for n, mark in list(self._marks) if n > number]


def _is_same(one: dict[str, Any], other: dict[str, Any]) -> bool:
    return all(one.get(key) == other[key] for key in ("t", "kind", "direction"))
