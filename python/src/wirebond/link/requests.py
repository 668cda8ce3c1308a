"""Finds the request that a reply answers: by its message, its address, the fields that it repeats, and the order.

No thread, no port: the sender notes each request, and the receiver asks which request a message answers.
"""

from __future__ import annotations

import threading
import time
from collections import deque
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from operator import attrgetter
from typing import Any

from wirebond.arguments import real
from wirebond.codec import Codec, Message
from wirebond.errors import RequestTimeoutError, UsageError
from wirebond.link.arrivals import Arrivals
from wirebond.link.ends import Receiver, other
from wirebond.protocol.model import End
from wirebond.protocol.planning import plan_for, told_by_request
from wirebond.protocol.replies import carried_back, identifying

_NAME = attrgetter("name")
DEFAULT_TIMEOUT = 1.0  # seconds
MAX_TIMEOUT = 3600.0  # seconds: a longer wait is a mistake
_OWN_SEND = 1.0  # seconds that the reply to a message of plain `send` may take
_LATE = 10.0  # seconds after which no reply to an old request is expected any more
_MOST = 1024  # questions of one reply that are remembered
_SLACK = 0.05  # seconds: a message that was read longer than this before its request left is not a reply to it

Outcome = Message | Exception


@dataclass(eq=False)
class Question:
    """One frame that asks for a reply.

    ``finish`` is called once, by any thread, with the reply or what went wrong. None: no caller waits, because the
    frame went out by plain ``send``, or its request was given up.
    """

    message: str
    reply: str
    address: int | None  # of whom it asks; None: of anybody
    frame: bytes
    finish: Callable[[Outcome], None] | None
    leave: Callable[[], object] = lambda: None  # sends it; raises where it is refused
    since: float = 0.0  # time.monotonic()
    until: float = 0.0  # no reply is expected later than this
    is_over: bool = False  # its request was given up: it may only take a reply that is certainly its own
    number: int = 0  # of an attached link: of the call that asked
    carried: Mapping[str, Any] | None = None  # fields that the reply carries back; None: not looked at yet
    others: Mapping[str, Any] | None = None  # fields of the last reply that answered another request
    before: Mapping[str, Any] | None = None  # the receive account when it was sent, where a caller waits
    arrived: Arrivals | None = None  # since then, of a request that was withdrawn without its reply


class RequestBook:
    """The requests that are not answered yet. Any thread.

    :param codec: the protocol.
    :param end: the one that asks.
    :param account: gives the receive account, for sentences about requests without a reply.
    """

    def __init__(
        self, codec: Codec, end: End = End.HOST, account: Callable[[], Mapping[str, Any]] | None = None
    ) -> None:
        self._codec = codec
        self._account = account
        self._end = end
        self._receiver = Receiver(codec, end)
        self._lock = threading.RLock()  # a garbage collection within may send
        self._asked: dict[str, deque[Question]] = {}  # by reply, in the order of the line
        # If only the request identifies a reply, the next request waits until the one before has ended.
        self._one_at_a_time = bool(told_by_request(codec.model.messages, other(end)))
        self._waiting: deque[Question] = deque()
        # The last message, whose it is, and who waited for it then.
        self._looked_for: tuple[Message, Question | None, Callable[[Outcome], None] | None] | None = None
        plan = plan_for(codec.model, other(end))
        self._peer = None if plan.peer is None else plan.header[plan.peer]
        self._shared: dict[str, list[str]] = {}
        self._identifying: dict[str, list[str]] = {}

    def question(
        self, message: str, frame: bytes, header: Mapping[str, Any], finish: Callable[[Outcome], None] | None
    ) -> Question:
        """Return the question in this frame.

        :raises UsageError: the message has no reply.
        """
        reply = self._codec.tables.reply_to(message)
        address = None
        if self._peer is not None:
            asked = self._receiver.bits_of(header)
            address = None if asked in self._codec.tables.broadcasts else asked
        return Question(message, reply, address, frame, finish)

    def submit(self, question: Question) -> None:
        """Send it, now or when its turn comes; what refuses it at once is raised."""
        with self._lock:
            if self._one_at_a_time and question.finish is not None and self._is_busy():
                self._waiting.append(question)
                return
            self._leave(question)

    def withdraw(self, question: Question) -> None:
        """End the request without a reply; a reply that still comes belongs to no request. The next one leaves."""
        with self._lock:
            if question.finish is not None:
                question.arrived = self.arrived(question)
            question.finish = None
            question.is_over = True
            question.until = time.monotonic() + _LATE
            if question in self._waiting:
                self._waiting.remove(question)
            asked = self._asked.get(question.reply, ())
            if question in asked and not self._carried_names(question):  # a late reply could be any
                self._asked[question.reply].remove(question)
            self._next()

    def arrived(self, question: Question) -> Arrivals | None:
        """Return what arrived since the request was sent, or None if it was not sent."""
        if question.before is None or self._account is None:
            return None
        return Arrivals.between(question.before, self._account())

    def settle(self) -> None:
        """Return when no request is just leaving in another thread."""
        with self._lock:
            return

    def may_take(self, messages: Sequence[Message]) -> bool:
        """Return False if ``take`` refuses each of these, which came before now."""
        is_looked_for = self._looked_for is not None and self._looked_for[0] is messages[0]
        return is_looked_for or any(map(self._asked.get, set(map(_NAME, messages))))

    def take(self, message: Message) -> bool:
        """Give a received message to the request that it answers. False: no request waits for it."""
        is_new = self._looked_for is None or self._looked_for[0] is not message
        if is_new and not self._asked.get(message.name):
            return False
        with self._lock:
            if self._looked_for is None or is_new:
                question = self._answered_by(message)
                self._looked_for = (message, question, None if question is None else question.finish)
            _, question, finish = self._looked_for  # a signal's handler may have raised after the first check
            if question is None:
                return False
            if question in self._asked[message.name]:
                self._asked[message.name].remove(question)
            if finish is None or question.is_over:
                return False
            if question.finish is not None:
                finish(message)
                question.finish = None
            self._next()
            return True

    def end(self, error: Callable[[str], Exception]) -> None:
        """End every request with its error: no message will come any more.

        :param error: makes it, of the message that was sent.
        """
        with self._lock:
            questions = [*self._waiting, *(q for asked in self._asked.values() for q in asked)]
            self._waiting.clear()
            self._asked.clear()
            for question in questions:
                if question.finish is not None:
                    question.finish(error(question.message))
                    question.finish = None

    # ---- whose a message is

    def _answered_by(self, message: Message) -> Question | None:
        asked = self._asked[message.name]
        now = time.monotonic()
        for old in [q for q in asked if q.finish is None and q.until < now]:
            asked.remove(old)
        sender = self._sender_of(message)
        fitting = [
            q
            for q in asked
            if (q.address is None or sender is None or q.address == sender) and message.t >= q.since - _SLACK
        ]
        expecting = [q for q in fitting if not q.is_over]
        same = [q for q in fitting if self._carries(message, q, self._carried_names(q))]
        if same:  # it says whose it is; of several the first that still waits
            return next((q for q in same if not q.is_over), same[0])
        for question in expecting:
            names = self._identifying_names(question)
            if not names or any(self._carries(message, question, [n]) for n in names) or not question.carried:
                return question
            question.others = {name: message.fields[name] for name in names}
        return None

    def _sender_of(self, message: Message) -> int | None:
        if self._peer is None or self._peer.name not in message.header:
            return None
        return self._peer.value.wire_bits(message.header[self._peer.name])

    def _is_busy(self) -> bool:
        return bool(self._waiting) or any(q.finish is not None for asked in self._asked.values() for q in asked)

    def _leave(self, question: Question) -> None:
        """Send it, and note it in the order of the line."""
        asked = self._asked.setdefault(question.reply, deque())
        while len(asked) >= _MOST and (old := next((q for q in asked if q.finish is None), None)) is not None:
            asked.remove(old)
        if question.finish is not None and self._account is not None:
            question.before = self._account()
        question.since = time.monotonic()
        question.until = question.since + _OWN_SEND
        asked.append(question)
        try:
            question.leave()
        except BaseException:
            asked.remove(question)
            raise
        question.leave = _left  # it holds the link

    def _next(self) -> None:
        """Give the turn to the next waiting request."""
        while self._waiting and not any(q.finish is not None for asked in self._asked.values() for q in asked):
            question = self._waiting.popleft()
            try:
                self._leave(question)
            except Exception as error:
                finish, question.finish = question.finish, None
                if finish is not None:
                    finish(error)

    def _carried_names(self, question: Question) -> list[str]:
        if question.message not in self._shared:
            message = self._codec.model.message
            self._shared[question.message] = carried_back(message(question.reply), message(question.message))
        return self._shared[question.message]

    def _identifying_names(self, question: Question) -> list[str]:
        if question.message not in self._identifying:
            message = self._codec.model.message
            names = identifying(message(question.reply), message(question.message))
            service = self._codec.model.service("parameter")
            if service is not None and question.message == service.message("set"):
                names = [name for name in names if name != "value"]  # a refusal brings the old one
            self._identifying[question.message] = names
        return self._identifying[question.message]

    def _carries(self, message: Message, question: Question, names: list[str]) -> bool:
        """Check whether this reply has the request's values in these fields. False if there are none."""
        if not names:
            return False
        if question.carried is None:  # as they are on the wire
            decoder = self._codec.decoder(self._end)
            sent = [*decoder.feed(question.frame), *decoder.finish()]
            question.carried = next((m.fields for m in sent if m.name == question.message), {})
        fields = message.fields
        return all(name in question.carried and fields[name] == question.carried[name] for name in names)


def _left() -> None:
    raise AssertionError("a question leaves once")


def check_timeout(timeout: float) -> None:
    """Validate the time that a request may wait.

    :raises UsageError: it is out of range.
    """
    expected = f"more than 0 and at most {MAX_TIMEOUT:g} s"
    if not 0 < real("timeout", timeout, expected) <= MAX_TIMEOUT:
        raise UsageError(f"timeout is {timeout:g} s; expected {expected}")


def timeout_error(
    codec: Codec, end: End, question: Question, header: Mapping[str, Any], timeout: float, port: str, state: str
) -> RequestTimeoutError:
    """Return the error for a missing reply: the request, the device, the time, and what to check."""
    plan = plan_for(codec.model, end)
    peer = "MCU" if end == End.HOST else "host"
    whom = ""
    if plan.address is not None:
        asked = plan.header[plan.address]
        whom = f" from {asked.name} {header.get(asked.name, asked.default(end))}"
    arrived = question.arrived
    meanwhile = "" if arrived is None or not arrived.text else f"; meanwhile {arrived.text}"
    if question.since == 0.0:
        advice = "It was not sent, because other requests were not answered before it; give it more time"
    elif state == "down":
        advice = f"{port} is not connected at the moment; plug it in"
    elif arrived is not None and arrived.has_frames:
        advice = f"Check that the {peer} answers {question.message}" + (", and the address" if whom else "")
    elif arrived is not None and arrived.discarded:
        advice = "Check the baud rate, and that both ends use the same protocol file"
    elif state == "stale":
        advice = f"Nothing at all comes; check the cable, the baud rate, and that the {peer} runs"
    else:
        meanwhile = "; nothing arrived in that time"
        advice = f"Give it more time, or check that the {peer} answers {question.message}"
        advice += ", and the address" if whom else ""
    if question.others and question.carried is not None:
        came = ", ".join(f"{name} {value}" for name, value in question.others.items())
        asked_for = ", ".join(f"{name} {question.carried.get(name)}" for name in question.others)
        advice = (
            f"A {question.reply} came with {came}, but {asked_for} was asked for; check that the {peer} repeats the "
            "value that it was asked for"
        )
    return RequestTimeoutError(
        f"no {question.reply}{whom} within {timeout:g} s of {question.message}{meanwhile}. {advice}",
        question.message,
        question.reply,
        timeout,
    )
