"""Parameters of the MCU as parameters of the node: read when it answers, set with its acknowledgement, and kept up to
date when others set them."""

from __future__ import annotations

import threading
from collections.abc import Callable
from typing import TYPE_CHECKING

from wirebond.errors import LinkDownError, WirebondError
from wirebond.ros2.node import Node, Parameter

if TYPE_CHECKING:
    from wirebond.codec import Message
    from wirebond.link import Link

PREFIX = "mcu."
_AGAIN = 1.0  # seconds until an MCU that does not answer is asked again
_PATIENCE = 5.0  # seconds that the reading has to end


class McuParameters:
    """Reads them in a thread of its own, which an MCU that does not answer may keep waiting."""

    def __init__(
        self,
        link: Link,
        node: Node,
        say: Callable[[str, str, str], None],
        pass_on: Callable[[list[Message]], None],
    ) -> None:
        """``say``: a line of the log, of a level, about something. ``pass_on``: takes the MCU's answers, which
        ``receive`` does not give."""
        self._link = link
        self._node = node
        self._say = say
        self._pass_on = pass_on
        model = link.codec.model
        service = model.service("parameter")
        assert service is not None, "the bridge has looked"
        self._value = dict(service.messages)["value"]
        fields = {field.name: field for field in model.message(self._value).fields}
        self._names = {number: name for name, number in fields["index"].enum}
        self._field = fields["value"]
        self._known: dict[str, float] = {}
        self._lock = threading.Lock()
        self._closed = threading.Event()
        self._thread = node.failure.thread("parameters of the MCU", self._read)
        self._handler = node.failure.handler(self._take)

    def start(self) -> None:
        """Begin to ask."""
        self._link.on(self._value)(self._handler)
        self._thread.start()

    def close(self) -> None:
        """Stop asking."""
        self._link.off(self._handler)
        self._closed.set()
        if self._thread.is_alive():
            self._thread.join(_PATIENCE)

    def _take(self, message: Message) -> None:
        """Take an answer of the MCU, whoever asked: the parameter has this value now."""
        index = message.fields["index"]
        self._tell(str(self._names.get(index, index)), message.fields["value"])
        self._pass_on([message])

    def _read(self) -> None:
        """Ask until it answers, and again when the port or the server was away: then it may have restarted."""
        seen: int | None = None
        while not self._closed.is_set():
            reconnects = self._reconnects()
            if reconnects is None:
                seen = None
            elif reconnects != seen:
                try:
                    found = self._link.parameters.list()
                except WirebondError as error:
                    if not isinstance(error, LinkDownError):
                        self._say("warning", "parameters", f"the parameters of the MCU are not known yet: {error}")
                else:
                    seen = reconnects
                    for name, value in found.items():
                        self._declare(name, value)
            self._closed.wait(_AGAIN)

    def _reconnects(self) -> int | None:
        """Return how often the port came back; None: the server is away."""
        try:
            return self._link.stats.reconnects
        except LinkDownError:
            return None

    def _declare(self, name: str, value: float) -> None:
        with self._lock:
            is_new = name not in self._known
            self._known[name] = value
        if not is_new:
            self._node.update(PREFIX + name, value)
            return

        def change(new: float) -> None:
            in_force = self._link.parameters.set(name, new)
            with self._lock:
                self._known[name] = in_force

        try:
            self._node.declare(
                Parameter(
                    PREFIX + name,
                    value,
                    self._field.minimum,
                    self._field.maximum,
                    self._field.description or f"Parameter {name} of the MCU",
                    change,
                )
            )
        except WirebondError as error:
            self._say("error", f"parameter {name}", f"the MCU did not take the given value of {PREFIX}{name}: {error}")

    def _tell(self, name: str, value: float) -> None:
        rounded = self._field.shortest(value)
        with self._lock:
            if name not in self._known or self._known[name] == rounded:
                return
            self._known[name] = rounded
        self._node.update(PREFIX + name, rounded)
