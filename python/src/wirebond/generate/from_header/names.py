"""Converts C's names to a protocol file's, and finds the id and sender that a struct's name suggests."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Iterable

from wirebond.protocol import names
from wirebond.protocol.model import End

_NOISE = {"t", "s", "st", "struct", "msg", "message", "packet", "pkt", "frame", "id", "type", "data", "payload", "e"}
_ENDINGS = {"t", "s", "st"}  # of C's names for types
_FROM_HOST = {"cmd", "command", "set", "request", "req", "control", "ctrl", "setpoint", "target"}
_FROM_MCU = {
    "status", "state", "feedback", "report", "telemetry", "odometry", "odom", "imu", "sensor", "ack", "response",
    "reply", "battery", "encoder", "measurement",
}  # fmt: skip


def words_of(name: str) -> list[str]:
    """Split a name into words: ``ChassisCmd_t``, ``CHASSIS_CMD`` give chassis, cmd, t."""
    split = re.sub(r"([a-z0-9])([A-Z])", r"\1_\2", re.sub(r"([A-Z]+)([A-Z][a-z])", r"\1_\2", name))
    return [word for word in re.split(r"[^a-z0-9]+", split.lower()) if word]


class Names:
    """Gives names that a protocol file may have, each once. The cost of a name does not depend on how many were given.

    :param are_types: each name also becomes a type in C++, where two spellings may be one word: those are kept apart.
    """

    def __init__(self, *, are_types: bool = False) -> None:
        self._are_types = are_types
        self._taken: set[str] = set()
        self._next: dict[str, int] = {}  # for a word that was taken, the number to try first

    def take(self, name: str) -> str:
        """Return the word for a name of C, followed by a number if the word was given before."""
        words = words_of(name)
        while self._are_types and len(words) > 1 and words[-1] in _ENDINGS:
            words.pop()
        base = "_".join(words).strip("_") or "field"
        base = base if base[0].isalpha() else f"n{base}"
        base = base[: names.MAX_LENGTH - 8].rstrip("_")
        candidate = base
        while self._key(candidate) in self._taken:
            number = self._next.get(base, 2)
            self._next[base] = number + 1
            candidate = f"{base}_{number}"
        self._taken.add(self._key(candidate))
        return candidate

    def _key(self, word: str) -> str:
        return names.type_name(word) if self._are_types else word


def enumerator_words(values: Iterable[tuple[str, int]]) -> list[tuple[str, int]]:
    """Remove the words that all names begin with: ``MODE_IDLE``, ``MODE_RUN`` give idle, run."""
    pairs = list(values)
    split = [words_of(name) or ["value"] for name, _ in pairs]
    shared = 0
    while len(split) > 1 and all(len(words) > shared + 1 and words[shared] == split[0][shared] for words in split):
        shared += 1
    taken = Names()
    return [(taken.take("_".join(words[shared:])), value) for words, (_, value) in zip(split, pairs, strict=True)]


def ids_by_name(structs: Iterable[str], constants: Iterable[tuple[str, int]]) -> dict[str, tuple[str, int]]:
    """Find for each struct the one constant that is named after it: its name and value. Only ids that differ are
    taken."""
    by_key: dict[tuple[str, ...], list[tuple[str, int]]] = {}
    for name, value in constants:
        if 0 <= value <= 0xFF:
            by_key.setdefault(_key(name), []).append((name, value))
    found = {}
    for struct in structs:
        matches = by_key.get(_key(struct), [])
        if len(matches) == 1 and _key(struct):
            found[struct] = matches[0]
    uses = Counter(value for _, value in found.values())
    return {struct: match for struct, match in found.items() if uses[match[1]] == 1}


def _key(name: str) -> tuple[str, ...]:
    return tuple(word for word in words_of(name) if word not in _NOISE)


def sender_of(name: str) -> End | None:
    """Return the sender that the name suggests; None if it suggests none, or both."""
    words = set(words_of(name))
    from_host, from_mcu = bool(words & _FROM_HOST), bool(words & _FROM_MCU)
    if from_host == from_mcu:
        return None
    return End.HOST if from_host else End.MCU
