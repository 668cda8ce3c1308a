"""A virtual MCU's behaviour as a user's script in Python.

The script has a function ``setup(mcu)``, which is called once with a :class:`Behaviour`::

    def setup(mcu):
        speed = {"linear": 0.0}

        @mcu.on("velocity")
        def velocity(message):
            speed["linear"] = message["linear"]

        @mcu.fill("odometry")
        def odometry(t):
            ticks = round(speed["linear"] * 100)
            return {"left_ticks": ticks, "right_ticks": ticks}

Times are seconds since the start. It runs in the virtual MCU's own loop: a function that waits holds everything up.
"""

from __future__ import annotations

import runpy
import traceback
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from wirebond.codec import Codec, Message
from wirebond.errors import UsageError, WirebondError
from wirebond.protocol.model import End

Values = Mapping[str, Any]
OnMessage = Callable[[Message], Values | None]
Fill = Callable[[float], Values | None]
Tick = Callable[[float], object]


@dataclass
class _Rhythm:
    seconds: float
    due: float
    tick: Tick


class Behaviour:
    """The additions of a script to a virtual MCU. Values that it does not give are made up as without it.

    :raises UsageError: the script cannot be run, or asks for a message that the protocol does not have. Also from the
        functions that the virtual MCU calls: the script's own error, with its file and line.
    """

    def __init__(self, codec: Codec, script: Path) -> None:
        self.codec = codec
        self._script = script
        self._on: dict[str, list[OnMessage]] = {}
        self._fill: dict[str, Fill] = {}
        self._rhythms: list[_Rhythm] = []
        self._sending: list[tuple[str, Values]] = []
        self._reports: list[str] = []
        self._recovered: list[str] = []
        try:
            script.open("rb").close()
        except OSError as error:
            raise UsageError(f"{script} cannot be read: {error.strerror}; name a Python file") from None
        found = self._call(runpy.run_path, str(script)).get("setup")
        if not callable(found):
            raise UsageError(f"{script}: expected a function setup(mcu); wirebond.sim.script has an example")
        self._call(found, self)

    # ---- for the script

    def on(self, name: str) -> Callable[[OnMessage], OnMessage]:
        """Return a decorator for a function that is called for each such message of the host. The function may return
        values of its reply."""
        self._verify(name, End.HOST)

        def keep(function: OnMessage) -> OnMessage:
            self._on.setdefault(name, []).append(function)
            return function

        return keep

    def fill(self, name: str) -> Callable[[Fill], Fill]:
        """Return a decorator for a function that is called with the time for each such message that is due by its
        ``every``; it returns values of it."""
        self._verify(name, End.MCU)
        if self.codec.model.message(name).every is None:
            raise UsageError(f"{name} has no `every`, so it is never due; send it with mcu.send, as from mcu.every")

        def keep(function: Fill) -> Fill:
            self._fill[name] = function
            return function

        return keep

    def every(self, seconds: float) -> Callable[[Tick], Tick]:
        """Return a decorator: call the function with the time every ``seconds``, for the first time after
        ``seconds``."""
        if not seconds > 0:
            raise UsageError(f"mcu.every({seconds}): expected seconds, more than 0")

        def keep(function: Tick) -> Tick:
            self._rhythms.append(_Rhythm(seconds, seconds, function))
            return function

        return keep

    def send(self, name: str, **values: Any) -> None:
        """Send one message of the MCU, now."""
        self._verify(name, End.MCU)
        self._sending.append((name, values))

    def report(self, text: str) -> None:
        """Print a line for the operator."""
        self._reports.append(text)

    def recover(self, action: str) -> None:
        """End a deadline of the MCU with ``recover: explicit``: its message acts again."""
        actions = sorted({d.then for d in self.codec.model.deadlines if d.at == End.MCU})
        if action not in actions:
            raise UsageError(f"the MCU has no deadline with `then: {action}`; it has {', '.join(actions) or 'none'}")
        self._recovered.append(action)

    # ---- for the virtual MCU

    def heard(self, message: Message) -> dict[str, Any]:
        """Return the values of its reply."""
        values: dict[str, Any] = {}
        for function in self._on.get(message.name, ()):
            values |= self._values(function, message)
        return values

    def filled(self, name: str, t: float) -> dict[str, Any]:
        function = self._fill.get(name)
        return {} if function is None else self._values(function, t)

    def tick(self, t: float) -> None:
        for rhythm in self._rhythms:
            if t < rhythm.due:
                continue
            rhythm.due = max(rhythm.due + rhythm.seconds, t)  # after a stall: no burst
            self._call(rhythm.tick, t)

    def take_messages(self) -> list[tuple[str, Values]]:
        taken, self._sending = self._sending, []
        return taken

    def take_reports(self) -> list[str]:
        taken, self._reports = self._reports, []
        return taken

    def take_recovered(self) -> list[str]:
        taken, self._recovered = self._recovered, []
        return taken

    def mistake(self, error: WirebondError) -> UsageError:
        """Make an error of values that no frame can have: the function that gave them is no longer known."""
        return UsageError(f"{self._script}: {error}")

    def _values(self, function: Callable[..., Any], argument: object) -> dict[str, Any]:
        found = self._call(function, argument)
        if found is None:
            return {}
        if not isinstance(found, Mapping):
            code = getattr(function, "__code__", None)
            where = f"{self._script}:{code.co_firstlineno}" if code is not None else str(self._script)
            raise UsageError(f"{where}: the function gave {found!r}; expected a dict of values by field, or nothing")
        return dict(found)

    def _verify(self, name: str, end: End) -> None:
        names = [m.name for m in self.codec.model.messages if m.sent_by(end)]
        if name not in names:
            sender = "MCU" if end == End.MCU else "host"
            raise UsageError(f"the {sender} sends no message {name!r}; it sends {', '.join(names) or 'none'}")

    def _call(self, function: Callable[..., Any], *arguments: Any) -> Any:
        try:
            return function(*arguments)
        except (Exception, SystemExit) as error:  # the command ends by itself: a script that ends it is a mistake
            lines = [f.lineno for f in traceback.extract_tb(error.__traceback__) if f.filename == str(self._script)]
            if isinstance(error, SyntaxError) and error.filename == str(self._script):
                lines.append(error.lineno)
            where = f"{self._script}:{lines[-1]}" if lines else str(self._script)
            what = str(error) if isinstance(error, WirebondError) else f"{type(error).__name__}: {error}"
            raise UsageError(f"{where}: {what}") from None
