"""From C's names to a protocol file's, and what a struct's name says about its id and sender."""

from __future__ import annotations

import re
from collections.abc import Iterable

from wirebond.protocol import names
from wirebond.protocol.model import End

_NOISE = {"t", "s", "st", "struct", "msg", "message", "packet", "pkt", "frame", "id", "type", "data", "payload", "e"}
_FROM_HOST = {"cmd", "command", "set", "request", "req", "control", "ctrl", "setpoint", "target"}
_FROM_MCU = {
    "status", "state", "feedback", "report", "telemetry", "odometry", "odom", "imu", "sensor", "ack", "response",
    "reply", "battery", "encoder", "measurement",
}  # fmt: skip


def words_of(name: str) -> list[str]:
    """``ChassisCmd_t``, ``CHASSIS_CMD``: chassis, cmd, t."""
    split = re.sub(r"([a-z0-9])([A-Z])", r"\1_\2", re.sub(r"([A-Z]+)([A-Z][a-z])", r"\1_\2", name))
    return [word for word in re.split(r"[^a-z0-9]+", split.lower()) if word]


def protocol_word(name: str, taken: Iterable[str], *, drop: frozenset[str] = frozenset()) -> str:
    """A name that a protocol file may have, and that is not taken."""
    words = words_of(name)
    while len(words) > 1 and words[-1] in drop:
        words.pop()
    base = "_".join(words).strip("_") or "field"
    base = base if base[0].isalpha() else f"n{base}"
    base = base[: names.MAX_LENGTH - 8].rstrip("_")
    return _free(base, set(taken))


def message_word(name: str, taken: Iterable[str]) -> str:
    """As `protocol_word`; two names that become one type in C++ are kept apart, too."""
    types = {names.type_name(other) for other in taken}
    word = protocol_word(name, taken, drop=frozenset({"t", "s", "st"}))
    number = 2
    candidate = word
    while names.type_name(candidate) in types:
        candidate = f"{word}_{number}"
        number += 1
    return candidate


def _free(base: str, taken: set[str]) -> str:
    number = 2
    candidate = base
    while candidate in taken:
        candidate = f"{base}_{number}"
        number += 1
    return candidate


def enumerator_words(values: Iterable[tuple[str, int]]) -> list[tuple[str, int]]:
    """Names without the words that all of them begin with: ``MODE_IDLE``, ``MODE_RUN`` give idle, run."""
    pairs = list(values)
    split = [words_of(name) or ["value"] for name, _ in pairs]
    shared = 0
    while len(split) > 1 and all(len(words) > shared + 1 and words[shared] == split[0][shared] for words in split):
        shared += 1
    taken: list[str] = []
    for words in split:
        taken.append(protocol_word("_".join(words[shared:]), taken))
    return [(word, value) for word, (_, value) in zip(taken, pairs, strict=True)]


def ids_by_name(structs: Iterable[str], constants: Iterable[tuple[str, int]]) -> dict[str, tuple[str, int]]:
    """For each struct the one constant that is named after it: its name and value. Only ids that differ are taken."""
    by_key: dict[tuple[str, ...], list[tuple[str, int]]] = {}
    for name, value in constants:
        if 0 <= value <= 0xFF:
            by_key.setdefault(_key(name), []).append((name, value))
    found = {}
    for struct in structs:
        matches = by_key.get(_key(struct), [])
        if len(matches) == 1 and _key(struct):
            found[struct] = matches[0]
    values = [value for _, value in found.values()]
    return {struct: match for struct, match in found.items() if values.count(match[1]) == 1}


def _key(name: str) -> tuple[str, ...]:
    return tuple(word for word in words_of(name) if word not in _NOISE)


def sender_of(name: str) -> End | None:
    """What the name suggests; None where it suggests nothing, or both."""
    words = set(words_of(name))
    from_host, from_mcu = bool(words & _FROM_HOST), bool(words & _FROM_MCU)
    if from_host == from_mcu:
        return None
    return End.HOST if from_host else End.MCU
