"""The MCU's counters from the counters service: numbers, and a sentence."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from wirebond.protocol.counters import COUNTERS, Counted
from wirebond.protocol.model import Message, Protocol


@dataclass(frozen=True)
class McuCounters:
    """The MCU's counters since it started. As ``str`` it is a sentence about refused bytes and messages.

    A counter wraps at the size of its field, or of 32 bits; differences of two messages stay right.

    :ivar values: each counter that the message carries, by its name.
    """

    values: dict[str, int]

    @property
    def refused_bytes(self) -> dict[str, int]:
        """Received bytes that the MCU threw away, by cause; causes that occurred."""
        return self._of(Counted.BYTES)

    @property
    def refused_messages(self) -> dict[str, int]:
        """Received messages that did not act, by the reason; reasons that occurred."""
        return self._of(Counted.MESSAGES)

    @property
    def unsent(self) -> dict[str, int]:
        """Frames that the MCU wanted to send and that did not leave, by the reason; reasons that occurred."""
        return self._of(Counted.UNSENT)

    def __str__(self) -> str:
        refused = [f"{n} byte{'s' * (n != 1)} as {cause}" for cause, n in self.refused_bytes.items()]
        refused += [f"{n} message{'s' * (n != 1)} as {reason}" for reason, n in self.refused_messages.items()]
        said = f"MCU refused {', '.join(refused) or 'nothing'}"
        if self.unsent:
            told = ", ".join(f"{n} {name.removeprefix('send_')}" for name, n in self.unsent.items())
            said += f"; of its own frames {told}"
        if errors := self.values.get("line_errors", 0):
            said += f"; {errors} line error{'s' * (errors != 1)}"
        return said

    def as_dict(self) -> dict[str, Any]:
        """Return it as a dictionary for JSON.

        :returns: ``refused_bytes``, ``refused_messages``, ``unsent`` and the sentence, ``text``.
        """
        names = ("refused_bytes", "refused_messages", "unsent")
        return {name: getattr(self, name) for name in names} | {"text": str(self)}

    def _of(self, kind: Counted) -> dict[str, int]:
        return {name: n for name, n in self.values.items() if n and COUNTERS[name][0] == kind}


def mcu_counters(protocol: Protocol, message: Message, values: Mapping[str, Any]) -> McuCounters | None:
    """Return the MCU's counters in ``message`` with these values, or None if it is not of that service."""
    service = protocol.service("counters")
    if service is None or service.message("message") != message.name:
        return None
    return McuCounters({name: values[name] for name in COUNTERS if name in values})
