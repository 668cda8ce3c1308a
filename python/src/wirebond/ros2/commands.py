"""Commands from ROS to the MCU: examined, clamped or refused by the protocol's ranges, counted, sent."""

from __future__ import annotations

import math
import sys
import threading
from collections import Counter
from collections.abc import Callable, Iterable, Mapping
from itertools import repeat
from typing import TYPE_CHECKING, Any, TypeVar

from wirebond import _engine
from wirebond.errors import WirebondError
from wirebond.protocol.given import is_given
from wirebond.protocol.model import End, Field, OnRange
from wirebond.protocol.model.forms import header_fields
from wirebond.ros2.ros_words import RosWords
from wirebond.ros2.throttle import Log, Throttle

if TYPE_CHECKING:
    from wirebond.codec import Message
    from wirebond.link import Link
    from wirebond.ros2.mapping.unpacking import UnpackPlan

_Sent = TypeVar("_Sent")
_MOST = sys.float_info.max
_NUMBERS = {float, int, bool}
_MOST_READY = 256  # frames


class RefusedError(Exception):
    """A value that is not sent; the text says why. ``kind`` is what counts as the same reason."""

    def __init__(self, kind: str, why: str) -> None:
        super().__init__(why)
        self.kind = kind


class Commands:
    """The way to the link for everything that comes from ROS. Any thread.

    :ivar why_old: says why messages that come from ROS now may be old; empty: they are not.
    :ivar why_stopped: why what moves the robot is refused at the moment; empty: it is sent.
    """

    def __init__(
        self, link: Link, log: Log, words: RosWords | None = None, why_old: Callable[[], str] = lambda: ""
    ) -> None:
        self.why_stopped = ""
        self._words = words or RosWords(link, "", "")
        self.why_old = why_old
        self.counts: Counter[str] = Counter(sent=0, clamped=0, refused=0)
        self._link = link
        self._throttle = Throttle(log)
        model = link.codec.model
        self._names = [m.name for m in model.messages]
        self._fields = {m.name: {f.name: f for f in m.fields} for m in model.messages}
        self._bounds = {name: _bounds(fields.values()) for name, fields in self._fields.items()}
        self._safe = {stop.message: stop for stop in model.emergency_stop}
        self._addresses = {f.name for f in header_fields(model.format.parts) if f.address is not None}
        self._moved: dict[str, list[dict[str, Any]]] = {name: [] for name in self._safe}  # addresses, by message
        self._lock = threading.Lock()
        self._leaving = threading.Lock()  # whether a message is stopped is true until it has left
        self._ready: list[tuple[int, bytes]] = []  # frames that leave with the next flush

    def send(
        self,
        message: str,
        values: Mapping[str, Any],
        hold: float | None = None,
        header: Mapping[str, Any] | None = None,
    ) -> bool:
        """Send a message, or repeat it for ``hold`` seconds. False: it was refused, counted, and logged."""

        def leave(fitting: Mapping[str, Any]) -> None:
            if hold is None:
                self._link.send(message, fitting, header=header)
            else:
                self._link.repeat(message, fitting, hold=hold, header=header)

        try:
            self._pass(message, values, leave, header)
        except RefusedError:
            return False
        return True

    def tell(self, message: str, values: Mapping[str, Any], header: Mapping[str, Any] | None = None) -> None:
        """Send a message.

        :raises RefusedError: as ``send`` refuses, and counts, and logs.
        """
        self._pass(message, values, lambda fitting: self._link.send(message, fitting, header=header), header)

    def ask(self, message: str, values: Mapping[str, Any], timeout: float) -> Message:
        """Send a request, and wait for its reply.

        :param timeout: seconds.
        :raises RefusedError: as ``tell``; or no reply came in time, which is counted and logged, too.
        """
        wait = self._pass(message, values, lambda fitting: self._link.begin_request(message, fitting, timeout))
        try:
            return wait()
        except WirebondError as error:
            with self._lock:
                self.counts["unanswered"] += 1
            self._throttle.say("warning", f"no answer {message}", str(error))
            raise RefusedError("no answer", str(error)) from None

    def _pass(
        self,
        message: str,
        values: Mapping[str, Any],
        leave: Callable[[Mapping[str, Any]], _Sent],
        header: Mapping[str, Any] | None = None,
    ) -> _Sent:
        """Let values leave that fit, now that nothing stops them; what ``leave`` gave.

        :raises RefusedError: they do not; that was counted, and logged.
        """
        self.flush()
        try:
            fitting, clamped = self._fitting(message, values)
            with self._leaving:
                if why := self._why_not(message, fitting):
                    raise RefusedError(why, why)
                sent = leave(fitting)
                self._note_address(message, header or {})
        except (RefusedError, WirebondError, TypeError) as error:
            kind = getattr(error, "kind", type(error).__name__)
            why = self._words.why(error, message)
            self.refuse(message, why, kind)
            raise RefusedError(kind, why) from None
        with self._lock:
            self.counts["sent"] += 1
            self.counts["clamped"] += bool(clamped)
        if clamped:
            self._throttle.say("warning", f"clamp {message}", f"{message} was clamped: {', '.join(clamped)}")
        return sent

    def _why_not(self, message: str, values: Mapping[str, Any]) -> str:
        """Say why a message must not leave now; empty: it may. A stop is never too late."""
        stop = self._safe.get(message)
        if self.why_stopped and stop is not None:
            return self.why_stopped
        is_stop = stop is not None and is_given(self._link.codec.model, stop, message, values)
        return "" if is_stop else self.why_old()

    def _why_no_frame(self, index: int, frame: bytes) -> str:
        decoder = self._link.codec.decoder("host")
        fields = {n: v for message in (*decoder.feed(frame), *decoder.finish()) for n, v in message.fields.items()}
        return self._why_not(self._names[index], fields)

    def framer(self, plan: UnpackPlan) -> _engine.CdrCommand | None:
        """Return the engine's maker of frames from a topic's bytes, for ``send_frame``; None if each message must be
        examined: a reply is expected, frames have addresses, or a constant is out of its range."""
        if not self._link.internals.sender.sends_plain(plan.message):
            return None
        try:
            _, clamped = self._fitting(plan.message, plan.constants)
        except RefusedError:
            return None
        if clamped:
            return None
        codec = self._link.codec
        return _engine.CdrCommand.make(
            codec.tables.protocol, codec.tables.format_for(End.HOST), plan, self._bounds[plan.message]
        )

    def send_frames(self, index: int, frames: Iterable[bytes]) -> None:
        """Send frames of a framer, of the message with this index, with the next ``flush`` or ``send``."""
        with self._lock:
            self._ready.extend(zip(repeat(index), frames, strict=False))
        if len(self._ready) >= _MOST_READY:
            self.flush()

    def flush(self) -> None:
        """Send the frames that are ready, in their order. Each is sent or refused as by ``send``."""
        if not self._ready:
            return
        refused: list[tuple[int, Exception]] = []
        with self._leaving:
            with self._lock:
                frames, self._ready = self._ready, []
            if self.why_stopped or self.why_old():
                whys = [self._why_no_frame(*one) for one in frames]
                refused = [(index, RefusedError(why, why)) for (index, _), why in zip(frames, whys, strict=True) if why]
                frames = [one for one, why in zip(frames, whys, strict=True) if not why]
            answers = self._link.internals.sender.send_all(frames)
        with self._lock:
            self.counts["sent"] += answers.count(None)
        if len(answers) != answers.count(None):
            refused += [(index, e) for (index, _), e in zip(frames, answers, strict=True) if e is not None]
        for index, error in refused:
            name = self._names[index]
            self.refuse(name, self._words.why(error, name), getattr(error, "kind", type(error).__name__))

    def refuse(self, what: str, why: str, kind: str = "") -> None:
        """Count something that is not sent, and say why. ``kind``: what counts as the same reason."""
        with self._lock:
            self.counts["refused"] += 1
        self._throttle.say("warning", f"refuse {what} {kind}", f"{what} was not sent: {why}")

    def stop(self, why: str) -> None:
        """Send the safe values of the protocol's emergency stop once, to every address that was commanded, and refuse
        these messages until ``resume``."""
        with self._leaving:
            self.why_stopped = why
        for message, stop in self._safe.items():
            self._note_address(message, dict(stop.header))
            for address in list(self._moved[message]):
                try:
                    self._link.internals.sender.end_safely(message, address)
                except WirebondError as error:
                    self.refuse(message, self._words.why(error, message))

    def _note_address(self, message: str, header: Mapping[str, Any]) -> None:
        if message in self._safe:
            address = {name: value for name, value in header.items() if name in self._addresses}
            if address not in self._moved[message]:
                self._moved[message].append(address)

    def resume(self) -> None:
        """Send again what ``stop`` refuses."""
        self.why_stopped = ""

    def _fitting(self, message: str, values: Mapping[str, Any]) -> tuple[Mapping[str, Any], list[str]]:
        """Return the values within the file's ranges, and a phrase for each that was not.

        :raises RefusedError: a value is not finite, or out of a range that is not to be clamped to.
        """
        bounds = self._bounds[message]
        for name, value in values.items():
            if type(value) not in _NUMBERS or name not in bounds or not bounds[name][0] <= value <= bounds[name][1]:
                break
        else:
            return values, []
        fields, fitting, clamped = self._fields[message], dict(values), list[str]()
        for name, value in values.items():
            if name in fields:
                fitting[name] = _within(fields[name], value, name, clamped)
        return fitting, clamped


def _bounds(fields: Iterable[Field]) -> dict[str, tuple[float, float]]:
    """Return the finite values of each plain number. Most commands need no other check; the engine refuses what a type
    cannot hold."""
    return {
        f.name: (-_MOST if f.minimum is None else f.minimum, _MOST if f.maximum is None else f.maximum)
        for f in fields
        if (f.is_number or f.value_type is bool) and f.count is None and not f.is_list
    }


def _within(field: Field, value: Any, name: str, clamped: list[str]) -> Any:
    if isinstance(value, list | tuple):
        return [_within(field, one, name, clamped) for one in value]
    if isinstance(value, Mapping):
        inner = {f.name: f for f in field.fields}
        return {
            key: _within(inner[key], one, f"{name}.{key}", clamped) if key in inner else one
            for key, one in value.items()
        }
    if isinstance(value, bool) or not isinstance(value, int | float):
        return value
    if not math.isfinite(value):
        raise RefusedError("not finite", f"{name} is {value}, not a finite number")
    low = -math.inf if field.minimum is None else field.minimum
    high = math.inf if field.maximum is None else field.maximum
    if not low <= value <= high:
        unit = f" {field.unit}" if field.unit else ""
        if field.on_range == OnRange.REJECT:
            raise RefusedError("range", f"{name} = {value:g}{unit} is outside {low:g} ... {high:g}{unit}")
        bound = min(max(value, low), high)
        clamped.append(f"{name} = {value:g}{unit} to {bound:g}")
        return bound
    return value
