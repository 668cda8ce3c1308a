"""Requests of an attached link: the server finds each reply, and says which message it is."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING

from wirebond.codec import Codec, Message
from wirebond.link.arrivals import Arrivals
from wirebond.link.requests import Question, RequestBook
from wirebond.protocol.model import End

if TYPE_CHECKING:
    from wirebond.link.attached.attached_link import AttachedLink

TAKEN = -1  # in place of a request's number: the server's link itself asked


class AttachedRequests(RequestBook):
    """Tracks requests like a link with its own port; any thread. The server decides whose reply it is, because other
    programs ask the same MCU."""

    def __init__(self, codec: Codec, end: End, engine: AttachedLink) -> None:
        super().__init__(codec, end)
        self._engine = engine
        self._guard = threading.RLock()
        self._open: dict[int, Question] = {}  # by the number of the call that asked
        engine.answers = self

    def submit(self, question: Question) -> None:
        """See ``RequestBook``."""
        if question.finish is None:
            question.leave()
            return
        question.since = time.monotonic()
        question.number = self._engine.next_number()
        with self._guard:
            self._open[question.number] = question
        try:
            with self._engine.asking(question.number):
                question.leave()
        except BaseException:
            with self._guard:
                self._open.pop(question.number, None)
            raise
        question.leave = _left  # it holds the link

    def withdraw(self, question: Question) -> None:
        """See ``RequestBook``."""
        question.finish = None
        question.is_over = True
        with self._guard:
            known = self._open.pop(question.number, None)
        if known is not None:
            self._learn(question)
            self._engine.withdraw(question.number)

    def _learn(self, question: Question) -> None:
        """Get the server's facts about it, for the sentence that no reply came."""
        known = self._engine.about(question.number)
        if known is not None:
            question.carried, question.others = known["carried"], known["others"]
            arrived = known.get("arrived")  # a server from before does not say it
            question.arrived = None if arrived is None else Arrivals(**arrived)
            question.since = question.since if known["was_sent"] else 0.0

    def may_take(self, messages: Sequence[Message]) -> bool:
        """See ``RequestBook``."""
        return self._engine.know_question_of(messages)

    def take(self, message: Message) -> bool:
        """See ``RequestBook``."""
        number = self._engine.question_of(message)
        if number == TAKEN:
            return True
        with self._guard:
            question = self._open.pop(number, None)
        if question is None or question.finish is None:
            return False
        finish, question.finish = question.finish, None
        finish(message)
        return True

    def fail(self, number: int, error: Exception) -> None:
        """Note that this request gets no reply, as the server says."""
        with self._guard:
            question = self._open.pop(number, None)
        if question is not None and question.finish is not None:
            finish, question.finish = question.finish, None
            finish(error)

    def fail_all(self, error: Callable[[str], Exception]) -> None:
        """Note that the server is gone."""
        with self._guard:
            questions, self._open = list(self._open.values()), {}
        for question in questions:
            if question.finish is not None:
                finish, question.finish = question.finish, None
                finish(error(question.message))

    def end(self, error: Callable[[str], Exception]) -> None:
        """See ``RequestBook``."""
        super().end(error)
        self.fail_all(error)


def _left() -> None:
    raise AssertionError("a question leaves once")
