"""Decides whether a virtual MCU moves: it is at rest until the host commands motion, as a robot is."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from wirebond.protocol.given import is_emergency_stop
from wirebond.protocol.model import End, Protocol


class Motion:
    """Commands of motion are the messages with fields of the file's ``emergency_stop``. Without one, they are those
    with a deadline at the MCU. A protocol with neither commands no motion, and its virtual MCU always moves."""

    def __init__(self, model: Protocol) -> None:
        self._model = model
        self._commands = {stop.message for stop in model.emergency_stop if model.message(stop.message).fields} or {
            rule.message for rule in model.deadlines if rule.at == End.MCU
        }
        self._moving: set[str] = set()

    @property
    def is_at_rest(self) -> bool:
        """Is there a command of motion, and has none acted since the last stop?"""
        return bool(self._commands) and not self._moving

    def act(self, message: str, fields: Mapping[str, Any]) -> None:
        """Note that this message of the host acts now. Its safe values stop; any other value moves."""
        if not is_emergency_stop(self._model, message, fields):
            self._moving |= {message} & self._commands
        elif message in self._commands:
            self._moving.discard(message)
        else:  # a stop without values of its own stops whatever moves
            self._moving.clear()

    def stop(self, message: str) -> None:
        """Note that a deadline has struck because this message stayed away."""
        self._moving.discard(message)
